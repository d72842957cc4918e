"""Moves of a search to sets that first order misjudged, all else refitted."""

import dataclasses
import heapq
from collections.abc import Collection, Iterable, Mapping
from itertools import combinations

import numpy as np

from glider.sysid.likelihood.blocks import BLOCKS, CURVES
from glider.sysid.likelihood.information import solve_scaled
from glider.sysid.likelihood.model_fit import STRENGTH_RANGE, FitResult, error_flights
from glider.sysid.likelihood.scales import PER_FLIGHT, flight_values
from glider.sysid.likelihood.task import Task
from glider.sysid.likelihood.uncertainty import uncertainty_of
from glider.sysid.search.fits import SIMPLE_MOMENT, FirstOrder, Search, without
from glider.sysid.search.subsets import Members, Scorer, best_of_sizes, best_set, climb
from glider.sysid.search.support import EffectSupport

OPPOSED = 0.7  # Correlation of two effects' coefficients above which they may cancel.
WEAK = 3000.0  # Evidence above which means cannot replace all effects [nats].
FAR = 300.0  # Loss of a smaller set up to which still smaller ones are tried [nats].
SLACK = 0.1  # Share of the evidence that a smaller set may lack, to first order.
CURVE_THRESHOLD = 15.0  # Evidence that curves beside the formulas must bring [nats].
OFF = 5.0  # Standard errors by which a mean over flights is off zero.
UNDERVALUED = 30.0  # Evidence, to first order, that a forced effect may cost [nats].
FEW_MORE = 4  # Effects that are added to a model before it is thinned out.
MOST_TRIED = 3  # Rivals fitted in an effect's place at most, or effects omitted.
SURE = 0.95  # Share of resampled flights above which an effect's rivals are not tried.


def prune(search: Search, model: FitResult) -> tuple[FitResult, dict[str, float]]:
    """Drops the effects that do not reach their thresholds when all else is refitted.

    Returns:
        the model, and the evidence of each effect that stays [nats].
    """
    while True:
        fewer, lost = _without_the_weakest(search, model)
        fewer = fewer or _without_a_pair(search, model)
        if fewer is None:
            return model, lost
        model = fewer


def _without_the_weakest(
    search: Search, model: FitResult, most: int | None = None
) -> tuple[FitResult | None, dict[str, float]]:
    """Returns a model worth more without one of the weakest, or None, and evidence."""
    lost, shown = {}, shown_by(search.task, model)
    for kind in sorted(shown, key=shown.__getitem__)[:most]:
        search.progress(f"is {kind} needed?")
        fit = search.fit_with_strength if kind in model.free_kinds else search.fit
        fewer = fit(without(search.task, model, kind), iterations=4)
        if search.prefers(fewer, model):
            return fewer, {}
        lost[kind] = fewer.cost + fewer.freedom - model.cost - model.freedom
    return None, lost


def shown_by(task: Task, model: FitResult) -> dict[str, float]:
    """Returns the evidence of each effect beside the others, by Wald's test [nats].

    Half of c' C⁻¹ c, of an effect's sizes c and their covariance C.
    """
    known, found = uncertainty_of(task, model), {}
    places_of_blocks = model.places()
    for kind in model.kinds:
        if kind in places_of_blocks:
            places = list(places_of_blocks[kind])
            value = model.coordinates[np.array(places) - len(model.free)]
        else:
            slots = [i for i in task.layout.slots_of(kind) if i in known.free]
            slots = [i for i in slots if not task.is_shape(i)] or slots
            places = [known.free.index(i) for i in slots]
            value = model.theta[slots] - task.vehicle.theta[slots]
        block, _ = known.of(places)
        found[kind] = 0.5 * float(value @ solve_scaled(block, value, 0.0))
    return found


def _without_a_pair(search: Search, model: FitResult) -> FitResult | None:
    """Returns the model without two effects that only work against each other.

    Two that nearly cancel may imitate a shape; strong enough curves do better.
    """
    if not model.has_curves or len(model.kinds) < 3:
        return None
    for first, second in _opposed_pairs(search.task, model):
        search.progress(f"are {first} and {second} needed?")
        fewer = without(search.task, model, first, second)
        fewer = fewer.with_curves(search.task.curves, max(model.strength, 1.0))
        for _ in range(2):
            fewer = search.fit_with_strength(fewer, iterations=4)
        if search.prefers(fewer, model):
            return fewer
    return None


def _opposed_pairs(task: Task, model: FitResult) -> list[tuple[str, str]]:
    """Returns the three pairs of effects with most correlated sizes, if opposed."""
    known, slots_of = uncertainty_of(task, model), task.layout.slots_of
    std = np.sqrt(np.diag(known.likelihood))
    correlation = np.abs(known.likelihood / std[:, None] / std)
    found = []
    named = [kind for kind in model.kinds if kind not in model.free_kinds]
    for pair in combinations(named, 2):
        sizes = [[i for i in slots_of(k) if not task.is_shape(i)] for k in pair]
        places = [
            [known.free.index(i) for i in own if i in known.free] for own in sizes
        ]
        largest = correlation[np.ix_(*places)].max(initial=0.0)
        if largest > OPPOSED:
            found.append((largest, *pair))
    return [(first, second) for _, first, second in heapq.nlargest(3, found)]


