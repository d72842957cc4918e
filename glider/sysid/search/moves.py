"""Moves of a search from one fitted set of effects to a better one, all refitted."""

import dataclasses
import heapq
from collections.abc import Collection, Mapping

import numpy as np

from glider.sysid.likelihood.model_fit import Fitted, error_flights
from glider.sysid.likelihood.scales import OWN_VALUES, own_values
from glider.sysid.likelihood.task import Task
from glider.sysid.search.fits import Search, to_first_order
from glider.sysid.search.sets_in_models import without
from glider.sysid.search.subsets import best_of_sizes, climb
from glider.sysid.search.weighing import Weighed, uncertainty_of


def with_means(search: Search, model: Fitted) -> Fitted:
    """Returns a model with what flights have of their own, where its mean is not zero.

    To first order a spread that took up the mean hides it; both are fitted anew.
    """
    task = search.task
    flights = error_flights(task, model)
    own = own_values(flights, model.scales)
    mean, error = own.mean(axis=0), own.std(axis=0) / np.sqrt(len(own))
    is_off = np.abs(mean) > OFF * error
    for kind, places in OWN_VALUES.items():
        slots = {task.layout.index[kind, name]: k for name, k in places.items()}
        is_free = bool(set(slots) & set(model.free))
        if kind not in task.kinds or is_free or not is_off[list(slots.values())].any():
            continue
        theta = model.theta.copy()
        for slot, place in slots.items():
            theta[slot] += mean[place]
        kinds = (*model.kinds, kind)
        if model.extra is None and frozenset(kinds) in search.fitted:
            continue
        search.progress(f"{kind} in all flights?")
        other = dataclasses.replace(
            model, kinds=kinds, theta=theta, free=task.free(kinds)
        )
        other = search.fit_with_strength(other, iterations=4)
        if search.price(other) < search.price(model):
            model = other
    return model


OFF = 5.0
"""Standard errors by which a mean over flights is off zero."""


def prune(search: Search, model: Fitted) -> tuple[Fitted, dict[str, float]]:
    """Drops the effects that are not worth their price when all else is refitted.

    Returns:
        the model, and the evidence of each effect that stays [nats].
    """
    while True:
        lost = {}
        for kind in model.kinds:
            search.progress(f"is {kind} needed?")
            fewer = search.fit(without(search.task, model, kind), iterations=4)
            if search.price(fewer) < search.price(model):
                model = fewer
                break
            lost[kind] = fewer.cost - model.cost
        else:
            lighter = without_a_pair(search, model)
            if lighter is None:
                return model, lost
            model = lighter


def with_fewer(search: Search, model: Fitted) -> Fitted | None:
    """Returns a model with fewer effects that is worth more, or None.

    To first order about a set that is wrong, several effects may do as well as the few
    that act: the best set of each smaller size is fitted, at last the plate with what
    all flights have.
    """
    task = search.task
    if len(model.kinds) < 2:
        return None
    near = to_first_order(task, model)
    if near is None:
        return None
    score = near.score
    sizes = best_of_sizes(score)[: len(model.kinds) - 1]
    if not sizes:
        return None
    least = score(sizes[-1]) - SLACK * (score(sizes[-1]) - score(()))
    for members in reversed(sizes):
        kinds = frozenset(kind for kind, _ in members)
        if kinds in search.fitted or score(members) < least:
            continue
        search.progress(f"fitting {', '.join(sorted(kinds))} instead")
        fewer = search.fit_with_strength(near.begin(members), iterations=4)
        lost = search.price(fewer) - search.price(model)
        if lost < 0.0:
            return fewer
        if lost > FAR:
            break
    if frozenset() in search.fitted or score(sizes[-1]) - score(()) > WEAK:
        return None
    search.progress("fitting the plate instead")
    fewer = search.fit_with_strength(near.begin(()), iterations=4)
    fewer = with_means(search, fewer)
    return fewer if search.price(fewer) < search.price(model) else None


WEAK = 3000.0
"""Evidence of all effects, to first order, from which on they are no mere means."""

FAR = 300.0
"""Evidence that a smaller set may lack, refitted, and still smaller ones are tried."""

SLACK = 0.1
"""Share of the evidence of all that a smaller set may lack, to first order."""


def with_a_shaped_one(search: Search, model: Fitted) -> Fitted | None:
    """Returns a model worth more with an effect that first order undervalues, or None.

    An effect whose size is known and whose shape is not is made linear at a few shapes
    of a grid; several others that imitate it are made linear at their best. Each such
    effect is put in by force, where curves are needed beside the formulas: else these
    explain all there is.
    """
    task = search.task
    if len(model.kinds) < 3 or not without_needless_curves(search, model).has_curves:
        return None
    shaped = [k for k in task.kinds if any(map(task.is_shape, task.layout.slots_of(k)))]
    return with_forced(search, model, shaped)


