"""Moves from one set of effects to a better one, everything refitted.

A move returns a model that is worth more, or None. It proposes sets by closed forms,
to first order about the model, and fits what it proposes.
"""

import dataclasses
import heapq
from collections.abc import Callable, Iterator

import numpy as np

from glider.physics.effects.families import FAMILIES
from glider.sysid.constants import CLEAR, FOLLOWED, MOST_EFFECTS, SLACK, Z
from glider.sysid.likelihood.filtering import PER_FLIGHT, flight_values
from glider.sysid.likelihood.model_fit import error_flights
from glider.sysid.likelihood.task import FitResult
from glider.sysid.search.subsets import Members, best_of_sizes, climb
from glider.sysid.search.support import Search

_Move = Callable[[Search, FitResult], FitResult | None]


def _best(search: Search, model: FitResult) -> FitResult | None:
    """The best set about a model.

    Errors of the linearization look like small effects, in proportion to the gain: the
    smallest set that reaches most of it comes first.
    """
    if (score := search.near(model)) is None:
        return None
    start = score.by_first(model.kinds)
    sizes = best_of_sizes(score)
    members = climb(score, max([climb(score, start), *sizes], key=score))
    if len(members) < MOST_EFFECTS:  # One may stand for two.
        members = climb(score, max([members, *score.parted(members)], key=score))
    enough = score(members) - SLACK * (score(members) - score(start))
    outstanding = next((m for m in sizes if score(m) >= enough), members)
    return search.better(model, score, [outstanding, members], first=True)


def _pruned(search: Search, model: FitResult) -> FitResult | None:
    """The model without effects that do not reach their thresholds."""
    if (near := search.near(model)) is None:
        return None
    lost = near.lost(near.by_first(model.kinds))
    found = model
    for kind in sorted(lost, key=lost.__getitem__):
        if lost[kind] > CLEAR:
            break
        fewer = search.fit_without(found, kind)
        found = fewer if search.prefers(fewer, found) else found
    return None if found is model else found


def one_less(search: Search, model: FitResult) -> dict[str, FitResult]:
    """Returns the models without each of the effects, all else refitted."""
    return {kind: search.fit_without(model, kind) for kind in model.kinds}


def _with_mean(search: Search, model: FitResult) -> FitResult | None:
    """The model with the mean of per-flight constants that is not zero."""
    task = search.task
    own = flight_values(error_flights(task, model), model.scales)
    mean = own.mean(axis=0)
    error = own.std(axis=0) / np.sqrt(len(own))
    is_off = np.abs(mean) > Z * error
    for kind, places in PER_FLIGHT.items():
        slots = list(task.space.slots_of(kind))
        is_free = bool(set(slots) & set(model.free))
        if kind not in task.kinds or is_free or not is_off[places].any():
            continue
        theta = model.theta.copy()
        shift = np.zeros(len(mean))
        theta[slots] += mean[places]
        shift[places] = mean[places]
        other = dataclasses.replace(
            model.with_kinds(task, (*model.kinds, kind), theta),
            about={
                name: own._replace(constants=own.constants - shift)
                for name, own in model.about.items()
            },
        )
        other = search.fit(other, f"{kind} in all flights?")
        if search.prefers(other, model):
            return other

    return None


def _renamed(search: Search, model: FitResult) -> FitResult | None:
    """The model with formulas in the place of a free function that they explain.

    Formulas are names where they are worth at least as much as the free function, or
    as they are with what it adds to them.
    """
    if not model.free_kinds or (near := search.near(model)) is None:
        return None
    own = near.by_first(model.kinds)
    for function in model.free_kinds:
        score = near.among(set(FAMILIES[function].formulas))
        rest = tuple(member for member in own if member[0] != function)
        options = [max(score.larger(s), key=score, default=s) for s in (rest, own)]
        if found := search.better(model, near, options):
            return found

    return None


def _with_another(search: Search, model: FitResult) -> FitResult | None:
    """The model with an effect that first order undervalues, added or exchanged."""
    if (score := search.near(model)) is None:
        return None
    own = score.by_first(model.kinds)

    def by_kind() -> Iterator[Members]:
        found: dict[str, Members] = {}
        for other in (*score.larger(own), *score.swapped(own)):
            kind = other[-1][0]
            found[kind] = max(found.get(kind, other), other, key=score)

        for members in found.values():
            if score(members) > score(own) - CLEAR:
                yield members

    few = heapq.nlargest(FOLLOWED, by_kind(), key=score)
    return search.better(model, score, few)


def _reshaped(search: Search, model: FitResult) -> FitResult | None:
    """The model with the shapes of a formula searched again, its effect removed first.

    A fit keeps near the shapes that its formula began with, and at a bound that it met.
    What else was found acts; no move before this one found that anything is missing.
    """
    task = search.task
    for kind in model.kinds:
        has_shape = not task.space.shapes.isdisjoint(task.space.slots_of(kind))
        tried = kind, frozenset(model.kinds)
        if not has_shape or tried in search.reshaped:
            continue
        search.reshaped.add(tried)
        fewer = search.fit_without(model, kind)
        if (near := search.compare(fewer, {kind, *fewer.kinds})) is None:
            continue
        rest = near.by_first(fewer.kinds)
        if options := near.larger(rest):
            other = near.begin(max(options, key=near))
            words = f"{kind} with other shapes?"
            other = search.fit(other, words, rival=model, again=True)
            if search.penalized_cost(other) < search.penalized_cost(model):
                return other

    return None


MOVES: dict[str, _Move] = {
    "best set": _best,
    "mean over flights": _with_mean,
    "prune": _pruned,
    "formula of a free function": _renamed,
    "another effect": _with_another,
    "other shapes": _reshaped,
}
"""Tried in turn until none finds a model that is worth more."""
