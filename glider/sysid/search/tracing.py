"""The search for effects: sets of the library, by evidence or by predictions.

Where the forces of a glider are known, this is a loop over moves: all flights are made
linear about the best model so far, better sets are proposed in closed form and fitted,
until no move finds one. Where they are unknown there are no moves: the set that
predicts held-out flights best is searched and fitted again, with the errors that the
last one leaves in the forces, until a set comes twice or `_ROUNDS` are over.
"""

import dataclasses
from collections.abc import Collection, Mapping, Sequence

import numpy as np

from glider.physics.effects.families import FAMILIES, formulas_at
from glider.progress import Progress, Step
from glider.sysid.constants import (
    ALONG_ATTITUDE,
    CLEAR,
    EXPLAINED,
    FOLLOWED,
    HELD_OUT_THRESHOLD,
    MOSTLY,
    RESOLVED,
    RIVAL_GAP,
    SLIGHT,
)
from glider.sysid.likelihood.candidates import gather
from glider.sysid.likelihood.fitted_functions import flown_values
from glider.sysid.likelihood.model_fit import error_flights, fit_model
from glider.sysid.likelihood.scale_fit import fit_scales
from glider.sysid.likelihood.scales import NAMES, Scales, start_scales
from glider.sysid.likelihood.task import FitResult, Task, start_of
from glider.sysid.replay.record import Noise
from glider.sysid.result import UNEXPLAINED
from glider.sysid.search.moves import Search
from glider.sysid.search.subsets import (
    best_set,
    climb,
    near_sets,
    scorer_of,
    threshold_of,
)

# Unknown parameters of a vehicle that barely show in the forces.
_OF_MOMENT = ("pitch_inertia", "wing_offset")
# Scales that are estimated from the forces: errors of the moment, whose formula is
# rougher, must not turn the flights' axes or their winds.
_OF_FORCES = ("wind", "trim", "pitch_zero")
_ROUNDS = 4  # Of sets and strengths of errors that depend on each other.


@dataclasses.dataclass(frozen=True, kw_only=True)
class SearchResult:
    """Outcome of a search.

    Attributes:
        model: with the effects that were found.
        bare: the model without any, fitted.
        evidence: kind to the evidence lost without it [nats].
        names: kind to the name by which it is reported; others are not.
        rivals: models of sets that are nearly as likely, and the evidence that each
            lacks [nats].
        threshold: least evidence of an effect beside others [nats].
        near: formulas that sets as good to first order have, and those found.
        alike: kind to formulas that would do as well in its place to first order.
        forces: the model as it was judged, along the measured attitude, if not as is.
        bank: bank angle at the end of flights whose roll is not logged, RMS [rad].
    """

    model: FitResult
    bare: FitResult
    evidence: dict[str, float]
    names: dict[str, str]
    rivals: tuple[tuple[FitResult, float], ...] = ()
    threshold: float
    near: set[str]
    alike: dict[str, set[str]] = dataclasses.field(default_factory=dict)
    forces: FitResult | None = None
    bank: float | None = None

    @property
    def judged(self) -> FitResult:
        """The model in which the effects were compared."""
        return self.model if self.forces is None else self.forces

    def reduced_to(self, model: FitResult, bank: float) -> "SearchResult":
        """Returns the outcome in which flights roll, with a model of fewer effects."""
        kinds = {*model.kinds}
        return dataclasses.replace(
            self,
            model=model,
            evidence={kind: self.evidence[kind] for kind in kinds},
            names={kind: self.names[kind] for kind in kinds & self.names.keys()},
            rivals=(),
            bank=bank,
        )


def trace(search: Search, noise: Noise) -> SearchResult:
    """Finds the effects that the flights of a search show, which keeps its fits.

    By their evidence; where forces are unknown, by predictions of held-out flights.
    """
    task = search.task
    progress = search.progress
    if not task.vehicle.knows_forces:
        return _trace_by_predictions(task, noise, progress)
    model = _searched(search, start_of(task, noise))
    progress(Step("weighing the effects", 0.76))
    model, evidence = _needed(search, model)
    progress(Step("fitting the flat-plate model", 0.8))
    bare = search.fit(model.without(task, *model.kinds))

    near = set(model.kinds)
    alike: dict[str, set[str]] = {}
    score = search.near(model)
    if score is not None:
        early = score.among(without_late(task, near).offered)
        near, alike = near_sets(early, score.by_first(model.kinds))

    return SearchResult(
        model=model,
        bare=bare,
        evidence=evidence,
        names=_names_of(search, model, evidence),
        rivals=_rivals_of(search, model),
        threshold=threshold_of(task, "", task.vehicle.kinds),
        near=near,
        alike=alike,
    )


def _searched(search: Search, model: FitResult) -> FitResult:
    """Returns the best model: of formulas, of free functions too, of all effects.

    No move betters it with effects that are tried early, nor the best set with all.
    """
    task = search.task
    early = without_late(task)
    # A formula's own free function would come before it.
    search.task = early.offering(early.kinds)
    model = search.improved(model, by_sets_only=True)
    search.task = early
    model = search.improved(model)
    if early is task:
        return model
    search.task = task
    with_late = search.improved(model, by_sets_only=True)
    return model if with_late is model else search.improved(with_late)


