"""The search for effects: sets of the library, by their evidence.

All flights are made linear about the best model so far, scales of noise fitted with
everything acting, the best set searched in closed form and fitted, until one returns.
"""

import dataclasses
from collections.abc import Collection, Mapping, Sequence

import numpy as np

from glider.progress import Progress, Step
from glider.sysid.constants import MOST_AVERAGED
from glider.sysid.likelihood.candidates import Candidates
from glider.sysid.likelihood.model_fit import FitResult, start_of
from glider.sysid.likelihood.task import Task
from glider.sysid.replay.smoothing import Noise
from glider.sysid.search import fits, moves
from glider.sysid.search.force_search import held_out_scorer, search_forces
from glider.sysid.search.subsets import Members, Scorer, best_set
from glider.sysid.search.support import (
    RIVAL_GAP,
    EffectSupport,
    SearchResult,
    weakest,
    weigh,
)

ROUNDS = 8  # At most.
# Tried last: scales are seldom wrong, and to first order they imitate many effects.
LATE = ("position_scale", "elevator_scale")
HASTE = 0.01  # Share of a round's gain below which a new effect waits for the next.


def trace(
    task: Task, noise: Noise, rng: np.random.Generator, progress: Progress
) -> SearchResult:
    """Finds the effects that the flights show."""
    if not task.vehicle.knows_forces:
        return search_forces(task, noise, rng, progress)
    search = fits.Search(without_late(task), progress)
    start = start_of(task, noise, with_curves=True)
    model = by_sets(search, start)
    progress(Step("weighing each effect", 0.4))
    model, evidence = moves.prune(search, model)
    while better := next(filter(None, (m(search, model) for m in moves.MOVES)), None):
        model, evidence = moves.prune(search, better)
    search.task = task
    if leaves_something(model) and (other := moves.with_forced(search, model, LATE)):
        model, evidence = moves.prune(search, by_sets(search, other))
    progress(Step("trying simpler models", 0.58))
    pruned = model
    model = moves.without_needless_curves(search, model)
    if leaves_something(model) or len(model.kinds) > 1:
        progress("looking for effects of another form")
        model = moves.with_blocks(search, model) or model
    if model.has_curves and len(model.kinds) <= 1 and not model.free_kinds:
        model = effects_instead_of_curves(search, model)
    if model is not pruned:
        again = model if model.free_kinds else by_sets(search, model)
        best = again if search.prefers(again, model) else model
        model, evidence = moves.prune(search, best)
    progress(Step("weighing the effects", 0.76))
    model, evidence, weighed = supported(search, model, evidence, rng)
    bare = model
    if model.kinds or model.blocks:
        progress(Step("fitting the flat plate alone", 0.8))
        bare = search.fit(fits.bare_of(task, model))
    least = search.penalized_cost(bare)
    gains = {
        m.kinds: least - search.penalized_cost(m)
        for m in search.fitted.values()
        if m.kinds
    }
    return SearchResult(
        model=model,
        bare=bare,
        evidence=evidence,
        weighed=weighed,
        alone=search.alone,
        combinations=tuple(sorted(gains.items(), key=lambda item: -item[1])),
        families=moves.families_of(search, model),
        rivals=rivals_of(search, model, weighed),
        threshold=fits.threshold_of(task, model),
    )


def rivals_of(
    search: fits.Search, model: FitResult, weighed: Mapping[str, EffectSupport]
) -> tuple[tuple[FitResult, float], ...]:
    """Returns the fitted sets that lack little evidence, and how much [nats].

    Those with a rival in an effect's place are fitted now, if not yet.
    """
    if not model.free_kinds:
        moves.with_a_rival(search, model, weighed, sure=np.inf)
    own, best = set(model.kinds), search.penalized_cost(model)
    swapped = [own - {k} | {r} for k, w in weighed.items() for r in w.rivals]
    near = []
    for other in search.fitted.values():
        lack = search.penalized_cost(other) - best
        if set(other.kinds) in swapped:
            lack = max(lack, 0.0)
        if set(other.kinds) != own and 0.0 <= lack < RIVAL_GAP:
            near.append((other, lack))
    return tuple(sorted(near, key=lambda pair: pair[1])[:MOST_AVERAGED])


