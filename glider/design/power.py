"""Information limits: the smallest effect that so many flights can show.

An oracle knows the candidates: the sizes of the library's effects with their shapes, of
which one acts or none; and how strong the air and the sensors' noise are. It knows
nothing of the launches. With the whitened column x_k of a candidate in one flight (see
`glider.sysid.likelihood.scales.whiten`), N flights know its size alone to
    σ_k = 1 / √(N mean x_k'x_k),
and where candidate j acts with a size of d σ_j, the sizes fitted to each candidate
alone are, over their σ_k,
    T ~ N(d R_j, R),    R_jk = mean x_j'x_k / √(mean x_j'x_j  mean x_k'x_k).
The oracle claims the candidate of the largest |T_k|, if that is larger than chance
makes the largest in all but a share of the campaigns without an effect.
"""

import dataclasses

import numpy as np

from glider.sysid.likelihood.directions import Direction, slopes, starts_of
from glider.sysid.likelihood.model_fit import Fitted, grams_of, linear_flights
from glider.sysid.likelihood.task import Task
from glider.sysid.search.weighing import RIVAL_GAP

FALSE_ALARMS = 0.01
"""Share of campaigns without an effect in which the oracle may claim one."""

FOUND = 0.95
"""Share of campaigns with an effect of the limit's size in which it must find it."""

MOST_SIGMAS = 100.0
"""Size in standard errors from which on a rival is called one with the effect."""

_DRAWS = 10_000
"""Campaigns that are drawn: a share of 95 % is then known to 0.2 %."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Limit:
    """What flights can know of one coefficient.

    Attributes:
        kind: of the effect.
        name: of the coefficient.
        unit: of it.
        scale: its typical size.
        shapes: of the effect, by name.
        std: standard deviation that one flight knows it to, on average.
        shown: standard errors from which on flights show that the effect acts, or one
            that to them is as good.
        named: the same that it and no other acts; infinite where none that is less
            than MOST_SIGMAS tells it from its nearest rival.
        rival: that is the most like it.
    """

    kind: str
    name: str
    unit: str
    scale: float
    shapes: dict[str, float]
    std: float
    shown: float
    named: float
    rival: str

    def smallest(self, flights: int) -> float:
        """Returns the size from which on so many flights show it, or one like it."""
        return self.shown * self.std / float(np.sqrt(flights))

    def smallest_named(self, flights: int) -> float:
        """Returns the size from which on so many flights name it."""
        return self.named * self.std / float(np.sqrt(flights))


def limits_of(task: Task, model: Fitted) -> list[Limit]:
    """Returns the limits of all sizes of the task's kinds, in flights like its own.

    Shapes are where the library has them; a lag or a delay counts as small.

    Args:
        task: of flights in which nothing is wrong but the model.
        model: of the task without effects, its scales fitted.
    """
    candidates, is_asked = _candidates(task, model)
    grams = grams_of(linear_flights(task, model, candidates), model.scales)
    known = np.mean(grams, axis=0)[:-1, :-1]
    shows = np.flatnonzero(np.diag(known) > 0.0)  # Others show in no flight.
    candidates = [candidates[j] for j in shows]
    size = np.sqrt(np.diag(known)[shows])
    oracle = _Oracle(
        correlations=known[np.ix_(shows, shows)] / size[:, None] / size,
        kinds=np.array([d.kind for d in candidates]),
    )
    found = []
    for j, direction in enumerate(candidates):
        coefficient = task.coefficient(direction.slot)
        if coefficient is None or not is_asked[shows[j]]:
            continue  # A parameter of the vehicle, or another shape.
        found.append(
            Limit(
                kind=direction.kind,
                name=coefficient.name,
                unit=coefficient.unit,
                scale=coefficient.scale,
                shapes={task.layout.slots[i][1]: v for i, v in direction.shapes},
                std=1.0 / float(size[j]),
                shown=oracle.least(j, RIVAL_GAP),
                named=oracle.least(j),
                rival=oracle.rival(j),
            )
        )
    return found


def _candidates(task: Task, model: Fitted) -> tuple[list[Direction], list[bool]]:
    """Returns all sizes at all starting shapes; and which have the usual shapes."""
    layout = task.layout
    found: list[Direction] = []
    is_asked: list[bool] = []
    for name in task.kinds:
        kind = layout.kinds[name]
        slots = list(layout.slots_of(name))
        if all(c.is_shape for c in kind.coefficients):
            starts, usual = [slopes(layout, model.theta, slots)], 0
        else:
            numbers = zip(slots, kind.coefficients, strict=True)
            defaults = {i: c.default for i, c in numbers}
            starts = starts_of(layout, kind, model.theta)
            apart = [
                sum(
                    abs(v - defaults[i]) / layout.scale[i] for i, v in columns[0].shapes
                )
                for columns in starts
            ]
            usual = int(np.argmin(apart))
        for k, columns in enumerate(starts):
            found += columns
            is_asked += [k == usual] * len(columns)
    return found, is_asked


class _Oracle:
    """Campaigns without an effect, drawn once: an effect shifts their statistics."""

    def __init__(self, correlations: np.ndarray, kinds: np.ndarray):
        """Takes R (m, m) and the kind of each candidate (m,)."""
        self.correlations, self.kinds = correlations, kinds
        values, vectors = np.linalg.eigh(correlations)
        root = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
        half = np.random.default_rng(0).normal(size=(_DRAWS // 2, len(root))) @ root
        self.draws = np.vstack([half, -half])
        largest = np.abs(self.draws).max(axis=1)
        self.threshold = float(np.quantile(largest, 1.0 - FALSE_ALARMS))

    def rival(self, j: int) -> str:
        """Returns the other effect that is the most like a candidate."""
        alike = np.where(self.kinds == self.kinds[j], 0.0, self.correlations[j])
        return str(self.kinds[int(np.argmax(np.abs(alike)))])

    def least(self, j: int, gap: float = 0.0) -> float:
        """Returns the least size that a candidate is found at, or infinity [σ].

        Args:
            j: the candidate.
            gap: loss of log-likelihood beside the best that still counts [nats].
        """
        low, high = 0.0, MOST_SIGMAS
        if self._share(j, high, gap) < FOUND:
            return np.inf
        while high - low > 0.01 * high:
            middle = 0.5 * (low + high)
            if self._share(j, middle, gap) < FOUND:
                low = middle
            else:
                high = middle
        return high

    def _share(self, j: int, size: float, gap: float) -> float:
        """Returns in how many campaigns a candidate of some size is found."""
        told = 0.5 * (self.draws + size * self.correlations[j]) ** 2
        best = told.max(axis=1)
        own = told[:, self.kinds == self.kinds[j]].max(axis=1)
        return float(np.mean((best > 0.5 * self.threshold**2) & (own >= best - gap)))