def _rivals_of(search: Search, model: FitResult) -> tuple[tuple[FitResult, float], ...]:
    """Returns the fitted sets that lack little evidence, and how much [nats].

    First those without one of the effects. The best without each formula, whatever
    stands for it, is fitted now if it may be nearly as likely. A set with more effects
    is no rival where the flights are no likelier with these.
    """
    own = set(model.kinds)
    score = search.near(model)
    if score is not None:
        members = score.by_first(model.kinds)
        offered = own | (score.variants.keys() - FAMILIES.keys())
        for kind in model.kinds:
            if kind in FAMILIES:
                continue
            rest = tuple(member for member in members if member[0] != kind)
            others = climb(score.among(offered - {kind}), rest)
            if score(others) > score(members) - CLEAR:
                search.fit(score.begin(others))

    found = []
    best = search.penalized_cost(model)
    cost = model.cost + model.freedom
    for kinds, other in search.fitted.items():
        lack = max(search.penalized_cost(other) - best, 0.0)
        adds_nothing = own < kinds and other.cost + other.freedom >= cost
        if kinds != own and not adds_nothing and lack < RIVAL_GAP:
            found.append((other, lack))

    found.sort(key=lambda pair: (own.issubset(pair[0].kinds), pair[1]))
    return tuple(found[:FOLLOWED])


def _names_of(
    search: Search, model: FitResult, evidence: Mapping[str, float]
) -> dict[str, str]:
    """Returns the names by which the effects of a model are reported.

    A formula has its own. Beside free functions it has none where it brings, with those
    that bend it, less than a share `SLIGHT` of the evidence, as functions leave errors
    of that size; or less than a share `EXPLAINED` of what one that bends it does. A
    free function has the name of the formula that explains it best, if one does; or of
    the formula with a name that it bends. Else it is unexplained. Beside a larger one
    it has no name below twice `RESOLVED`: functions leave errors of that size, too.
    """
    if not model.free_kinds:
        return {kind: kind for kind in model.kinds}
    shown = _shown_beside_functions(search, model, evidence)
    names = {kind: kind for kind in shown if kind not in FAMILIES}
    slight = {*model.kinds} - FAMILIES.keys() - names.keys()
    shaped = search.fit(model.without(search.task, *slight))
    for function in shown:
        if function in FAMILIES:
            bent = FAMILIES[function].bends & names.keys()
            formula = _explaining(search, shaped, function, may_bend=bool(bent))
            bent_most = max(bent, key=evidence.__getitem__, default=UNEXPLAINED)
            names[function] = formula or bent_most

    return names


def _shown_beside_functions(
    search: Search, model: FitResult, evidence: Mapping[str, float]
) -> list[str]:
    """Returns the kinds that errors of free functions do not explain, see `_names_of`.

    Those of most evidence come first.
    """
    task = search.task
    flown = flown_values(task.records, model.theta)
    sizes = {own.name: own.size(flown) for own in model.functions}
    least_size = min(2.0 * RESOLVED, max(sizes.values()))
    least = SLIGHT * sum(evidence.values())
    shown = []
    for kind in sorted(model.kinds, key=evidence.__getitem__, reverse=True):
        if sizes.get(kind, least_size) < least_size:
            continue
        worth = evidence[kind]
        bending = [f for f in model.free_kinds if kind in FAMILIES[f].bends]
        if any(worth < EXPLAINED * evidence[function] for function in bending):
            continue
        if bending and worth < least:
            without = search.fit(model.without(task, kind, *bending))
            lost = without.cost + without.freedom
            worth = lost - (model.cost + model.freedom)
        if worth >= least:
            shown.append(kind)

    return shown


def _explaining(
    search: Search, model: FitResult, function: str, *, may_bend: bool
) -> str | None:
    """Returns the formula at a function's link that explains it best, None if none.

    In the place of the function, the other coefficients fitted again with the noise
    that the function leaves, it gains a share `EXPLAINED` of what the function does; or
    `MOSTLY`, where the function may only bend another formula, or varies with more
    than the formula does.
    """

    def fit(start: FitResult) -> FitResult:
        start = dataclasses.replace(start, scales=model.scales)
        return fit_model(search.task, start, free_scales=(), with_strength=True)

    score = search.near(model)
    if score is None:
        return None
    others = score.by_first([kind for kind in model.kinds if kind != function])
    without = fit(score.begin(others))
    fits = {}
    for kind in formulas_at(function):
        options = score.among({kind}).larger(others)
        best = max(options, key=score.gain, default=None)
        if best is not None:
            fits[kind] = fit(score.begin(best))

    if not fits:
        return None
    formula = min(fits, key=lambda kind: search.penalized_cost(fits[kind]))
    named = fits[formula]
    cost = without.cost + without.freedom
    gain = cost - (named.cost + named.freedom)
    of_function = cost - (model.cost + model.freedom)
    is_of_family = formula in FAMILIES[function].formulas
    share = EXPLAINED if is_of_family and not may_bend else MOSTLY
    return formula if gain > share * of_function else None


