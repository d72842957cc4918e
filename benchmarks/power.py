"""Information limits: the smallest effect that flights can show.

An oracle knows the candidates: the sizes of the library's effects with their shapes, of
which one acts or none. With the whitened column x_k of a candidate in one flight (see
`glider.sysid.likelihood.filtering.whiten`), N flights know its size alone to
    σ_k = 1 / √(Σ x_k'x_k),
and where candidate j acts with a size of d σ_j, the sizes fitted to each candidate
alone are, over their σ_k,
    T ~ N(d R_j, R),    R_jk = Σ x_j'x_k / √(Σ x_j'x_j  Σ x_k'x_k).
The oracle claims the candidate of the largest |T_k|, if that is larger than chance
makes the largest in all but a share of the campaigns without an effect.

The oracle estimates the strength of moving air, the noise and the flight-to-flight
variation from the flights, too: they absorb part of an effect, of few flights a large
part. The size is the one whose loss of likelihood without the effect, the scales
refitted, is that of d σ_j where they are known: ½ d². Where a rival has to be
distinguished from it, the same holds for the part that the rival does not explain.

What is unknown of the vehicle is fitted beside each candidate.
"""

import dataclasses
from collections.abc import Collection, Sequence

import numpy as np

from glider.experiments.rehearsal import Strengths
from glider.physics.parameter_space import OF_VEHICLE, ParameterSpace
from glider.sysid.constants import RIVAL_GAP
from glider.sysid.likelihood.candidates import tame
from glider.sysid.likelihood.directions import Direction, slopes, starts_of
from glider.sysid.likelihood.linear_flight import LinearFlight
from glider.sysid.likelihood.model_fit import grams_of, linear_flights
from glider.sysid.likelihood.task import FitResult, Task

FALSE_ALARMS = 0.01
"""Share of campaigns without an effect in which the oracle may claim one."""

FOUND = 0.95
"""Share of campaigns with an effect of the limit's size in which it must find it."""

MOST_SIGMAS = 100.0
"""Size in standard errors above which a rival is called one with the effect."""

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
        std: standard error of it if nothing else were unknown.
        shown: least size with which the flights show that the effect acts, or one that
            to them is as good.
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


def limits_of(
    task: Task, model: FitResult, kinds: Collection[str] | None = None
) -> list[Limit]:
    """Returns the limits of all sizes of effects, in the flights of a task.

    Shapes are where the library has them; a lag or a delay counts as small.

    Args:
        task: of flights in which nothing is wrong but the model.
        model: of the task without effects, its scales fitted.
        kinds: whose limits are wanted; by default all of the task's, which are the
            candidates.
    """
    candidates, is_usual = _candidates(task, model)
    always = slopes(task.space, task.vehicle.nuisance)
    columns = [*candidates, *always]
    flights = linear_flights(task, model, columns)
    tame(task, columns, flights)
    steps, known = _beside(task, model, flights, len(candidates))
    scale = task.space.scale[[d.slot for d in candidates]]
    told = np.diag(known) * scale**2
    shows = np.flatnonzero(told > _LEAST_TOLD)  # Others show in no flight.
    if not len(shows):
        return []
    std = np.diag(known)[shows] ** -0.5
    oracle = _Oracle(
        correlations=std[:, None] * known[np.ix_(shows, shows)] * std,
        kinds=np.array([candidates[j].kind for j in shows]),
    )
    strengths = Strengths(
        flights, model.scales, (), np.zeros(0)
    )  # Steps have all else.
    found = []
    for place, j in enumerate(shows):
        direction = candidates[j]
        coefficient = task.space.entries[direction.slot]
        if kinds is not None and direction.kind not in kinds:
            continue
        if direction.kind == OF_VEHICLE or not is_usual[j]:
            continue  # A parameter of the vehicle, or another shape.
        shown = _size_of(
            strengths, steps[j], oracle.least(place, RIVAL_GAP), std[place]
        )
        named, rival = np.inf, oracle.rival(place)
        if np.isfinite(sigmas := oracle.least(place)):
            # What is left of the effect beside its rival has to show.
            alike = float(oracle.correlations[place, rival])
            left = np.sqrt(1.0 - alike**2)
            apart = steps[j] - alike * std[rival] / std[place] * steps[shows[rival]]
            named = _size_of(strengths, apart, sigmas * left, std[place] / left)
        found.append(
            Limit(
                kind=direction.kind,
                name=coefficient.name,
                unit=coefficient.unit,
                scale=coefficient.scale,
                shapes={task.space.entries[i].name: v for i, v in direction.shapes},
                std=float(std[place]),
                shown=shown,
                named=max(named, shown),
                rival=str(oracle.kinds[rival]),
            )
        )
    return found


