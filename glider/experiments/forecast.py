"""Forecasts of what throws will show, before they are flown.

A throw is flown by one explanation i without noise and filtered by every explanation k,
as a log would be. With the scales that all share, the whitened innovations of k are
    e_k + X_i δ + ν - X_k δ_k,
where δ ~ N(0, A_i⁻¹) is the error of the parameters after the flights so far,
ν ~ N(0, 1) all noise (sensors, moving air, flight-to-flight variation), and
δ_k ~ N(0, A_k⁻¹) is fitted again. So in a future (i, δ, ν) throws change the
log-evidence of k by
    -½ min_δk (|e_k + X_i δ + ν - X_k δ_k|² + δ_k' A_k δ_k)
    -½ log |1 + A_k⁻¹ X_k' X_k|,
which needs the squares of the columns alone, summed over throws. Drawn from the
posterior, the futures say how probable the right explanation will be (Box and Hill,
Technometrics 9, 1967; Lindley, Annals of Mathematical Statistics 27, 1956).
"""

import dataclasses
import functools
from collections.abc import Callable, Sequence

import numpy as np
from scipy.special import log_softmax

from glider.campaign.logs import Campaign, Flight
from glider.compiled.parallel import in_parallel
from glider.experiments.explanations import Explanation
from glider.experiments.throws import Range, Throw, is_safe, log_of, missed
from glider.sysid.likelihood.directions import slopes
from glider.sysid.likelihood.filtering import whiten
from glider.sysid.likelihood.information import solve_scaled
from glider.sysid.likelihood.linear_flight import LinearFlight
from glider.sysid.likelihood.model_fit import linear_flight, moved, prior_of
from glider.sysid.likelihood.task import FitResult, Task
from glider.sysid.replay.record import Noise, Record, prepare

Grams = tuple[np.ndarray, ...]
"""By the true explanation: products of the columns X_0, e_0, X_1, e_1, ..., (c, c)."""

