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
import itertools
from collections.abc import Callable, Sequence

import numpy as np
from scipy.special import log_softmax

from glider.campaign.logs import Campaign, Flight
from glider.compiled.parallel import in_parallel
from glider.experiments.explanations import Explanation
from glider.experiments.throws import Range, Throw, is_safe, log_of
from glider.sysid.likelihood.directions import slopes
from glider.sysid.likelihood.filtering import whiten
from glider.sysid.likelihood.information import solve_scaled
from glider.sysid.likelihood.linear_flight import LinearFlight
from glider.sysid.likelihood.model_fit import linear_flight, prior_of
from glider.sysid.likelihood.task import FitResult, Task
from glider.sysid.replay.record import Noise, Record, prepare

Grams = tuple[np.ndarray, ...]
"""By the true explanation: products of the columns X_0, e_0, X_1, e_1, ..., (c, c)."""

_DRAWN_FUTURES = 128
"""Futures drawn of each explanation, in mirrored pairs."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Predicted:
    """What a throw will show by each explanation."""

    throw: Throw
    paths: np.ndarray  #: (explanations, n, 3) poses.
    grams: Grams


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

    def predict(self, throws: Sequence[Throw]) -> list[Predicted | None]:
        """What throws will show; None for those that leave the limits, or diverge."""
        space = self.task.space

        def fly(one: tuple[Throw, FitResult]) -> Flight:
            throw, model = one
            return log_of(throw, self.place, space, model.theta, model.gaussians)

        flown = in_parallel(fly, itertools.product(throws, self._models))
        is_finite = [bool(np.all(np.isfinite(flight.pose))) for flight in flown]
        whole = list(itertools.compress(flown, is_finite))
        records = iter(prepare(whole, self.campaign, self.noise, space))
        made = [next(records) if ok else None for ok in is_finite]
        count = len(self._models)
        logs = [made[k : k + count] for k in range(0, len(made), count)]
        return in_parallel(self._predict, zip(throws, logs, strict=True))

    def _predict(self, pair: tuple[Throw, list[Record | None]]) -> Predicted | None:
        """What a throw will show, from its records by each explanation."""
        throw, logs = pair
        records = []
        for found, model in zip(logs, self._models, strict=True):
            if found is None:
                return None
            record = dataclasses.replace(found, usual_rest=found.rest)
            motion = model.theta, model.gaussians
            if not is_safe(throw, record, *motion, self.place.limits):
                return None
            records.append(record)
        grams = tuple(map(self._gram, records))
        if not np.all(np.isfinite(grams)):  # An explanation may diverge.
            return None
        paths = np.array([record.pose for record in records])
        return Predicted(throw=throw, paths=paths, grams=grams)

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
        pairs = _DRAWN_FUTURES // 2
        width = self._columns[-1].stop + 1
        found = []
        for e in self.explanations:
            noise = rng.normal(size=(pairs, width))
            standard = rng.normal(size=(pairs, len(e.precision)))
            factor = np.linalg.cholesky(e.precision)
            drawn = np.linalg.solve(factor.T, standard.T).T
            prior = prior_of(self.task, e.model)
            numbers = np.clip(np.vstack([drawn, -drawn]), prior.lower, prior.upper)
            found.append((numbers, np.vstack([noise, -noise])))
        return found

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

    def covariance(self, grams: Grams | None = None) -> np.ndarray:
        """Covariance of the best explanation's free parameters, after throws if any."""
        precision = self.explanations[0].precision
        if grams is not None:
            own = self._columns[0]
            precision = precision + grams[0][own, own]
        return solve_scaled(precision, np.eye(len(precision)))


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
