"""Which of a model's formulas and free functions are reported, and by which name."""

from collections.abc import Mapping

import numpy as np

from glider.physics.effects import ATTACHED_LIFT, CAMBER
from glider.physics.effects.families import FAMILIES
from glider.sysid.constants import CORRECTION, RESOLVED, SLIGHT, Z
from glider.sysid.likelihood.fitted_functions import FittedFunction, flown_values
from glider.sysid.likelihood.task import FitResult, Task
from glider.sysid.likelihood.uncertainty import Uncertainty
from glider.sysid.search.support import SearchResult

LIFT = "lift over alpha"
UNEXPLAINED = "unexplained"

_LARGE_PART = 0.5  # Share of a normal force above which, at α = 0, it is camber alone.


def names_of(task: Task, traced: SearchResult, known: Uncertainty) -> dict[str, str]:
    """Returns what the effects of a model are reported as; others have no entry.

    A formula has its own name. It has none where it explains less than a share
    `CORRECTION` of what a free function that bends it does. A free function that bends
    a named formula is a correction of its shape; any other has the name of the formula
    that explains it, or none of the library.
    """
    model = traced.model
    evidence = traced.evidence
    hidden = _slight(model, evidence) | _small(task, model)
    shown = [kind for kind in model.kinds if kind not in hidden]
    functions = [kind for kind in shown if kind in model.free_kinds]
    functions.sort(key=lambda name: -evidence[name])
    formulas = [kind for kind in shown if kind not in model.free_kinds]
    for name in functions:
        bent = FAMILIES[name].bends
        least = CORRECTION * evidence[name]
        formulas = [k for k in formulas if k not in bent or evidence[k] >= least]
    names = {kind: kind for kind in formulas}
    for name in functions:
        own = traced.nearest.get(name, UNEXPLAINED)
        if name == LIFT:
            is_beside = ATTACHED_LIFT.kind in formulas
            own = _name_of_lift(model, known, is_beside)
        elif _corrects(name, {*formulas}, evidence):
            continue
        if own == UNEXPLAINED or own not in names.values():
            names[name] = own
    return names


def _corrects(name: str, formulas: set[str], evidence: Mapping[str, float]) -> bool:
    """Whether a free function only bends a formula that is named.

    It is an effect of its own beside a formula of another family, if it has a family
    and explains more than a share `CORRECTION` of what the formula does.
    """
    family = FAMILIES[name]
    bent = family.bends & formulas
    if not family.formulas or not bent.isdisjoint(family.formulas):
        return bool(bent)
    return any(evidence[name] < CORRECTION * evidence[kind] for kind in bent)


def _slight(model: FitResult, evidence: Mapping[str, float]) -> set[str]:
    """Returns the effects that explain next to nothing where free functions act.

    With all that bend them, or that they bend, they bring less than a share `SLIGHT` of
    the evidence: a free function leaves errors of that size, and they stand for those.
    """
    if not model.free_kinds:
        return set()
    together = dict(evidence)
    for name in model.free_kinds:
        for kind in FAMILIES[name].bends & evidence.keys():
            together[kind] += evidence[name]
            together[name] += evidence[kind]
    least = SLIGHT * sum(evidence.values())
    return {kind for kind, own in together.items() if own < least}


def _small(task: Task, model: FitResult) -> set[str]:
    """Returns the free functions that are next to nothing where others act too.

    Along the flights (RMS) they are less than twice a share `RESOLVED` of what is
    expected: the others, and the formulas that these bend, leave errors of that size.
    """
    if len(model.functions) < 2:
        return set()
    flown = flown_values(task.records, model.theta)
    sizes = {own.name: _size(own, flown) for own in model.functions}
    largest = max(sizes, key=sizes.__getitem__)
    return {name for name in sizes if sizes[name] < 2.0 * RESOLVED and name != largest}


def _size(function: FittedFunction, flown: np.ndarray) -> float:
    at = flown[:, function.columns]
    values = function.gaussians(at) @ function.weights
    rms = float(np.sqrt(np.mean(values**2)))
    [value] = function.effect.coefficients
    return rms / value.scale


def _name_of_lift(model: FitResult, known: Uncertainty, is_beside: bool) -> str:
    """Returns the name of a normal force over the angle of attack: lift or camber.

    Lift is none at α = 0. What is there is camber where it is not by chance, within Z
    standard errors, and a large part of the force, or any beside a formula of lift.
    """
    function = model.by_name[LIFT]
    low, high = function.flown[:, 0]
    alpha = np.append(0.0, np.linspace(low, high, 101))
    rows = function.gaussians(alpha[:, None]) @ function.mix
    force = np.abs(rows @ function.coordinates)
    std = float(known.std_along(known.places[LIFT], rows[0]))
    least = CORRECTION if is_beside else _LARGE_PART
    is_large = force[0] > least * force.max()
    is_camber = is_large and force[0] > Z * std
    return CAMBER.kind if is_camber else ATTACHED_LIFT.kind
