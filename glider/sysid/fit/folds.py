"""Flights held out in folds: what a correction gains on flights that it has not seen.

All is linear about the models that were fitted, so that those made without some flights
follow in closed form from the flights' information.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import stdtrit

from glider.physics.confidence import LEVEL
from glider.sysid.constants import CLEAR, FOLDS, RIVAL_GAP
from glider.sysid.fit.prediction import near_median
from glider.sysid.fit.session import find_change
from glider.sysid.likelihood.candidates import gather_in_parts
from glider.sysid.likelihood.information import counted_from, solve_scaled
from glider.sysid.likelihood.model_fit import error_flights, in_surroundings
from glider.sysid.likelihood.task import FitResult, Task
from glider.sysid.result import Change
from glider.sysid.search.subsets import Members, Scorer, climb, columns_of, scorer_of
from glider.sysid.search.tracing import without_late


@dataclasses.dataclass(frozen=True, kw_only=True)
class Gains:
    """Log-likelihood that a correction gains on flights that played no part in it."""

    values: np.ndarray  #: (flights,) of each [nats].

    @property
    def t(self) -> float:
        """Student's t of the mean over all flights, each held near the median."""
        held = np.nan_to_num(self.values)  # Of no model where it is NaN.
        if len(held) < 2:
            return 0.0
        held = near_median(held)
        error = np.std(held, ddof=1) / np.sqrt(len(held))
        return float(np.mean(held) / max(error, 1e-12))

    @property
    def least_t(self) -> float:
        """Student's t within which so many gains of nothing are, with LEVEL."""
        count = len(self.values)
        level = 0.5 * (1.0 + LEVEL)
        return float(stdtrit(count - 1, level)) if count > 1 else np.inf

    @property
    def are_significant(self) -> bool:
        """Whether the correction gains beyond chance."""
        return self.t >= self.least_t


class HeldOut(NamedTuple):
    """What flights say that played no part in the models."""

    gains: dict[str, Gains]  #: Of the corrected model over each other one, by name.
    chosen: list[set[str]]  #: Effects that are found without each part of the flights.
    alike: dict[str, set[str]]  #: Of each effect, what would do as well in its place.
    change: Change | None  #: Of the glider, that their order shows.

    def inclusion(self, kind: str) -> float:
        """Returns the share of the parts without which an effect is found."""
        is_found = [kind in own for own in self.chosen]
        return float(np.mean(is_found))


def hold_out(
    task: Task,
    corrected: FitResult,
    others: Mapping[str, FitResult],
    rng: np.random.Generator,
) -> HeldOut:
    """Holds out each flight once, in one of FOLDS parts.

    The effects of the corrected model are searched again without the flights; of the
    others all coefficients are refitted.
    """
    count = len(task.records)
    order = rng.permutation(count)
    parts = []
    for k in range(min(FOLDS, count)):
        part = np.sort(order[k::FOLDS])
        parts.append(part.tolist())

    linear = _LinearFlights(without_late(task, corrected.kinds), corrected)
    score = linear.scorer([])
    found = score.by_first(corrected.kinds)
    offered, alike = _near(score, found)
    chosen = []
    columns = []
    for part in parts:
        score = linear.scorer(part).among(offered)
        members = climb(score, found)
        chosen.append({kind for kind, _ in members})
        columns.append([*linear.candidates.always, *columns_of(members)])

    costs = linear.costs(parts, columns)
    gains = {}
    for name, model in others.items():
        other = _LinearFlights(task.offering(()), model)
        every = range(len(other.prior.mean))
        lost = other.costs(parts, [every] * len(parts))
        gains[name] = Gains(values=lost - costs)

    [of_orders] = rng.spawn(1)
    change = find_change(linear.candidates, linear.grams, linear.prior, of_orders)
    return HeldOut(gains, chosen, alike, change)


def _near(score: Scorer, found: Members) -> tuple[set[str], dict[str, set[str]]]:
    """Returns effects of sets near one, and what would do as well in place of each.

    Farther away, errors of the linearization look like effects.
    """
    kinds = {kind for kind, _ in found}
    offered = set(kinds)
    alike: dict[str, set[str]] = {kind: set() for kind in kinds}
    best = score(found)
    for other in (*score.larger(found), *score.swapped(found)):
        kind, _ = other[-1]
        lost = best - score(other)
        if lost < CLEAR:
            offered.add(kind)
        if kind not in kinds and lost < RIVAL_GAP:
            left = {name for name, _ in other}
            for gone in kinds - left:
                alike[gone].add(kind)

    return offered, alike


class _LinearFlights:
    """Flights about a model that was fitted to them, or to others."""

    def __init__(self, task: Task, model: FitResult):
        flights = error_flights(task, model)
        model = in_surroundings(task, model, flights)
        found = gather_in_parts(task, model, model.scales)
        self.candidates, self.grams, now = found
        self.given, self.prior = self.candidates.nothing()
        # The likelihood is a square of changes and what depends on the scales alone.
        self.constant = now - 0.5 * self.grams[:, -1, -1]

    def scorer(self, part: list[int]) -> Scorer:
        """Returns the evidence of sets without a part of the flights."""
        counts = np.ones(len(self.grams))
        counts[part] = 0.0
        return scorer_of(self.candidates, self.grams, counts)

    def costs(
        self, parts: Sequence[list[int]], columns: Sequence[Sequence[int]]
    ) -> np.ndarray:
        """Returns the cost of each flight by models made without its part [nats].

        The models have some of the columns, for each part. By the predictive
        distribution: what the other flights leave unknown of the coefficients counts
        with the noise, so that a flight beyond their range is not held against a model
        that does not know it.
        """
        costs = np.empty(len(self.grams))
        for part, some in zip(parts, columns, strict=True):
            own = list(some)
            rest = np.delete(self.grams, part, axis=0)
            known = counted_from(rest.sum(axis=0), self.given)

            prior = self.prior.among(own)
            keep = [*own, -1]
            change = prior.best_step(known[np.ix_(keep, keep)])
            step = np.zeros(len(self.prior.mean))
            step[own] = change

            is_open = (prior.lower < change) & (change < prior.upper)
            free = np.array(own, dtype=int)[is_open]
            hessian = known[np.ix_(free, free)]
            hessian = hessian + np.diag(prior.precision[is_open])
            unseen = counted_from(self.grams[part], self.given - step)
            added = unseen[:, free[:, None], free]
            error = unseen[:, free, -1]
            moved = solve_scaled(hessian + added, error, 0.0)
            more = np.sum(moved * error, axis=1)
            grown = np.eye(len(free)) + np.linalg.solve(hessian, added)
            _, volume = np.linalg.slogdet(grown)
            left = unseen[:, -1, -1] - more + volume
            costs[part] = self.constant[part] + 0.5 * left

        return costs