def supported(
    search: fits.Search,
    model: FitResult,
    evidence: dict[str, float],
    rng: np.random.Generator,
) -> tuple[FitResult, dict[str, float], dict[str, EffectSupport]]:
    """Returns a model of effects that resampled flights support, and their support.

    Where in doubt, an effect may give way to a rival; without support, it is dropped.
    """
    dropped, beside_field = set[str](), bool(model.free_kinds)
    while True:
        weighed = weigh(search.task, model, fits.marginal_scorer, rng)
        other = None if beside_field else moves.with_a_rival(search, model, weighed)
        if other is None:
            weak = weakest(weighed, evidence, beside_field)
            if weak is None:
                return model, evidence, weighed
            dropped.add(weak)
            other = search.fit(fits.without(search.task, model, weak))
            if not beside_field:
                other = moves.with_another(search, other, dropped) or other
        model, evidence = moves.prune(search, other)


def leaves_something(model: FitResult) -> bool:
    """Whether a model leaves more than noise: moving air, or errors of its formulas."""
    return model.scales.air > 0.02 or moves.leaves_a_form(model)


def effects_instead_of_curves(search: fits.Search, model: FitResult) -> FitResult:
    """Returns a set of effects without curves where it explains nearly as much.

    Beside a wrong effect or none, curves absorb what a small effect explains.
    """
    bare = fits.bare_of(search.task, model)
    named = by_sets(search, search.fit(bare, iterations=4))
    lost = search.penalized_cost(named) - search.penalized_cost(model)
    return named if named.kinds and lost < moves.CURVE_THRESHOLD else model


def by_sets(search: fits.Search, model: FitResult) -> FitResult:
    """Returns the best of the sets that a search in closed form proposes."""
    tried: dict[frozenset[str], FitResult] = {}
    for round_ in range(ROUNDS):
        search.progress(f"searching for effects, round {round_ + 1}")
        near = search.near(model, 2 if round_ else 3)
        if near is None:
            break
        search.alone = search.alone or near.score.alone()
        members = best_members(near.score, model.kinds, tried)
        kinds = frozenset(kind for kind, _ in members)
        if kinds in tried:
            break
        search.progress(f"fitting {', '.join(sorted(kinds)) or 'the flat plate'}")
        model = moves.with_means(search, search.fit_with_strength(near.begin(members)))
        tried[kinds] = model
    return min(tried.values(), key=search.penalized_cost, default=model)


def best_members(
    score: Scorer, kinds: Sequence[str], tried: Collection[frozenset[str]]
) -> Members:
    """Returns the best set, or the best of the outstanding effects if that is new."""
    start = score.by_first(kinds)
    best = best_set(score, start)
    haste = HASTE * (score(best) - score(start))
    outstanding = best_set(score.for_newcomers(haste, start), start)
    is_new = frozenset(kind for kind, _ in outstanding) not in tried
    return outstanding if is_new else best


def without_late(task: Task, kept: Collection[str] = ()) -> Task:
    """Returns the task with the effects that are tried first, and those kept."""
    kinds = tuple(kind for kind in task.kinds if kind not in LATE or kind in kept)
    return dataclasses.replace(task, kinds=kinds or task.kinds)


def search_about(
    candidates: Candidates, grams: np.ndarray, counts: np.ndarray
) -> tuple[FitResult, list[int]]:
    """Searches the effects of flights that count so often, in closed form.

    Returns:
        the model with their coefficients, all else as it is, and their columns.
    """
    is_of_forces = candidates.model.has_force_errors
    scorer = held_out_scorer if is_of_forces else fits.marginal_scorer
    score, scales = scorer(candidates, grams, counts), candidates.model.scales
    members = best_set(score)
    near = fits.FirstOrder(candidates=candidates, scales=scales, score=score)
    return near.begin(members), [c for _, variant in members for c in variant]
