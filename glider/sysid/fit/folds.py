"""Flights held out in folds: what a correction gains on flights that it has not seen.

All is linear about the models that were fitted, so that those made without some flights
follow in closed form from the flights' information (`LinearFlights`). `hold_out`
searches effects again without each part of the flights, and compares the costs of the
flights by the models made without them: their `Gains`.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import stdtrit

from glider.compiled.parallel import in_parallel
from glider.physics.confidence import LEVEL
from glider.sysid.constants import FOLDS
from glider.sysid.fit.prediction import near_median
from glider.sysid.likelihood.candidates import gather_in_parts
from glider.sysid.likelihood.filtering import whiten
from glider.sysid.likelihood.information import solve_scaled
from glider.sysid.likelihood.model_fit import error_flights, in_surroundings
from glider.sysid.likelihood.task import FitResult, Task
from glider.sysid.search.subsets import climb, columns_of, scorer_of


@dataclasses.dataclass(frozen=True, kw_only=True)
class Gains:
    """Log-likelihood that a correction gains on flights that played no part in it.

    Attributes:
        values: (F,) gain on each flight [nats]; NaN where no model flies it.
    """

    values: np.ndarray

    @property
    def t(self) -> float:
        """Student's t of the mean over all flights, each held near the median."""
        if len(self.values) < 2:
            return 0.0
        held = near_median(np.nan_to_num(self.values))
        error = np.std(held, ddof=1) / np.sqrt(len(held))
        return float(np.mean(held) / max(error, 1e-12))

    @property
    def least_t(self) -> float:
        """Student's t within which so many gains of nothing are, with LEVEL."""
        freedom = len(self.values) - 1
        if freedom < 1:
            return np.inf
        return float(stdtrit(freedom, 0.5 * (1.0 + LEVEL)))

    @property
    def are_significant(self) -> bool:
        """Whether the correction gains beyond chance."""
        return self.t >= self.least_t


class HeldOut(NamedTuple):
    """What flights say that played no part in the models.

    Attributes:
        gains: of the corrected model over each other one, by name.
        chosen: effects that are found without each part of the flights.
    """

    gains: dict[str, Gains]
    chosen: list[set[str]]

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

    The effects of the corrected model are searched again without the flights, among
    the task's formulas; of the others all coefficients are refitted.

    Args:
        task: on the flights, with the effects that may be found.
        corrected: the model with effects that was fitted to them.
        others: models that it is compared with, by name.
        rng: deals the flights to the parts.
    """
    count = len(task.records)
    order = rng.permutation(count)
    parts = [np.sort(order[k::FOLDS]).tolist() for k in range(min(FOLDS, count))]

    # What is found without each part, and the columns of the models' coefficients.
    linear = LinearFlights(task, corrected)
    chosen = []
    columns = []
    for part in parts:
        score = scorer_of(linear.candidates, np.delete(linear.grams, part, axis=0))
        members = climb(score, score.by_first(corrected.kinds))
        chosen.append({kind for kind, _ in members})
        columns.append([*linear.candidates.always, *columns_of(members)])

    costs = linear.costs(parts, columns)
    gains = {}
    for name, model in others.items():
        other = LinearFlights(task.offering(()), model)
        every = range(len(other.prior.mean))
        costs_of_other = other.costs(parts, [every] * len(parts))
        gains[name] = Gains(values=costs_of_other - costs)

    return HeldOut(gains, chosen)


class LinearFlights:
    """Flights about a model that was fitted to them, or to others.

    Attributes:
        constant: (F,) what of each flight's cost depends on the scales alone [nats].
        candidates: the effects of the task about the model.
        grams: (F, M + 1, M + 1) information of each flight.
        prior: of the M columns' changes from nothing.
    """

    def __init__(self, task: Task, model: FitResult):
        flights = error_flights(task, model)
        model = in_surroundings(task, model, flights)
        # The likelihood is a square of changes and what depends on the scales alone.
        volumes = in_parallel(
            lambda f: whiten(f, model.scales).log_variances.sum(), flights
        )
        self.constant = 0.5 * np.array(volumes)
        del flights  # Before there are others.
        self.candidates, self.grams = gather_in_parts(task, model, model.scales)
        _, self.prior = self.candidates.nothing()

    def costs(
        self, parts: Sequence[list[int]], columns: Sequence[Sequence[int]]
    ) -> np.ndarray:
        """Returns the cost (F,) of each flight by a model made without its part [nats].

        By the predictive distribution: what the other flights leave unknown of the
        coefficients counts with the noise, so that a flight beyond their range is not
        held against a model that does not know it. That is what the flight adds to the
        others' evidence. Coefficients have no bounds here.

        Args:
            parts: indices of the flights in each; a flight is in one part.
            columns: those that the model made without each part has.
        """
        costs = np.empty(len(self.grams))
        for part, some in zip(parts, columns, strict=True):
            keep = [*some, -1]
            grams = self.grams[:, keep][:, :, keep]
            rest = grams.sum(axis=0) - grams[part].sum(axis=0)
            known = self.prior.among(keep[:-1]).added_to(rest)
            more = _evidence(known + grams[part]) - _evidence(known[None])
            costs[part] = self.constant[part] + more

        return costs


def _evidence(grams: np.ndarray) -> np.ndarray:
    """Returns negative log marginal likelihoods (n,), but for constants [nats].

    With A the information on the coefficients and b that of them and the error e, both
    with priors, it is ½ (e'e - b' A⁻¹ b + log |A|).

    Args:
        grams: (n, m + 1, m + 1) information with priors.
    """
    hessian = grams[:, :-1, :-1]
    right = grams[:, :-1, -1]
    explained = np.sum(right * solve_scaled(hessian, right, 0.0), axis=1)
    least = grams[:, -1, -1] - explained
    _, volume = np.linalg.slogdet(hessian)
    return 0.5 * (least + volume)
