"""The names of what a search found: which formulas are effects, which only help others.

Beside a free function a formula may stand for what the function leaves, and a free
function for the error of a formula. The model has both; the report names one.
"""

import math
import types
from collections.abc import Collection, Mapping, Sequence

import numpy as np

from glider.physics.effects import (
    ATTACHED_LIFT,
    CAMBER,
    CENTER_OF_PRESSURE,
    PITCH_DAMPING,
    PITCH_MOMENT,
    PITCH_RATE_LIFT,
)
from glider.physics.effects.families import FAMILIES
from glider.sysid.constants import LEAST_PART, LEAST_SPREAD, RESOLVED, SLACK, SLIGHT, Z
from glider.sysid.likelihood.fitted_functions import flown_values
from glider.sysid.likelihood.task import FitResult, Task
from glider.sysid.likelihood.uncertainty import Uncertainty
from glider.sysid.search.support import SearchResult

LIFT = "lift over alpha"
_PAIR = "alpha and reduced_rate"
OVER_RATE = {"lift": PITCH_RATE_LIFT.kind, "moment": PITCH_DAMPING.kind}
"""The formula that is linear in the pitch rate, of each link with such functions."""

_ATTACHED = 0.15  # Angle of attack below which no flow separates [rad].
_ROWS = 1000  # At which a function counts, of those that were flown.


def absorbed(
    task: Task, traced: SearchResult, known: Uncertainty
) -> dict[str, set[str]]:
    """Returns the effects that only help others to their shape, and which others.

    First those that are `slight` or `small`. Then formulas with a memory whose times
    are not longer than the least, within two standard errors, beside a formula without
    one, or a free function, that may have their shape. Then, of those that a free
    function bends, each that explains less than it does, or less than a tenth of it if
    it is of another family or the first of the function's own: but for the first of all
    where that is of none, and for those that have a function of their own family. A
    constant moment is never the first: functions of the moment lack just their mean.
    """
    model = traced.model
    evidence = traced.evidence
    little = slight(model.free_kinds, evidence) | small(task, model)
    found = {key: set[str]() for key in little}
    kinds = task.space.kinds
    have = set(model.kinds) - found.keys()
    for name in model.kinds:
        if name not in have or name in model.free_kinds or not kinds[name].states:
            continue
        pairs = zip(task.space.slots_of(name), kinds[name].coefficients, strict=True)
        times = [i for i, c in pairs if c.unit == "s"]
        least, _ = task.bounds(times)
        far = model.theta[times] - least > 2.0 * np.array([known.std(i) for i in times])
        near = set[str]()
        for function, own in FAMILIES.items():
            if name in own.bends and "alpha" in own.variables:
                alone = own.formulas if own.variables == ("alpha",) else ()
                near |= {function, *(k for k in alone if not kinds[k].states)}
        if times and not far.any() and near & have:
            found[name] = near & have
    families = {kind for name in model.free_kinds for kind in FAMILIES[name].formulas}
    for function in model.free_kinds:
        if function in found:
            continue
        own = FAMILIES[function]
        bends = own.bends - families.difference(own.formulas)
        bent = bends.intersection(have) - found.keys()
        mine = bent.intersection(own.formulas) if own.formulas else bent
        first = max(mine - {PITCH_MOMENT.kind}, key=lambda k: evidence[k], default="")
        share = {k: SLACK if k in bent - mine else 1.0 for k in bent - {first}}
        if own.formulas and first:
            share[first] = SLACK
        weak = {k for k in share if evidence[k] < share[k] * evidence[function]}
        found |= dict.fromkeys(weak, {*bent, function} - weak)
    return found


