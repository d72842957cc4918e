"""Moves of a search to fewer effects and to means over flights, all else refitted."""

import dataclasses

import numpy as np

from glider.sysid.likelihood.model_fit import FitResult, error_flights
from glider.sysid.likelihood.scales import PER_FLIGHT, flight_values
from glider.sysid.likelihood.task import Task
from glider.sysid.likelihood.uncertainty import uncertainty_of
from glider.sysid.search.fits import Search, without
from glider.sysid.search.subsets import best_of_sizes
from glider.sysid.search.support import shown_by


def with_means(search: Search, model: FitResult) -> FitResult:
    """Returns a model with the mean of per-flight constants, where it is not zero.

    To first order a spread that absorbed the mean hides it; both are refitted.
    """
    task = search.task
    flights = error_flights(task, model)
    own = flight_values(flights, model.scales)
    mean, error = own.mean(axis=0), own.std(axis=0) / np.sqrt(len(own))
    is_off = np.abs(mean) > OFF * error
    for kind, places in PER_FLIGHT.items():
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
        if search.penalized_cost(other) < search.penalized_cost(model):
            model = other
    return model


OFF = 5.0
"""Standard errors by which a mean over flights is off zero."""


def prune(search: Search, model: FitResult) -> tuple[FitResult, dict[str, float]]:
    """Drops the effects that do not reach their thresholds when all else is refitted.

    The one that seems weakest is tried first, so that those that stay are tried once.

    Returns:
        the model, and the evidence of each effect that stays [nats].
    """
    while True:
        lost = {}
        shown = shown_by(search.task, model)
        for kind in sorted(model.kinds, key=shown.__getitem__):
            search.progress(f"is {kind} needed?")
            fewer = search.fit(without(search.task, model, kind), iterations=4)
            if search.penalized_cost(fewer) < search.penalized_cost(model):
                model = fewer
                break
            lost[kind] = fewer.cost - model.cost
        else:
            lighter = without_a_pair(search, model)
            if lighter is None:
                return model, lost
            model = lighter


def with_fewer(search: Search, model: FitResult) -> FitResult | None:
    """Returns a model with fewer effects that is worth more, or None.

    To first order about a wrong set, several effects may do as well as the true few:
    the best set of each smaller size is fitted, at last the flat plate with the means
    over all flights.
    """
    if len(model.kinds) < 2:
        return None
    near = search.near(model)
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
        lost = search.penalized_cost(fewer) - search.penalized_cost(model)
        if lost < 0.0:
            return fewer
        if lost > FAR:
            break
    if frozenset() in search.fitted or score(sizes[-1]) - score(()) > WEAK:
        return None
    search.progress("fitting the flat plate instead")
    fewer = search.fit_with_strength(near.begin(()), iterations=4)
    fewer = with_means(search, fewer)
    return (
        fewer if search.penalized_cost(fewer) < search.penalized_cost(model) else None
    )


WEAK = 3000.0
"""Evidence of all effects, to first order, above which means cannot replace them."""

FAR = 300.0
"""Evidence that a smaller set may lack, refitted, and still smaller ones are tried."""

SLACK = 0.1
"""Share of the evidence of all that a smaller set may lack, to first order."""


def without_a_pair(search: Search, model: FitResult) -> FitResult | None:
    """Returns the model without two effects that only work against each other.

    Where a formula has not quite the right shape, two effects that nearly cancel may
    imitate it; each alone then seems needed. Strong enough curves do better.
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
        if search.penalized_cost(fewer) < search.penalized_cost(model):
            return fewer
    return None


OPPOSED = 0.7
"""Correlation of two effects' coefficients above which they may cancel."""


def opposed_pairs(task: Task, model: FitResult) -> list[tuple[str, str]]:
    """Returns pairs of effects with strongly correlated coefficients."""
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


def without_needless_curves(search: Search, model: FitResult) -> FitResult:
    """Returns the model without its curves, unless they reach their threshold."""
    if not model.has_curves:
        return model
    search.progress("are curves needed?")
    bare = dataclasses.replace(model, coordinates=np.zeros(0), freedom=0.0)
    bare = search.fit(bare, iterations=4)
    gained = bare.cost - model.cost - model.freedom
    return model if gained > CURVE_THRESHOLD else bare


CURVE_THRESHOLD = 15.0
"""Evidence that curves beside the formulas must bring [nats]."""