_DRAWN_FUTURES = 128
"""Futures drawn of each explanation, in mirrored pairs."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Forecast:
    """Predicts throws under the explanations of a campaign.

    Attributes:
        campaign: whose clocks count.
        task: its flights.
        noise: of its sensors.
        explanations: the most probable first.
        place: where throws are flown.
    """

    campaign: Campaign
    task: Task
    noise: Noise
    explanations: tuple[Explanation, ...]
    place: Range

    @functools.cached_property
    def _models(self) -> list[FitResult]:
        """The model of each explanation, about no flight's surroundings."""
        return [dataclasses.replace(e.model, about={}) for e in self.explanations]

    @functools.cached_property
    def _filters(self) -> list[Callable[[Record], LinearFlight]]:
        """What makes a record linear about each explanation."""
        filters: list[Callable[[Record], LinearFlight]] = []

        for model in self._models:
            directions = slopes(self.task.space, model.free)
            filters.append(functools.partial(linear_flight, model, directions))

        return filters

    @property
    def probabilities(self) -> np.ndarray:
        """Of the explanations; their sum is below 1, as none of them may be right."""
        return np.array([e.probability for e in self.explanations])

    def logs(self, throws: Sequence[Throw]) -> list[list[Record]]:
        """Records of throws predicted by each explanation, one list a throw."""
        flights = [(throw, model) for throw in throws for model in self._models]
        made = self._fly(flights)
        count = len(self._models)
        found = []
        for k in range(0, len(made), count):
            own = made[k : k + count]
            found.append([record for record in own if record is not None])

        return found

    def _fly(self, flights: Sequence[tuple[Throw, FitResult]]) -> list[Record | None]:
        """Records of throws by models; None where one diverges."""
        space = self.task.space

        def fly(one: tuple[Throw, FitResult]) -> Flight:
            throw, model = one
            return log_of(throw, self.place, space, model.theta, model.gaussians)

        flown = in_parallel(fly, flights)
        finite = [bool(np.all(np.isfinite(f.pose))) for f in flown]
        whole = [f for f, ok in zip(flown, finite, strict=True) if ok]
        records = iter(prepare(whole, self.campaign, self.noise, space))
        made: list[Record | None] = []
        for ok in finite:
            record = None

            if ok:
                record = next(records)
                record = dataclasses.replace(record, usual_rest=record.rest)
            made.append(record)
        return made

    def _is_safe(self, throw: Throw, logs: list[Record]) -> bool:
        """Checks that a throw keeps the limits by every explanation."""
        limits = self.place.limits
        return len(logs) == len(self.explanations) and all(
            is_safe(throw, record, model.theta, model.gaussians, limits)
            for record, model in zip(logs, self._models, strict=True)
        )

    def predicted(self, throws: Sequence[Throw]) -> list[Grams | None]:
        """Grams of throws; None for those that leave the limits, or diverge."""

        def weigh(pair: tuple[Throw, list[Record]]) -> Grams | None:
            throw, logs = pair
            if not self._is_safe(throw, logs):
                return None
            grams = tuple(map(self._gram, logs))
            # An explanation may diverge.
            finite = all(np.all(np.isfinite(own)) for own in grams)
            return grams if finite else None

        pairs = zip(throws, self.logs(throws), strict=True)
        return in_parallel(weigh, pairs)

    def grams(self, logs: Sequence[list[Record]]) -> list[Grams]:
        """Grams of throws, from their records by each explanation."""
        return in_parallel(lambda own: tuple(map(self._gram, own)), logs)

    def _gram(self, record: Record) -> np.ndarray:
        """Products of all columns of one record, (c, c)."""
        scales = self.explanations[0].model.scales
        blocks = []
        for linear in self._filters:
            innovations = whiten(linear(record), scales).innovations
            blocks.append(innovations.reshape(-1, innovations.shape[2]))
        columns = np.hstack(blocks)
        with np.errstate(over="ignore", invalid="ignore"):  # A model may diverge.
            return columns.T @ columns

    @functools.cached_property
    def _columns(self) -> list[slice]:
        """Columns X_k of each explanation; e_k comes next."""
        columns = []
        first = 0
        for explanation in self.explanations:
            last = first + len(explanation.precision)
            columns.append(slice(first, last))
            first = last + 1
        return columns

    @functools.cached_property
    def _draws(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Draws of each explanation: parameter errors δ (M, m), and noise (M, c)."""
        rng = np.random.default_rng(0)
        width = self._columns[-1].stop + 1
        found = []
        for e in self.explanations:
            noise = rng.normal(size=(_DRAWN_FUTURES // 2, width))
            numbers = self.numbers(e, rng, _DRAWN_FUTURES // 2)
            found.append((numbers, np.vstack([noise, -noise])))
        return found

    def numbers(
        self, explanation: Explanation, rng: np.random.Generator, pairs: int
    ) -> np.ndarray:
        """Draws departures δ of the true parameters from the fitted, (2 pairs, m)."""
        precision = explanation.precision
        standard = rng.normal(size=(pairs, len(precision)))
        if not len(precision):
            return np.zeros((2 * pairs, 0))
        scale = 1.0 / np.sqrt(np.diag(precision))
        scaled = precision * scale[:, None] * scale
        factor = np.linalg.cholesky(scaled)
        drawn = np.linalg.solve(factor.T, standard.T).T
        drawn = drawn * scale

        prior = prior_of(self.task, explanation.model)
        mirrored = np.vstack([drawn, -drawn])

        return np.clip(mirrored, prior.lower, prior.upper)

    def odds(self, gram: np.ndarray, moved: np.ndarray) -> np.ndarray:
        """Log-probability of each explanation in futures, (M, n), up to a constant.

        Args:
            gram: of the throws, flown by the true explanation.
            moved: (M, c) products of all columns with the change of the log, X_i δ + ν.
        """
        found = np.empty((len(moved), len(self.explanations)))
        for k, e in enumerate(self.explanations):
            own = self._columns[k]
            error = own.stop
            information = gram[own, own] + e.precision
            side = gram[own, error] + moved[:, own]
            fitted = solve_scaled(information, side, 0.0)

            loss = gram[error, error] + 2.0 * moved[:, error]
            loss = loss - np.sum(side * fitted, axis=1)
            _, after = np.linalg.slogdet(information)
            _, before = np.linalg.slogdet(e.precision)
            volume = after - before
            found[:, k] = np.log(e.probability) - 0.5 * (loss + volume)
        return found

    def futures(self, grams: Grams) -> np.ndarray:
        """Log-probabilities in drawn futures, (n, M, n), by the true explanation."""
        found = []
        for i, gram in enumerate(grams):
            numbers, noise = self._draws[i]
            by_numbers = numbers @ gram[self._columns[i]]
            by_noise = noise @ _root(gram)
            odds = self.odds(gram, by_numbers + by_noise)
            found.append(log_softmax(odds, axis=-1))

        return np.array(found)

    def chance(self, futures: np.ndarray) -> float:
        """Probability that the best explanation will be the right one."""
        p = self.probabilities
        best = np.exp(futures.max(axis=2))
        by_truth = best.mean(axis=1)
        # Throws that do not distinguish explanations leave the choice of today.
        return float(max(p @ by_truth, p.max()))

    def open(self, futures: np.ndarray) -> float:
        """Uncertainty about the explanations that will remain, -E log p_i [nats]."""
        mean = futures.mean(axis=1)
        own = np.diagonal(mean)
        return float(-self.probabilities @ own)

    def distances(self, futures: np.ndarray) -> np.ndarray:
        """Expected log-evidence of a true i (row) against each k [nats]."""
        today = np.log(self.probabilities)
        gained = np.mean(futures, axis=1) - today
        return np.diag(gained)[:, None] - gained

    def tried(
        self, throws: Sequence[Throw], rng: np.random.Generator, draws: int
    ) -> float:
        """Probability that the best explanation will be the right one, by simulation.

        Gliders with drawn parameters fly from perturbed launches, so that nothing is
        linear in the truth. The strength of the noise is known from the flights so far
        alone, each a sample of the flight-to-flight variation: parameters and noise
        are drawn from a Student distribution.

        Args:
            throws: all that are flown.
            rng: draws parameters, launches and noise.
            draws: gliders, in proportion to the probability of their explanation; each
                is flown with several draws of noise.
        """
        freedom = _PER_FLIGHT * len(self.task.records)
        gliders = draws * self.probabilities / np.sum(self.probabilities)
        truths = []
        flights = []
        for i, e in enumerate(self.explanations):
            pairs = max(1, round(0.5 * gliders[i]))
            for numbers in self.numbers(e, rng, pairs):
                strength = float(np.sqrt(freedom / rng.chisquare(freedom)))
                truth = moved(self.task, e.model, strength * numbers)
                truths.append((i, strength))
                for throw in throws:
                    thrown = missed(throw, self.place.limits, rng)
                    flights.append((thrown, truth))
        size = self._columns[-1].stop + 1
        diverged = np.full((size, size), np.nan)
        grams = in_parallel(
            lambda record: diverged if record is None else self._gram(record),
            self._fly(flights),
        )
        right: list[list[float]] = [[] for _ in self.explanations]
        for k, (i, strength) in enumerate(truths):
            first = k * len(throws)
            gram = np.sum(grams[first : first + len(throws)], axis=0)
            share = 0.0  # Not promised where it diverges.
            if np.all(np.isfinite(gram)):
                noise = strength * rng.normal(size=(_NOISES, size))
                odds = self.odds(gram, noise @ _root(gram))
                share = float(np.mean(np.argmax(odds, axis=1) == i))
            right[i].append(share)
        chances = [np.mean(shares) for shares in right]
        return float(self.probabilities @ chances)

    def covariance(self, grams: Grams | None = None) -> np.ndarray:
        """Covariance of the best explanation's free parameters, after throws if any."""
        precision = self.explanations[0].precision
        if grams is not None:
            own = self._columns[0]
            precision = precision + grams[0][own, own]
        return solve_scaled(precision, np.eye(len(precision)))


_PER_FLIGHT = 2
"""Degrees of freedom that a flight adds: a trim, and a pitch offset or a wind."""

_NOISES = 8
"""Draws of noise that a drawn glider is flown in."""


def _root(gram: np.ndarray) -> np.ndarray:
    """R with R' R = gram, which barely has full rank."""
    diagonal = np.maximum(np.diag(gram), 1e-300)
    size = np.sqrt(diagonal)
    scaled = gram / size[:, None] / size
    values, vectors = np.linalg.eigh(scaled)
    values = np.maximum(values, 0.0)
    roots = np.sqrt(values)

    return roots[:, None] * vectors.T * size


def added(parts: Sequence[Grams]) -> Grams:
    """Grams of several throws together."""
    return tuple(np.sum(own, axis=0) for own in zip(*parts, strict=True))