def standing_alone(
    evidence: Mapping[str, float],
    free_kinds: Collection[str],
    unnamed: Mapping[str, Collection[str]],
) -> set[str]:
    """Returns the free functions that only help no formula that is named.

    Neither one that they bend (of another family: if they explain less than a tenth of
    it and the functions of its family), nor one that a formula of their family, unnamed
    itself, helps.
    """
    named = evidence.keys() - unnamed.keys() - {*free_kinds}
    found = set()
    for function in free_kinds:
        bends = FAMILIES[function].bends
        helped = {k for k in bends if _helps(function, k, named, free_kinds, evidence)}
        for kind in FAMILIES[function].formulas:
            helped |= named.intersection(unnamed.get(kind, ()))
        if function not in unnamed and not helped:
            found.add(function)
    return found


def _helps(
    function: str,
    kind: str,
    named: Collection[str],
    free_kinds: Collection[str],
    evidence: Mapping[str, float],
) -> bool:
    """Whether a free function that bends a formula need be no effect of its own.

    It is of another family if it has one without the formula, or the formula has
    functions of its own.
    """
    family = FAMILIES[function].formulas
    beside = [own for own in free_kinds if kind in FAMILIES[own].formulas]
    if kind in family or not (family or beside):
        return kind in named
    whole = evidence[kind] if kind in named else 0.0
    whole += sum(evidence[own] for own in beside)
    return evidence[function] < SLACK * whole


def slight(free_kinds: Collection[str], evidence: Mapping[str, float]) -> set[str]:
    """Returns the effects that explain next to nothing where free functions act.

    With all that bend them, or that they bend, they bring less than a share `SLIGHT` of
    the evidence: a free function leaves errors of that size, and they stand for those.
    """
    families = dict(evidence)
    for function in free_kinds:
        for kind in FAMILIES[function].bends & evidence.keys():
            families[kind] += evidence[function]
            families[function] += evidence[kind]
    least = SLIGHT * sum(evidence.values()) if free_kinds else 0.0
    return {kind for kind, own in families.items() if own < least}


