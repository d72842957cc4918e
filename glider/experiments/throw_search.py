"""The search for throws that together leave least uncertain.

Throws are drawn within the limits, predicted, and drawn again about the best
(cross-entropy method); `glider.experiments.throws` makes them. What they leave
uncertain is which explanation is right and, to first order, where flights like those
flown end.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np

from glider.compiled.parallel import in_parallel
from glider.errors import InputError
from glider.experiments.explanations import Explanation
from glider.experiments.forecast import Forecast, Grams, Predicted, added
from glider.experiments.throws import GENES, throw_of
from glider.progress import Progress, Step
from glider.sysid.likelihood.directions import slopes
from glider.sysid.likelihood.filtering import start_variances, whiten
from glider.sysid.likelihood.model_fit import linear_flight
from glider.sysid.likelihood.task import Task
from glider.sysid.replay.record import Record

_FIRST = 144
"""Throws of a round that is drawn uniformly, of which many leave the limits."""

_DRAWN = 48
"""Throws of the other rounds."""

_ELITES = 8
"""Throws that the next round is drawn about."""

_ROUNDS = 4
"""Rounds of drawing throws."""

_SPREAD = 0.15
"""Spread of a round about an elite, in genes; halved from round to round."""

_PARAMETERS = 0.05
"""Worth of a factor e in the variance of where flights end, in nats of uncertainty
about the explanations: they come first."""

_PROMISING = 32
"""Throws, the best by themselves, among which the best combination is chosen."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class _EndScatter:
    """Scatter of the ends of flights from a given launch, to first order."""

    #: Standard deviation of the end, by moving air and flight-to-flight variation [m].
    air: float
    #: (2 F, m) change of x and z of the end with the free parameters, over √F.
    slopes: np.ndarray

    def by_parameters(self, covariance: np.ndarray) -> float:
        """Standard deviation of the end by the covariance of the parameters [m]."""
        moved = self.slopes @ covariance @ self.slopes.T
        return float(np.sqrt(max(np.trace(moved), 0.0)))


def end_scatter(task: Task, explanation: Explanation) -> _EndScatter:
    """Computes the scatter of a task's flights under an explanation.

    The filter, given the launch and the last row alone, has it as the variance of its
    innovation. Noise at its floor, which the flights do not show, scatters nothing.
    """
    model = dataclasses.replace(explanation.model, about={})
    scales = model.scales.without_floors
    directions = slopes(task.space, model.free)

    def scatter(record: Record) -> tuple[float, np.ndarray]:
        flight = linear_flight(model, directions, record)
        start = start_variances(flight, scales)
        start[: len(flight.states)] = 0.0
        variance = 0.0
        rows = []
        for channel in range(2):
            seen = np.zeros_like(record.seen)
            seen[-1, channel] = True
            last = dataclasses.replace(record, seen=seen)
            alone = dataclasses.replace(flight, record=last)
            filtered = whiten(alone, scales, start)
            own = float(np.exp(filtered.log_variances[-1, channel]))
            variance += own - scales.position**2
            rows.append(np.sqrt(own) * filtered.innovations[-1, channel, :-1])
        return variance, np.array(rows)

    found = in_parallel(scatter, task.records)
    variance = float(np.mean([own for own, _ in found]))
    rows = np.vstack([rows for _, rows in found])
    return _EndScatter(
        air=np.sqrt(max(variance, 0.0)), slopes=rows / np.sqrt(len(found))
    )


def search(
    forecast: Forecast,
    scatter: _EndScatter,
    launches: int,
    rng: np.random.Generator,
    progress: Progress,
) -> list[Predicted]:
    """Finds the throws that together leave least uncertain.

    Raises:
        InputError: no throw keeps within the limits.
    """
    genes: list[np.ndarray] = []
    found: list[Predicted] = []
    alone: list[float] = []
    chosen: list[int] = []
    for round_ in range(_ROUNDS):
        words = f"searching for throws, round {round_ + 1} of {_ROUNDS}"
        progress(Step(words, round_ / _ROUNDS))
        if chosen:
            spread = _SPREAD * 0.5 ** (round_ - 1)
            elites = [*chosen, *np.argsort(alone)[:_ELITES]]
            parents = np.array([genes[k] for k in rng.choice(elites, _DRAWN)])
            drawn = parents + spread * rng.normal(size=parents.shape)
            drawn = np.clip(drawn, 0.0, 1.0)
        else:
            drawn = rng.random((_FIRST, GENES))
        throws = [throw_of(own, forecast.place) for own in drawn]
        for own, predicted in zip(drawn, forecast.predict(throws), strict=True):
            if predicted is not None:
                genes.append(own)
                found.append(predicted)
        fresh = found[len(alone) :]
        alone += in_parallel(
            lambda new: _uncertainty_after(forecast, scatter, new.grams), fresh
        )
        promising = np.argsort(alone)[:_PROMISING].tolist()
        grams = [found[k].grams for k in promising]
        best = choose(forecast, scatter, grams, launches)
        chosen = [promising[k] for k in best]
    if not chosen:
        raise InputError(
            "No throw that was tried keeps within the limits; expected wider limits of "
            "the launch or of the flight (floor, pitch, speed)."
        )
    return [found[k] for k in chosen]


def choose(
    forecast: Forecast, scatter: _EndScatter, grams: Sequence[Grams], count: int
) -> list[int]:
    """Chooses the throws that together leave least uncertain, one by one.

    Each is chosen once, though twice the best might be a little better: throws that
    differ may show what none of the explanations predicts.
    """
    chosen: list[int] = []
    for _ in range(count):
        so_far = [grams[k] for k in chosen]
        left = [k for k in range(len(grams)) if k not in chosen]
        values = [
            _uncertainty_after(forecast, scatter, added([*so_far, grams[k]]))
            for k in left
        ]
        if left:
            chosen.append(left[int(np.argmin(values))])
    return chosen


def _uncertainty_after(forecast: Forecast, scatter: _EndScatter, grams: Grams) -> float:
    """Uncertainty that throws leave: explanations first, then parameters [nats]."""
    covariance = forecast.covariance(grams)
    moved = max(scatter.by_parameters(covariance), 1e-9)
    futures = forecast.futures(grams)
    variance = 2.0 * np.log(moved)

    return forecast.open(futures) + _PARAMETERS * variance
