"""The search for effects: sets of the library, by their evidence.

One loop over moves: all flights are made linear about the best model so far, better
sets are proposed in closed form and fitted, until no move finds one. What resampled
flights do not support is dropped, and the loop goes on without it.
"""

from collections.abc import Collection, Mapping

import numpy as np

from glider.physics.effects.families import FAMILIES
from glider.progress import Progress, Step
from glider.sysid.constants import CLEAR, FOLLOWED, RIVAL_GAP
from glider.sysid.likelihood.candidates import Candidates
from glider.sysid.likelihood.task import FitResult, Task, start_of
from glider.sysid.replay.record import Noise
from glider.sysid.result import EvidenceThreshold
from glider.sysid.search import moves
from glider.sysid.search.force_search import search_forces
from glider.sysid.search.subsets import climb, scorer_of, threshold_of
from glider.sysid.search.support import (
    EffectSupport,
    Search,
    SearchResult,
    near_and_rivals,
    weakest,
    weigh,
)

_FIRST = ("best set",)  # Moves among effects that are new to the search.


def trace(
    task: Task, noise: Noise, rng: np.random.Generator, progress: Progress
) -> SearchResult:
    """Finds the effects that the flights show."""
    if not task.vehicle.knows_forces:
        return search_forces(task, noise, rng, progress)
    search = Search(task, progress)
    model = _searched(search, start_of(task, noise))
    progress(Step("weighing the effects", 0.76))
    model, evidence, weighed = supported(search, model, rng)
    progress(Step("fitting the flat plate alone", 0.8))
    bare = search.fit(model.without(task, *model.kinds))
    return SearchResult(
        model=model,
        bare=bare,
        evidence=evidence,
        weighed=weighed,
        alone=search.alone,
        nearest=moves.nearest_of(search, model),
        rivals=rivals_of(search, model, weighed),
        threshold=EvidenceThreshold(effect=threshold_of(task, "", model.kinds)),
    )


def _searched(search: Search, model: FitResult) -> FitResult:
    """Returns the best model: of formulas, of free functions too, of all effects.

    No move betters it with effects that are tried early, nor the best set with all.
    """
    task = search.task
    early = without_late(task)
    # A formula's own free function would come before it.
    search.task = early.offering(early.kinds)
    model = improved(search, model, _FIRST)
    search.task = early
    model = improved(search, model)
    if early is task:
        return model
    search.task = task
    late = improved(search, model, _FIRST)
    return model if late is model else improved(search, late)


def rivals_of(
    search: Search, model: FitResult, weighed: Mapping[str, EffectSupport]
) -> tuple[tuple[FitResult, float], ...]:
    """Returns the fitted sets that lack little evidence, and how much [nats].

    First those without one of the effects. The best without each formula, whatever
    stands for it, is fitted now if it may be nearly as likely.
    """
    own = set(model.kinds)
    best = search.penalized_cost(model)
    swapped = [own - {k} | {r} for k, w in weighed.items() for r in w.rivals]
    if (near := search.near(model)) is not None:
        members = near.by_first(model.kinds)
        offered = {k for k in near.variants if k not in FAMILIES or k in own}
        for kind in [k for k in model.kinds if k not in FAMILIES]:
            rest = tuple(member for member in members if member[0] != kind)
            others = climb(near.among(offered - {kind}), rest)
            if near(others) > near(members) - CLEAR:
                search.fit(near.begin(others))
    found = []
    allowed = search.task.offered
    for kinds, other in search.fitted.items():
        lack = search.penalized_cost(other) - best
        if kinds in swapped or (kinds <= allowed and lack > -RIVAL_GAP):
            lack = max(lack, 0.0)
        if kinds != own and 0.0 <= lack < RIVAL_GAP:
            found.append((other, lack))
    found.sort(key=lambda pair: (own.issubset(pair[0].kinds), pair[1]))
    return tuple(found[:FOLLOWED])


def improved(
    search: Search, model: FitResult, names: Collection[str] = moves.MOVES
) -> FitResult:
    """Returns the model that none of the moves betters."""
    better: FitResult | None = model
    while better:
        model = better
        for name in names:
            search.progress(name)
            better = moves.MOVES[name](search, model)
            if better:
                break
    return model


def supported(
    search: Search, model: FitResult, rng: np.random.Generator
) -> tuple[FitResult, dict[str, float], dict[str, EffectSupport]]:
    """Returns a model of effects that resampled flights support, and their support.

    What takes the place of an effect that they do not support, but is not clearly worth
    more, they do not support either.
    """
    least: FitResult | None = None  # With the last effect that they did not support.

    def grown(model: FitResult) -> FitResult:
        other = improved(search, model)
        return other if least is None or search.prefers(other, least) else model

    while True:
        fewer = moves.one_less(search, model)
        best = min(fewer.values(), key=search.penalized_cost, default=model)
        if search.prefers(best, model):
            model = grown(best)
            continue
        weighed = weigh(search.task, model, rng)
        evidence = _evidence_of(search.task, model, fewer)
        weak = weakest(weighed, evidence)
        if weak is None:
            return model, evidence, weighed
        task = search.task
        least = model
        search.task = task.offering(task.offered - {weak})
        model = grown(search.fit(model.without(task, weak)))


def _evidence_of(
    task: Task, model: FitResult, fewer: Mapping[str, FitResult]
) -> dict[str, float]:
    """Returns the evidence lost without each effect, of models without them [nats].

    By Wald's test where a model without one diverges.
    """
    own = model.cost + model.freedom
    lost = {kind: m.cost + m.freedom - own for kind, m in fewer.items()}
    if not np.all(np.isfinite([*lost.values()])):
        shown = moves.shown_by(task, model)
        lost = {k: v if np.isfinite(v) else shown[k] for k, v in lost.items()}
    return lost


def without_late(task: Task, kept: Collection[str] = ()) -> Task:
    """Returns the task with the effects that are tried first, and those kept.

    All of them where a user chose them.
    """
    if len(task.kinds) < len(task.vehicle.kinds):
        return task
    late = {name for name, k in task.space.kinds.items() if k.is_rare}
    return task.offering(task.offered.difference(late).union(kept))


def search_about(
    candidates: Candidates, grams: np.ndarray, counts: np.ndarray
) -> tuple[FitResult, list[int]]:
    """Searches the effects of flights that count so often, in closed form.

    From the model's own set, among what is near it on all flights: farther away, errors
    of the linearization look like effects.

    Returns:
        the model with their coefficients, all else as it is, and their columns.
    """
    score = scorer_of(candidates, grams, counts)
    chosen = score.by_first(candidates.model.kinds)
    evenly = scorer_of(candidates, grams, np.ones(len(grams)))
    offered, _ = near_and_rivals(evenly, chosen)
    members = climb(score.among(offered), chosen)
    return score.begin(members), [c for _, variant in members for c in variant]
