"""What throws will tell: expected evidence between explanations, before they are flown.

A throw is flown by one explanation i without noise and filtered by another, j, as a
log would be. Its whitened innovations e are linear in j's free numbers,
    e - X δ,   with δ ~ N(0, A_j⁻¹) as the flights so far leave them,
so N throws are expected to cost j, against i,
    Δ_ij = ½ min_δ (Σ |e - X δ|² + δ' A_j δ)   [nats],
and the log of their Bayes factor is N(Δ_ij, 2 Δ_ij), with the noise of the sensors, the
moving air and what differs from flight to flight in it. As Σ runs over squares of
columns, a throw's Gram matrix is all that is kept. (T-optimality with nuisance
parameters: Atkinson and Fedorov, Biometrika 62, 1975; expected evidence: Box and Hill,
Technometrics 9, 1967.)
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from scipy.stats import norm

from glider.campaign.logs import Campaign, Flight
from glider.compiled.parallel import in_parallel
from glider.design.explanations import Explanation
from glider.design.throws import Range, Throw, is_safe, log_of
from glider.sysid.likelihood.directions import slopes
from glider.sysid.likelihood.linear_flight import linearize
from glider.sysid.likelihood.model_fit import field_of
from glider.sysid.likelihood.scales import start_variances, whiten
from glider.sysid.likelihood.task import Task
from glider.sysid.replay.noise import Noise
from glider.sysid.replay.record import Record, prepare

Grams = dict[tuple[int, int], np.ndarray]
"""Of explanation i, which is true, and j, which filters: (m_j + 1, m_j + 1)."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Foresight:
    """Foresees throws under the explanations of a campaign.

    Attributes:
        campaign: whose clocks count.
        task: its flights.
        noise: of its sensors.
        explanations: the most probable first.
        place: where throws are flown.
        maps: that smooth logs, by their times: kept from one call to the next.
    """

    campaign: Campaign
    task: Task
    noise: Noise
    explanations: tuple[Explanation, ...]
    place: Range
    maps: dict[bytes, list[np.ndarray]] = dataclasses.field(
        default_factory=dict, repr=False
    )

    def logs(self, throws: Sequence[Throw]) -> list[list[Record]]:
        """Returns the records of throws by each explanation, one list a throw.

        Throws of one duration share their smoothing.
        """
        task, layout = self.task, self.task.layout
        fields = [field_of(task, e.model) for e in self.explanations]

        def fly(throw: Throw) -> list[Flight]:
            return [
                log_of(throw, self.place, layout, e.model.theta, field)
                for e, field in zip(self.explanations, fields, strict=True)
            ]

        flights = in_parallel(fly, throws)
        finite = [f for own in flights for f in own if np.all(np.isfinite(f.pose))]
        made = iter(prepare(finite, self.campaign, self.noise, layout, maps=self.maps))
        return [
            [next(made) for f in own if np.all(np.isfinite(f.pose))] for own in flights
        ]

    def safe(self, throws: Sequence[Throw], logs: Sequence[list[Record]]) -> list[bool]:
        """Returns whether each throw keeps the limits by every explanation."""
        limits = self.place.limits
        fields = [field_of(self.task, e.model) for e in self.explanations]

        def check(pair: tuple[Throw, list[Record]]) -> bool:
            throw, own = pair
            return len(own) == len(self.explanations) and all(
                is_safe(throw, record, e.model.theta, field, limits)
                for record, e, field in zip(own, self.explanations, fields, strict=True)
            )

        return in_parallel(check, zip(throws, logs, strict=True))

    def grams(self, logs: Sequence[list[Record]]) -> list[Grams]:
        """Returns what throws will tell, from their records by each explanation."""
        task = self.task
        parts = []
        for e in self.explanations:
            directions = slopes(task.layout, e.model.theta, e.model.free)
            parts.append((e.model, field_of(task, e.model), directions))

        def foresee(own: list[Record]) -> Grams:
            found = {}
            for i, record in enumerate(own):
                for j, (model, field, directions) in enumerate(parts):
                    flight = linearize(record, model.theta, field, directions)
                    found[i, j] = whiten(flight, model.scales).gram
            return found

        return in_parallel(foresee, logs)

    def distances(self, grams: Grams) -> np.ndarray:
        """Returns Δ (n, n): what j is expected to lose against a true i [nats]."""
        count = len(self.explanations)
        found = np.zeros((count, count))
        for (i, j), gram in grams.items():
            if i == j:
                continue
            known = gram[:-1, :-1] + self.explanations[j].precision
            found[i, j] = 0.5 * _left_over(known, gram[:-1, -1], gram[-1, -1])
        return found

    def chance(self, distances: np.ndarray) -> float:
        """Returns the probability that the best explanation will be the right one.

        Σ_i p_i Π_j Φ((log p_i / p_j + Δ_ij) / √(2 Δ_ij)).
        """
        p = np.array([e.probability for e in self.explanations])
        odds = np.log(p)[:, None] - np.log(p)
        spread = np.sqrt(2.0 * np.maximum(distances, 1e-12))
        wins = norm.cdf((odds + distances) / spread)
        np.fill_diagonal(wins, 1.0)
        # Explanations that are one to these throws leave the choice of today.
        return float(max(p @ np.prod(wins, axis=1), p.max()))

    def surprise(self, distances: np.ndarray) -> float:
        """Returns what will still be open about the explanations [nats].

        -Σ_i p_i log q_i, q_i the probability of a true i if evidence comes as expected:
        0 where all are told apart. It falls with every distance, however small.
        """
        p = np.array([e.probability for e in self.explanations])
        odds = np.log(p)[:, None] - np.log(p) + distances
        return float(p @ np.log(np.sum(np.exp(-odds), axis=1)))

    def covariance(self, grams: Grams | None = None) -> np.ndarray:
        """Returns the covariance of the best explanation's free numbers, then.

        Args:
            grams: of throws; None for today's.
        """
        precision = self.explanations[0].precision
        if grams is not None:
            precision = precision + grams[0, 0][:-1, :-1]
        scale = 1.0 / np.sqrt(np.diag(precision))
        return (
            scale[:, None] * np.linalg.inv(precision * scale[:, None] * scale) * scale
        )