def _needed(search: Search, model: FitResult) -> tuple[FitResult, dict[str, float]]:
    """Returns a model that is worth less without any effect, and their evidence.

    The evidence is what is lost without an effect [nats]. Where a model without one
    diverges it is as much as the most of the others.
    """
    while True:
        fewer = {kind: search.fit_without(model, kind) for kind in model.kinds}
        best = min(fewer.values(), key=search.penalized_cost, default=model)
        if not search.prefers(best, model):
            break
        model = search.improved(best)

    cost = model.cost + model.freedom
    lost = {kind: other.cost + other.freedom - cost for kind, other in fewer.items()}
    most = max(filter(np.isfinite, lost.values()), default=CLEAR)
    return model, {k: v if np.isfinite(v) else most for k, v in lost.items()}


def without_late(task: Task, kept: Collection[str] = ()) -> Task:
    """Returns the task with the effects that are tried first, and those kept.

    All of them where a user chose them.
    """
    if len(task.kinds) < len(task.vehicle.kinds):
        return task
    late = {name for name, kind in task.space.kinds.items() if kind.is_rare}
    return task.offering(task.offered.difference(late).union(kept))


# Gliders of which little is known: forces come first, whatever the moment.


def _trace_by_predictions(task: Task, noise: Noise, progress: Progress) -> SearchResult:
    """Finds the effects that the forces along the measured attitude show.

    No formula of an unknown glider is right: what is left of the forces is an error
    that persists, whose strength and time are estimated.
    """
    start = start_of(task, noise)
    scales = dataclasses.replace(start.scales, **ALONG_ATTITUDE)
    forces = dataclasses.replace(start, scales=scales, has_force_errors=True)
    tried: list[frozenset[str]] = []
    for _ in range(_ROUNDS):
        progress("searching for effects along the measured attitude")
        candidates = gather(task.offering(task.kinds), forces)
        score = scorer_of(candidates, candidates.grams(forces.scales))
        members = best_set(score)
        forces = fit_model(task, score.begin(members), free_scales=())
        # With the errors that it leaves in the forces.
        flights = error_flights(task, forces)
        scales, _ = fit_scales(flights, forces.scales, free=("air", "air_time"))
        forces = dataclasses.replace(forces, scales=scales)
        kinds = frozenset(forces.kinds)
        if kinds in tried:
            break
        tried.append(kinds)

    bare = forces
    if forces.kinds:
        progress(Step("fitting the flat-plate model", 0.5))
        bare = fit_model(task, forces.without(task, *forces.kinds), free_scales=())

    progress(Step("fitting the moment", 0.53))
    near, alike = near_sets(score.among(without_late(task).offered), members)
    kept = {name: getattr(forces.scales, name) for name in _OF_FORCES}
    scales = dataclasses.replace(start_scales(noise), **kept)
    others = [name for name in NAMES if name not in _OF_FORCES]
    return SearchResult(
        model=_with_moment(task, forces, scales, others),
        bare=_with_moment(task, bare, scales, others),
        evidence=score.lost(members),
        names={kind: kind for kind in forces.kinds},
        threshold=HELD_OUT_THRESHOLD["effect"],
        near=near,
        alike=alike,
        forces=forces,
    )


def _slots_of_moment(task: Task) -> set[int]:
    """Returns the slots of unknowns that only the moment and the log show."""
    found = {*task.space.places(_OF_MOMENT), *task.vehicle.of_log}
    for kind in task.space.kinds.values():
        if kind.unknown_without is not None:
            found.update(task.space.slots_of(kind.kind))

    return found


def _with_moment(
    task: Task, model: FitResult, scales: Scales, free_scales: Sequence[str] = ()
) -> FitResult:
    """Returns a model of forces with its moment fitted, and some scales.

    `scales` are the noise under which it is fitted, `free_scales` those to fit.
    """
    slots = _slots_of_moment(task)
    free = tuple(slot for slot in task.vehicle.nuisance if slot in slots)
    start = dataclasses.replace(model, free=free, scales=scales, has_force_errors=False)
    fitted = fit_model(task, start, free_scales=free_scales)
    return dataclasses.replace(fitted, free=task.free(model.kinds))


def refitted(task: Task, model: FitResult, forces: FitResult | None) -> FitResult:
    """Returns a model with its coefficients fitted to other flights, all noise kept.

    `forces` is that of the `SearchResult`: first the forces are fitted, if they are
    unknown, and then the moment.
    """
    if not (model.free or model.functions):
        return model
    if forces is None:
        return fit_model(task, model, free_scales=())
    found = fit_model(task, forces_alone(task, model, forces), free_scales=())
    return _with_moment(task, found, model.scales)


def forces_alone(task: Task, model: FitResult, forces: FitResult) -> FitResult:
    """Returns a model of which only the forces will be fitted, to other flights."""
    kept = _slots_of_moment(task)
    free = tuple(slot for slot in model.free if slot not in kept)
    return dataclasses.replace(
        model, free=free, scales=forces.scales, has_force_errors=True
    )
