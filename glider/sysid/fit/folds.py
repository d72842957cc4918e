"""Flights held out in folds: what a correction gains on flights that it has not seen.

All is linear about the models that were fitted, so that those made without some flights
follow in closed form from the flights' information.
"""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.special import ndtri, stdtrit

from glider.physics.confidence import LEVEL
from glider.sysid.constants import FOLDS
from glider.sysid.fit.prediction import near_median
from glider.sysid.likelihood.candidates import gather_in_parts
from glider.sysid.likelihood.information import counted_from, solve_scaled
from glider.sysid.likelihood.model_fit import Prior, error_flights, in_surroundings
from glider.sysid.likelihood.task import FitResult, Task
from glider.sysid.search.support import Nearby
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

    @property
    def would_suffice(self) -> bool:
        """Whether gains so large beside their scatter would show on many flights."""
        return self.t >= float(ndtri(0.5 * (1.0 + LEVEL)))


def hold_out(
    task: Task, models: Mapping[str, FitResult], rng: np.random.Generator
) -> dict[str, Gains]:
    """Holds out each flight once; returns the gains over all models but "corrected".

    The effects of the corrected model are searched again without the flights; of the
    others all coefficients are refitted.
    """
    count = len(task.records)
    order = rng.permutation(count)
    parts = [np.sort(order[k::FOLDS]) for k in range(min(FOLDS, count))]
    costs = {}
    for name, model in models.items():
        costs[name] = _unseen_costs(task, model, parts, name == "corrected")
    corrected = costs.pop("corrected")
    return {name: Gains(values=own - corrected) for name, own in costs.items()}


def _unseen_costs(
    task: Task, model: FitResult, parts: Sequence[np.ndarray], is_searched: bool
) -> np.ndarray:
    """Returns the cost of each flight by a model made without its part [nats]."""
    model = in_surroundings(task, model, error_flights(task, model))
    offered = without_late(task, model.kinds) if is_searched else task.offering(())
    candidates, grams, now = gather_in_parts(offered, model, model.scales)
    near = Nearby(candidates, grams)
    given, prior = candidates.nothing()
    # The likelihood is a square of changes and what depends on the scales alone.
    constant = now - 0.5 * grams[:, -1, -1]
    costs = np.empty(len(grams))
    for part in parts:
        counts = np.ones(len(grams))
        counts[part] = 0.0
        columns = list(range(len(prior.mean)))
        if is_searched:
            _, members = near.best(counts)
            found = [column for _, variant in members for column in variant]
            columns = [*candidates.always, *found]
        total = counted_from(np.tensordot(counts, grams, 1), given)
        others = counted_from(grams[part], given)
        costs[part] = constant[part] + _predicted(total, others, prior, columns)

    return costs


def _predicted(
    total: np.ndarray, others: np.ndarray, prior: Prior, columns: Sequence[int]
) -> np.ndarray:
    """Returns what flights cost by some columns that others determine [nats].

    By the predictive distribution: what the flights whose information is `total` leave
    unknown of the coefficients counts with the noise, so that a flight beyond their
    range is not held against a model that does not know it.
    """
    keep = [*columns, len(prior.mean)]
    own = prior.among(columns)
    change = own.best_step(total[np.ix_(keep, keep)])
    step = np.zeros(len(prior.mean))
    step[columns] = change
    is_open = (own.lower < change) & (change < own.upper)
    free = np.array(columns, dtype=int)[is_open]
    known = total[np.ix_(free, free)] + np.diag(own.precision[is_open])
    others = counted_from(others, -step)
    added = others[:, free[:, None], free]
    error = others[:, free, -1]
    more = np.sum(solve_scaled(known + added, error, 0.0) * error, axis=1)
    ratio = np.eye(len(free)) + np.linalg.solve(known, added)
    _, volume = np.linalg.slogdet(ratio)
    return 0.5 * (others[:, -1, -1] - more + volume)