def small(task: Task, model: FitResult) -> set[str]:
    """Returns the free functions that are next to nothing where others act too.

    Along the flights (RMS) they are less than twice a share `RESOLVED` of what is
    expected: the others, and the formulas that these bend, leave errors of that size.
    """
    if len(model.functions) < 2:
        return set()
    flown = flown_values(task.records, model.theta)
    sizes = dict[str, float]()
    flown = flown[:: max(1, len(flown) // _ROWS)]
    for own in model.functions:
        values = own.gaussians(flown[:, own.columns]) @ own.weights
        [value] = own.effect.coefficients
        sizes[own.name] = math.sqrt(np.mean(values**2)) / value.scale
    largest = max(sizes, key=sizes.__getitem__)
    return {name for name in sizes if sizes[name] < 2.0 * RESOLVED and name != largest}


def names_of(
    task: Task, model: FitResult, known: Uncertainty, function: str, nearest: str
) -> set[str]:
    """Returns the effects that a free function is; `nearest` if its link tells nothing.

    Functions of the angle of attack and the pitch rate are split into their sum at no
    rate and the rest. Either is real where it is a large part of both (RMS), in what
    was flown. If neither is, the more certain one is what was found. Lift by the rate
    where no flow separates lags behind nothing.
    """
    link, _, _ = function.partition(" over ")
    together = _over_rate(model, link)
    pair = f"{link} over {_PAIR}"
    if function not in together or pair not in together:
        return {nearest}
    values, places = _coordinates_of(model, known, together)
    slots = task.space.slots_of(OVER_RATE[link])
    acting = [i for i in slots if i in known.free]  # The formula is of the same force.
    values = np.append(values, model.theta[acting])
    places += map(known.free.index, acting)

    def rows(at: np.ndarray) -> np.ndarray:
        by_formula = -at[:, 1:].repeat(len(acting), axis=1)
        return np.hstack([_rows_at(model, together, at), by_formula])

    flown = flown_values(task.records, model.theta)
    flown = flown[:: max(1, len(flown) // _ROWS)][:, model.by_name[pair].columns]
    static = rows(flown * [1.0, 0.0])
    whole = rows(flown)

    def shown(rows: np.ndarray) -> float:
        forces = rows @ values
        is_known = np.abs(forces) > Z * known.std_along(places, rows)
        return float(np.sqrt(np.sum(forces[is_known] ** 2) / max(len(forces), 1)))

    def certainty(rows: np.ndarray) -> float:
        return float(np.max(np.abs(rows @ values) / known.std_along(places, rows)))

    least = LEAST_PART * shown(whole)
    names = set[str]()
    changes = whole - static
    by_rate = shown(changes)
    is_static = shown(static) > least
    is_by_rate = by_rate > least
    if not (is_static or is_by_rate):
        is_static = certainty(static) > certainty(changes[np.any(changes, axis=1)])
        is_by_rate = not is_static
    if is_static:
        of_lift = link == "lift" and names_of_lift(task, model, known)
        names |= of_lift or {CENTER_OF_PRESSURE.kind}
    if is_by_rate:
        attached = changes[np.abs(flown[:, 0]) < _ATTACHED]
        is_attached = link == "lift" and shown(attached) > LEAST_PART * by_rate
        names.add(OVER_RATE[link] if is_attached else nearest)
    return names


def _over_rate(model: FitResult, link: str) -> list[str]:
    """Returns a model's functions over alpha and the rate, if these are two families.

    Those of lift and of the moment.
    """
    names = [f"{link} over {v}" for v in ("alpha", "reduced_rate", _PAIR)]
    return [n for n in names if n in model.by_name and link in ("lift", "moment")]


def _rows_at(model: FitResult, functions: Sequence[str], at: np.ndarray) -> np.ndarray:
    """Returns how the sum of such functions depends on their coordinates, (n, q).

    `at` (n, 2) are angles of attack and reduced rates.
    """
    rows = []
    for own in (model.by_name[name] for name in functions):
        columns = [("alpha", "reduced_rate").index(v) for v in own.variables]
        rows.append(own.gaussians(at[:, columns]) @ own.mix)
    return np.hstack(rows)


def _coordinates_of(
    model: FitResult, known: Uncertainty, functions: Sequence[str]
) -> tuple[np.ndarray, list[int]]:
    """Returns the coordinates (q,) of some functions, and their columns."""
    values = [model.by_name[name].coordinates for name in functions]
    return np.concatenate(values), [k for n in functions for k in known.places[n]]


def names_of_lift(task: Task, model: FitResult, known: Uncertainty) -> set[str]:
    """Returns what a normal force over the angle of attack is: lift, camber or both.

    Camber is what it is at α = 0. That is by chance within Z standard errors, and
    nothing below a tenth of the largest force; above half of it there is nothing else.
    """
    space = task.space
    centers = task.functions[LIFT].reached
    alpha = np.append(0.0, centers[:, 0])
    functions = _over_rate(model, "lift")
    shown = _rows_at(model, functions, np.column_stack([alpha, 0.0 * alpha]))
    values, places = _coordinates_of(model, known, functions)
    force = shown @ values
    slopes = [*shown[0]]
    flow = types.SimpleNamespace(sin_alpha=np.sin(alpha), cos_alpha=np.cos(alpha))
    for kind in set(FAMILIES[LIFT].formulas).intersection(model.kinds):
        slots = [*space.slots_of(kind)]
        force += space.kinds[kind].formula(flow, *model.theta[slots])
        if kind == CAMBER.kind:  # The other is none there.
            slopes.append(-2.0 * np.cos(float(model.theta[slots[0]])))
            places.append(known.free.index(slots[0]))
    share = abs(force[0]) / np.abs(force).max()
    is_known = abs(force[0]) > Z * known.std_along(places, np.array(slopes))
    if not is_known or share < LEAST_SPREAD:
        return {ATTACHED_LIFT.kind}
    camber = {CAMBER.kind}
    return camber if share > 0.5 else {ATTACHED_LIFT.kind, *camber}