def with_fewer(search: Search, model: FitResult) -> FitResult | None:
    """Returns a model with fewer effects that is worth more, or None.

    The best set of each smaller size is fitted, at last the flat plate with the means
    over all flights: to first order, several effects may do as well as the true few.
    """
    near = search.near(model) if len(model.kinds) > 1 else None
    if near is None:
        return None
    score = near.score
    sizes = best_of_sizes(score)[: len(model.kinds) - 1]
    if not sizes:
        return None
    gain = score(sizes[-1]) - score(())
    for members in reversed(sizes):
        kinds = frozenset(kind for kind, _ in members)
        if kinds in search.fitted or score(members) < score(sizes[-1]) - SLACK * gain:
            continue
        search.progress(f"fitting {', '.join(sorted(kinds))} instead")
        fewer = search.fit_with_strength(near.begin(members), iterations=4)
        lost = search.penalized_cost(fewer) - search.penalized_cost(model)
        if lost < 0.0:
            return fewer
        if lost > FAR:
            break
    if frozenset() in search.fitted or gain > WEAK:
        return None
    search.progress("fitting the flat plate instead")
    fewer = search.fit_with_strength(near.begin(()), iterations=4)
    fewer = with_means(search, fewer)
    return fewer if search.prefers(fewer, model) else None


def without_needless_curves(search: Search, model: FitResult) -> FitResult:
    """Returns the model without its curves, unless they reach their threshold."""
    if not model.has_curves:
        return model
    search.progress("are curves needed?")
    bare = search.fit_with_strength(model.without_blocks(CURVES), iterations=4)
    gained = bare.cost + bare.freedom - model.cost - model.freedom
    return model if gained > CURVE_THRESHOLD else bare


def with_means(search: Search, model: FitResult) -> FitResult:
    """Returns a model with the mean of per-flight constants, where it is not zero."""
    task = search.task
    own = flight_values(error_flights(task, model), model.scales)
    mean, error = own.mean(axis=0), own.std(axis=0) / np.sqrt(len(own))
    is_off = np.abs(mean) > OFF * error
    for kind in dict(PER_FLIGHT):
        slots = list(task.layout.slots_of(kind))
        places = [k for k, (other, _) in enumerate(PER_FLIGHT) if other == kind]
        is_free = bool(set(slots) & set(model.free))
        if kind not in task.kinds or is_free or not is_off[places].any():
            continue
        theta, kinds = model.theta.copy(), (*model.kinds, kind)
        theta[slots] += mean[places]
        if frozenset(kinds) in search.fitted:
            continue
        search.progress(f"{kind} in all flights?")
        free = task.free(kinds)
        other = dataclasses.replace(model, kinds=kinds, theta=theta, free=free)
        other = search.fit_with_strength(other, iterations=4)
        if search.prefers(other, model):
            model = other
    return model


def with_a_shaped_one(search: Search, model: FitResult) -> FitResult | None:
    """Returns a model worth more with an effect that first order undervalues, or None.

    Its shapes are those of a grid; others that imitate it are linearized at their best.
    Each such effect is forced in where the model needs curves beside its formulas.
    """
    task = search.task
    if len(model.kinds) < 3 or not without_needless_curves(search, model).has_curves:
        return None
    shaped = [k for k in task.kinds if any(map(task.is_shape, task.layout.slots_of(k)))]
    return with_forced(search, model, shaped)


def with_weaker_curves(search: Search, model: FitResult) -> FitResult | None:
    """Returns a model worth more whose effects explain what its curves did, or None."""
    weakest, _ = STRENGTH_RANGE
    if model.strength <= weakest or not model.has_curves:
        return None
    weak = model.with_curves(search.task.curves, weakest)
    return _best_about(search, model, weak)


def _best_about(search: Search, model: FitResult, about: FitResult) -> FitResult | None:
    """Returns the best set about another model, to first order, if worth more."""
    return search.improved(model, lambda score, own: [best_set(score, own)], about)


def with_forced(
    search: Search, model: FitResult, kinds: Collection[str]
) -> FitResult | None:
    """Returns the best model with a set around one of some effects, or None."""

    def around_each(score: Scorer, own: Members) -> Iterable[Members]:
        for kind in score.variants:
            if kind in model.kinds or kind not in kinds:
                continue
            members = [(kind, variant) for variant in score.variants[kind]]
            best = max((climb(score, (*own, m), keep=[m]) for m in members), key=score)
            if score(best) >= score(own) - UNDERVALUED:
                yield best

    return search.improved(model, around_each)


