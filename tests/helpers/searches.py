"""Searches for effects in a few simulated flights."""

import dataclasses
from collections.abc import Sequence

from glider.physics.effects.effect import Effect
from glider.sysid.likelihood.held_out import HeldOutEvidence
from glider.sysid.likelihood.information import Evidence
from glider.sysid.likelihood.task import FitResult
from glider.sysid.search.moves import Search
from tests.helpers.tasks import begin, fly, task_of


def search_among(effect: Effect, *offered: str) -> tuple[Search, FitResult]:
    """Returns a search among some kinds in flights of an effect, and the plate."""
    task, noise = task_of(fly(effect, flights=5))
    task = dataclasses.replace(task, kinds=offered)
    return Search(task, lambda text: None), begin(task, noise)


def gain_of(evidence: Evidence | HeldOutEvidence, columns: Sequence[int]) -> float:
    """Returns what a set of columns gains over none [nats]."""
    [gain] = evidence.extended(columns, [()])
    return gain


def kinds_fitted(search: Search, plate: FitResult, *kinds: str) -> FitResult:
    """Returns the plate with some effects, fitted."""
    start = dataclasses.replace(plate, kinds=kinds, free=search.task.free(kinds))
    return search.fit(start)