def _beside(
    task: Task, model: FitResult, flights: Sequence[LinearFlight], count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Returns each candidate beside what is unknown of the vehicle, and what is known.

    Args:
        task: of the flights.
        model: about which they are linear.
        flights: linear in the candidates and then in the vehicle's unknowns.
        count: of the candidates.

    Returns:
        (count, m) the columns' change where a candidate acts by one and the unknowns
        are fitted to it; and the candidates' information (count, count).
    """
    gram = np.sum(grams_of(flights, model.scales), axis=0)[:-1, :-1]
    _, precision = task.priors(list(task.vehicle.nuisance), model.theta)
    places = np.arange(count, len(gram))
    gram[places, places] += precision
    across = gram[:count, count:]
    steps = np.eye(count, len(gram))
    steps[:, count:] = -np.linalg.solve(gram[count:, count:], across.T).T
    return steps, gram[:count, :count] + steps[:, count:] @ across.T


def _size_of(
    strengths: Strengths, step: np.ndarray, sigmas: float, std: float
) -> float:
    """Returns the size of a step that loses ½ sigmas², the scales refitted.

    Args:
        strengths: of the noise.
        step: change of all columns (m,) by an effect of size one.
        sigmas: that many standard errors lose as much where the scales are known.
        std: the standard error there.
    """
    size = sigmas * std
    for _ in range(_ROUNDS):
        lost = strengths.lost_without(size * step)
        times = float(np.clip(np.sqrt(0.5 * sigmas**2 / lost), 0.5, 2.0))
        size *= times
        if abs(times - 1.0) < _CLOSE:
            break
    return float(size)


_LEAST_TOLD = 1e-9
"""Information on a coefficient of its usual scale below which it shows in no flight."""


_ROUNDS, _CLOSE = 10, 0.03
"""Of the search for a size, and how close it need be."""


def _candidates(task: Task, model: FitResult) -> tuple[list[Direction], list[bool]]:
    """Returns all sizes at all starting shapes, and which have the usual shapes."""
    space, own = task.space, set(task.vehicle.nuisance)
    found: list[Direction] = []
    is_usual: list[bool] = []
    for name in task.kinds:
        kind = space.kinds[name]
        slots = list(space.slots_of(name))
        allowed = set(task.free((name,))) - own
        if all(c.is_shape for c in kind.coefficients):
            starts, usual = [slopes(space, slots)], 0
        else:
            starts = starts_of(space, kind, model.theta)
            defaults = model.theta.copy()
            defaults[slots] = [c.default for c in kind.coefficients]
            usual = _nearest_start(space, starts, defaults)
        for k, columns in enumerate(starts):
            mine = [d for d in columns if d.slot in allowed]
            found += mine
            is_usual += [k == usual] * len(mine)
    return found, is_usual


def _nearest_start(
    space: ParameterSpace, starts: Sequence[Sequence[Direction]], theta: np.ndarray
) -> int:
    """Index of the start whose shapes are nearest to those of theta."""
    apart = [
        sum(abs(v - theta[i]) / space.scale[i] for i, v in columns[0].shapes)
        for columns in starts
    ]
    return int(np.argmin(apart))


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

    def rival(self, j: int) -> int:
        """Returns the candidate of another effect that is the most like one."""
        alike = np.where(self.kinds == self.kinds[j], 0.0, self.correlations[j])
        return int(np.argmax(np.abs(alike)))

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