def with_forced(search: Search, model: Fitted, kinds: Collection[str]) -> Fitted | None:
    """Returns the best model with one of some effects put in, if worth more, or None.

    Round each, the best set that a climb finds is fitted.
    """
    near = to_first_order(search.task, model)
    if near is None:
        return None
    score = near.score
    own = score.by_first(model.kinds)
    tried = []
    for kind in kinds:
        if kind in model.kinds or kind not in score.variants:
            continue
        variants = score.variants[kind]
        sets = [climb(score, (*own, (kind, v)), keep=[(kind, v)]) for v in variants]
        members = max(sets, key=score)
        is_known = frozenset(k for k, _ in members) in search.fitted
        if is_known or score(members) < score(own) - UNDERVALUED:
            continue
        search.progress(f"{kind} after all?")
        tried.append(search.fit_with_strength(near.begin(members), iterations=4))
    best = min(tried, key=search.price, default=model)
    return best if search.price(best) < search.price(model) else None


UNDERVALUED = 30.0
"""Evidence, to first order, that an effect put in by force may cost [nats]."""


def with_another(
    search: Search, model: Fitted, dropped: Collection[str]
) -> Fitted | None:
    """Returns a model worth more with one effect more, or None.

    What stood in for an effect and was dropped makes room for it.

    Args:
        search: that remembers fits.
        model: to add to.
        dropped: effects that are not asked again.
    """
    near = to_first_order(search.task, model)
    if near is None:
        return None
    score = near.score
    own = score.by_first(model.kinds)
    larger = [m for m in score.larger(own) if m[-1][0] not in dropped]
    best = max(larger, key=score, default=own)
    if not score(best) > score(own):
        return None
    search.progress(f"{best[-1][0]} instead?")
    more = search.fit_with_strength(near.begin(best), iterations=4)
    return more if search.price(more) < search.price(model) else None


def with_a_rival(
    search: Search, model: Fitted, weighed: Mapping[str, Weighed]
) -> Fitted | None:
    """Returns a model worth more with a rival in an effect's place, or None.

    To first order rivals do as well as an effect; refitted, one may do better. Only
    effects that resampled flights are not sure of are asked, and the nearest rivals.

    Args:
        search: that remembers fits.
        model: that was weighed.
        weighed: what speaks for each of its effects.
    """
    doubtful = [k for k, w in weighed.items() if w.rivals and w.inclusion < SURE]
    near = to_first_order(search.task, model) if doubtful else None
    if near is None:
        return None
    score = near.score
    own = score.by_first(model.kinds)
    tried = []
    for kind in doubtful:
        rest = tuple(m for m in own if m[0] != kind)
        rivals = score.among(weighed[kind].rivals)
        for members in heapq.nlargest(MOST_TRIED, rivals.larger(rest), key=score):
            if frozenset(k for k, _ in members) in search.fitted:
                continue
            search.progress(f"{members[-1][0]} in the place of {kind}?")
            tried.append(search.fit_with_strength(near.begin(members), iterations=4))
    best = min(tried, key=search.price, default=model)
    return best if search.price(best) < search.price(model) else None


SURE = 0.95
"""Share of resampled flights from which on an effect's rivals are not asked for."""

MOST_TRIED = 3
"""Rivals that are fitted in an effect's place at most."""


def without_a_pair(search: Search, model: Fitted) -> Fitted | None:
    """Returns the model without two effects that only work against each other.

    Where a formula has not quite the right shape, two others may be bought that nearly
    cancel; each alone then seems needed. Curves, as strong as they must be, do better.
    """
    task = search.task
    if not model.has_curves or len(model.kinds) < 3:
        return None
    for first, second in opposed_pairs(task, model):
        search.progress(f"are {first} and {second} needed?")
        fewer = without(task, model, first, second)
        fewer = dataclasses.replace(fewer, strength=max(model.strength, 1.0))
        fewer = search.fit_with_strength(fewer, iterations=4)
        fewer = search.fit_with_strength(fewer, iterations=4)
        if search.price(fewer) < search.price(model):
            return fewer
    return None


OPPOSED = 0.7
"""Correlation of two effects' coefficients from which on they may cancel."""


def opposed_pairs(task: Task, model: Fitted) -> list[tuple[str, str]]:
    """Returns pairs of effects whose coefficients are hard to tell apart."""
    known = uncertainty_of(task, model)
    std = np.sqrt(np.diag(known.covariance))
    correlation = np.abs(known.covariance / std[:, None] / std)
    slots = {
        kind: [
            known.free.index(i)
            for i in task.layout.slots_of(kind)
            if i in known.free and not task.is_shape(i)
        ]
        for kind in model.kinds
    }
    found = []
    for k, first in enumerate(model.kinds):
        for second in model.kinds[k + 1 :]:
            block = correlation[np.ix_(slots[first], slots[second])]
            if block.size and block.max() > OPPOSED:
                found.append((float(block.max()), first, second))
    return [(a, b) for _, a, b in sorted(found, reverse=True)[:3]]


def without_needless_curves(search: Search, model: Fitted) -> Fitted:
    """Returns the model without its curves, unless they are worth their price."""
    if not model.has_curves:
        return model
    search.progress("are curves needed?")
    bare = dataclasses.replace(model, coordinates=np.zeros(0), freedom=0.0)
    bare = search.fit(bare, iterations=4)
    gained = bare.cost - model.cost - model.freedom
    return model if gained > CURVE_PRICE else bare


CURVE_PRICE = 15.0
"""Evidence that curves beside the formulas must bring [nats]."""
