"""Moves of a search to effects that first order misjudged, all else refitted."""

import dataclasses
import heapq
from collections.abc import Collection, Iterable, Mapping

from glider.sysid.likelihood.model_fit import STRENGTH_RANGE, FitResult
from glider.sysid.search.fits import FirstOrder, Search, without
from glider.sysid.search.pruning import without_needless_curves
from glider.sysid.search.subsets import Members, best_set, climb
from glider.sysid.search.support import EffectSupport, shown_by


def with_a_shaped_one(search: Search, model: FitResult) -> FitResult | None:
    """Returns a model worth more with an effect that first order undervalues, or None.

    An effect with shape coefficients is linearized at a few shapes of a grid; several
    others that imitate it are linearized at their best. Each such effect is forced in
    where the model needs curves beside its formulas.
    """
    task = search.task
    if len(model.kinds) < 3 or not without_needless_curves(search, model).has_curves:
        return None
    shaped = [k for k in task.kinds if any(map(task.is_shape, task.layout.slots_of(k)))]
    return with_forced(search, model, shaped)


def with_weaker_curves(search: Search, model: FitResult) -> FitResult | None:
    """Returns a model worth more whose effects explain what its curves did, or None.

    Curves as strong as they had to be without an effect leave no error to explain.
    """
    weakest, _ = STRENGTH_RANGE
    if model.strength <= weakest or not model.has_curves:
        return None
    weaker = dataclasses.replace(model, strength=weakest)
    return _best_about(search, model, weaker)


def with_forced(
    search: Search, model: FitResult, kinds: Collection[str]
) -> FitResult | None:
    """Returns the best model with one of some effects forced in, or None.

    The best set that a climb finds around each of them is fitted.
    """
    near = search.near(model)
    if near is None:
        return None
    score = near.score
    own = score.by_first(model.kinds)
    sets = []
    for kind in kinds:
        if kind in model.kinds or kind not in score.variants:
            continue
        members = [(kind, variant) for variant in score.variants[kind]]
        best = max((climb(score, (*own, m), keep=[m]) for m in members), key=score)
        if score(best) >= score(own) - UNDERVALUED:
            sets.append(best)
    return _best_fitted(search, model, near, sets)


UNDERVALUED = 30.0
"""Evidence, to first order, that a forced effect may cost [nats]."""


def left_of_many(search: Search, model: FitResult) -> FitResult | None:
    """Returns a model worth more that remains when too many effects are thinned out.

    An effect that stands in for others hides them. With a few effects more than reach
    their thresholds, all refitted, the stand-ins turn out to be needless.
    """
    near = search.near(model)
    if near is None:
        return None
    free = near.score.with_penalty(lambda kind: 0.0)
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
        thinner = _thinner(search, thinner)
    is_better = search.penalized_cost(best) < search.penalized_cost(model)
    return best if is_better and set(best.kinds) != own else None


FEW_MORE = 4
"""Effects that are added to a model before it is thinned out."""


def _thinner(search: Search, model: FitResult) -> FitResult | None:
    """Returns a model worth more without an effect that seems to do least, or None."""
    shown = shown_by(search.task, model)
    for kind in heapq.nsmallest(MOST_TRIED, shown, key=shown.__getitem__):
        search.progress(f"is {kind} needed?")
        fewer = search.fit(without(search.task, model, kind), iterations=4)
        if search.penalized_cost(fewer) < search.penalized_cost(model):
            return fewer
    return None


def with_another(
    search: Search, model: FitResult, dropped: Collection[str]
) -> FitResult | None:
    """Returns a model worth more with one effect more, or None.

    An effect may show once another that stood in for it was dropped.
    """
    near = search.near(model)
    if near is None:
        return None
    score = near.score
    own = score.by_first(model.kinds)
    larger = [m for m in score.larger(own) if m[-1][0] not in dropped]
    best = max(larger, key=score, default=own)
    if not score(best) > score(own):
        return None
    return _best_fitted(search, model, near, [best])


def with_a_rival(
    search: Search, model: FitResult, weighed: Mapping[str, EffectSupport]
) -> FitResult | None:
    """Returns a model worth more with a rival in an effect's place, or None.

    To first order rivals do as well as an effect; refitted, one may do better. The
    nearest rivals are tried, of effects that resampled flights do not always choose.
    """
    doubtful = [k for k, w in weighed.items() if w.rivals and w.inclusion < SURE]
    near = search.near(model) if doubtful else None
    if near is None:
        return None
    score = near.score
    own = score.by_first(model.kinds)
    sets: list[Members] = []
    for kind in doubtful:
        rest = tuple(m for m in own if m[0] != kind)
        rivals = score.among(weighed[kind].rivals)
        sets += heapq.nlargest(MOST_TRIED, rivals.larger(rest), key=score)
    return _best_fitted(search, model, near, sets)


SURE = 0.95
"""Share of resampled flights above which an effect's rivals are not tried."""

MOST_TRIED = 3
"""Rivals that are fitted in an effect's place at most, or effects omitted in turn."""


def _best_about(search: Search, model: FitResult, about: FitResult) -> FitResult | None:
    """Returns the best set about another model, to first order, if worth more."""
    near = search.near(about)
    if near is None:
        return None
    members = best_set(near.score, near.score.by_first(about.kinds))
    return _best_fitted(search, model, near, [members])


def _best_fitted(
    search: Search, model: FitResult, near: FirstOrder, sets: Iterable[Members]
) -> FitResult | None:
    """Returns the best of the sets not fitted yet, if worth more, or None."""
    tried = []
    for members in sets:
        kinds = frozenset(kind for kind, _ in members)
        if kinds in search.fitted:
            continue
        others = ", ".join(sorted(kinds.difference(model.kinds)))
        search.progress(f"{others} after all?")
        tried.append(search.fit_with_strength(near.begin(members), iterations=4))
    best = min(tried, key=search.penalized_cost, default=model)
    return best if search.penalized_cost(best) < search.penalized_cost(model) else None