def left_of_many(search: Search, model: FitResult) -> FitResult | None:
    """Returns a model worth more that remains when too many effects are thinned out.

    Beside a few effects more, all refitted, those that stand in for others turn out to
    be needless.
    """
    near = search.near(model) if leaves_a_form(model) else None
    if near is None:
        return None
    free = near.score.with_penalty(lambda kind, kinds: 0.0)
    members = free.by_first(model.kinds)
    for _ in range(FEW_MORE):
        members = max(free.larger(members), key=free, default=members)
    more = ", ".join(kind for kind, _ in members[len(model.kinds) :])
    search.progress(f"with {more} beside them?")
    many = search.fit_with_strength(near.begin(members), iterations=4)
    best = _best_about(search, model, many) or model
    own = set(model.kinds)
    thinner: FitResult | None = many
    while thinner and thinner.cost + thinner.freedom < model.cost + model.freedom:
        best = min(best, thinner, key=search.penalized_cost)
        if set(thinner.kinds) <= own:  # Where the search has been.
            break
        thinner, _ = _without_the_weakest(search, thinner, MOST_TRIED)
    return best if search.prefers(best, model) and set(best.kinds) != own else None


def leaves_a_form(model: FitResult) -> bool:
    """Whether a model leaves more than moving air does: errors of its formulas."""
    return model.scales.moment > SIMPLE_MOMENT or model.strength > 0.5


def with_another(
    search: Search, model: FitResult, dropped: Collection[str]
) -> FitResult | None:
    """Returns a model worth more with one more effect that was not dropped, or None."""

    def larger(score: Scorer, own: Members) -> list[Members]:
        options = [m for m in score.larger(own) if m[-1][0] not in dropped]
        best = max(options, key=score, default=own)
        return [best] if score(best) > score(own) else []

    return search.improved(model, larger)


def with_a_rival(
    search: Search,
    model: FitResult,
    weighed: Mapping[str, EffectSupport],
    sure: float = SURE,
) -> FitResult | None:
    """Returns a model worth more with a rival in an effect's place, or None.

    The nearest rivals are refitted, of effects that draws do not always choose.
    """
    doubtful = [k for k, w in weighed.items() if w.rivals and w.inclusion < sure]

    def rivals(score: Scorer, own: Members) -> Iterable[Members]:
        for kind in doubtful:
            rest = tuple(m for m in own if m[0] != kind)
            others = score.among(weighed[kind].rivals)
            yield from heapq.nlargest(MOST_TRIED, others.larger(rest), key=score)

    return search.improved(model, rivals) if doubtful else None


def with_blocks(search: Search, model: FitResult) -> FitResult | None:
    """Returns a model worth more with free functions, or None.

    Several effects may imitate one of another form: free functions join the search,
    beside effects and in their place.
    """
    near = search.near(model, with_blocks=True)
    if near is None:
        return None
    own = near.score.by_first(model.kinds)
    proposals = {best_set(near.score, own), best_set(near.score)}
    tried = []
    for members in proposals:
        kinds = frozenset(kind for kind, _ in members)
        if kinds == set(model.kinds) or not kinds & search.task.blocks.keys():
            continue
        search.progress(f"{', '.join(sorted(kinds))} instead?")
        other = search.fit_with_strength(near.begin(members), iterations=4)
        tried.append(prune(search, search.fit_with_strength(other))[0])
    best = min(tried, key=search.penalized_cost, default=model)
    if set(best.kinds) == set(model.kinds) or not search.prefers(best, model):
        return None
    return named(search, best)


def named(search: Search, model: FitResult) -> FitResult:
    """Returns a model with formulas in the place of free functions that they explain.

    A formula is a name where it is worth at least as much as the free function.
    """
    for block in model.free_kinds:
        tried = []
        for kind, (near, members) in _by_formulas(search, model, block).items():
            search.progress(f"is {block} {kind}?")
            tried.append(search.fit_with_strength(near.begin(members)))
        best = min(tried, key=search.penalized_cost, default=model)
        model = best if search.prefers(best, model) else model
    return model


def families_of(search: Search, model: FitResult) -> dict[str, str]:
    """Returns the formula that is nearest to each free function that has a family."""
    found = {}
    for block in model.free_kinds:
        scores = {
            kind: near.score(members)
            for kind, (near, members) in _by_formulas(search, model, block).items()
        }
        if scores:
            found[block] = max(scores, key=scores.__getitem__)
    return found


def _by_formulas(
    search: Search, model: FitResult, block: str
) -> dict[str, tuple[FirstOrder, Members]]:
    """Returns the sets with a formula of its family in the place of a block."""
    near, found = search.near(model), {}
    if near is None:
        return {}
    rest = [m for m in near.score.by_first(model.kinds) if m[0] != block]
    for kind in BLOCKS[block].formulas:
        variants = near.score.variants.get(kind, ())
        if variants and kind not in model.kinds:
            options = [(*rest, (kind, variant)) for variant in variants]
            found[kind] = near, max(options, key=near.score)
    return found


# Tried in turn until none finds a model that is worth more.
MOVES = (with_blocks, with_fewer, with_weaker_curves, with_a_shaped_one, left_of_many)