def _left_over(known: np.ndarray, side: np.ndarray, total: float) -> float:
    """Returns total - side' known⁻¹ side, not negative."""
    if not len(side):
        return float(total)
    scale = 1.0 / np.sqrt(np.diag(known))
    half = np.linalg.solve(
        np.linalg.cholesky(known * scale[:, None] * scale), side * scale
    )
    return max(float(total - half @ half), 0.0)


def added(parts: Sequence[Grams]) -> Grams:
    """Returns what several throws will tell together."""
    return {key: np.sum([g[key] for g in parts], axis=0) for key in parts[0]}


def times(grams: Grams, count: float) -> Grams:
    """Returns what so many throws of one kind will tell."""
    return {key: count * gram for key, gram in grams.items()}


@dataclasses.dataclass(frozen=True, kw_only=True)
class Ending:
    """Where flights like those flown end, to first order, the launch given.

    Attributes:
        air: standard deviation of the place, by moving air and by what differs from
            flight to flight [m].
        by_numbers: (2 F, m) how x and z there move with the free numbers, over √F.
    """

    air: float
    by_numbers: np.ndarray

    def numbers(self, covariance: np.ndarray) -> float:
        """Returns the standard deviation by what is not known of the numbers [m]."""
        moved = self.by_numbers @ covariance @ self.by_numbers.T
        return float(np.sqrt(max(np.trace(moved), 0.0)))


def ending_of(task: Task, explanation: Explanation) -> Ending:
    """Returns how the ends of a task's flights spread under an explanation.

    The filter, told the launch and shown the last row alone, has the spread as the
    variance of its innovation.
    """
    model = explanation.model
    directions = slopes(task.layout, model.theta, model.free)
    field = field_of(task, model)

    def spread(record: Record) -> tuple[float, np.ndarray]:
        flight = linearize(record, model.theta, field, directions)
        start = start_variances(flight, model.scales)
        start[: flight.by_x.shape[1]] = 0.0
        variance, rows = 0.0, []
        for channel in range(2):
            seen = np.zeros_like(record.seen)
            seen[-1, channel] = True
            alone = dataclasses.replace(
                flight, record=dataclasses.replace(record, seen=seen)
            )
            filtered = whiten(alone, model.scales, start)
            own = float(np.exp(filtered.log_variances[-1, channel]))
            variance += own - model.scales.position**2
            rows.append(np.sqrt(own) * filtered.innovations[-1, channel, :-1])
        return variance, np.array(rows)

    found = in_parallel(spread, task.records)
    return Ending(
        air=float(np.sqrt(max(np.mean([v for v, _ in found]), 0.0))),
        by_numbers=np.vstack([rows for _, rows in found]) / np.sqrt(len(found)),
    )
