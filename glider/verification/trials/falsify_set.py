"""The attempt to falsify a funnel with the gliders that the data allow.

Gliders are drawn from a confidence set and fly from the boundary. Then both are
climbed, the start along the boundary and the glider along the boundary of its set, and
at last the set's worst corner is flown, to first order from the worst flight. For a
funnel that was made for such a set, V of each glider is about its own center.
"""

from collections.abc import Callable, Sequence

import numpy as np

from glider.errors import InputError
from glider.verification.dynamics.confidence import ConfidenceSet
from glider.verification.dynamics.gliders import glider_at, physical
from glider.verification.funnel.funnel import Funnel
from glider.verification.sos.sphere import normalized
from glider.verification.trials.falsify import (
    CLIMB_NARROWING,
    CLIMB_ROUNDS,
    CLIMB_WIDTH,
    START_SHARES,
    Falsification,
    strayed,
)
from glider.verification.trials.flights import boundary_states, fly_from

GLIDERS = 24
"""Gliders drawn at each start time, besides the set's corners: half of them within the
set and half on its boundary."""

CLIMBERS = 8
"""Gliders that fly in each round of the climb."""

NUDGE = 0.05
"""Step towards the set's boundary by which its worst corner is looked for."""


def falsify_set(
    funnel: Funnel,
    confidence: ConfidenceSet,
    samples: int,
    rng: np.random.Generator,
    *,
    shares: Sequence[float] = START_SHARES,
    climb: bool = True,
    progress: Callable[[float], None] | None = None,
) -> Falsification:
    """Flies gliders of a set from the boundary, then climbs from the worst of them.

    Args:
        funnel: to falsify.
        confidence: set of the deviations from the funnel's glider.
        samples: flights from random points, divided among start times and gliders; at
            least one each. The climb adds about as many and a half.
        rng: draws points and gliders.
        shares: of the duration: when flights start.
        climb: whether to look for worse ones near the worst.
        progress: called with the share that is done.

    Raises:
        InputError: the funnel is of gliders that deviate in other numbers.
    """
    if funnel.gliders and funnel.gliders.confidence.names != confidence.names:
        raise InputError(
            "The funnel is of gliders that deviate in "
            f"{', '.join(funnel.gliders.confidence.names)}; those to fly deviate in "
            f"{', '.join(confidence.names) or 'nothing'}."
        )
    last = len(funnel.nominal.times) - 1
    trial = _Trial(funnel, confidence, rng)
    for number, share in enumerate(shares):
        k = min(round(share * last), last - 1)
        count = max(1, samples // len(shares))
        worst = trial.draw(k, count)
        width = CLIMB_WIDTH
        for _ in range(CLIMB_ROUNDS if climb else 0):
            worst = trial.climb(k, worst, max(1, count // 25), width)
            width *= CLIMB_NARROWING
        if climb:
            trial.corner(k, worst, max(1, count // 25), width)
        if progress:
            progress((number + 1) / len(shares))
    return trial.outcome()


class _Trial:
    """Flights of gliders of a set, and what came of them."""

    def __init__(
        self, funnel: Funnel, confidence: ConfidenceSet, rng: np.random.Generator
    ):
        """Notes nothing yet."""
        self._funnel, self._confidence, self._rng = funnel, confidence, rng
        self._model = funnel.nominal.model
        self._found: list[tuple[np.ndarray, ...]] = []

    def draw(self, k, count):
        """Flies corners and random gliders from random points."""
        rng, allowed = self._rng, self._confidence
        half = GLIDERS // 2
        inside = allowed.draw(half, rng)
        at_edge = allowed.on_boundary(rng.normal(size=(half, allowed.dimension)))
        gliders = np.concatenate([allowed.corners(), inside, at_edge])
        n = self._funnel.num_states
        return self._fly_all(
            k,
            [
                (glider, normalized(rng.normal(size=(len(part), n))))
                for glider, part in zip(
                    gliders, np.array_split(np.arange(count), len(gliders)), strict=True
                )
            ],
        )

    def climb(self, k, before, kept, width):
        """Flies from near the worst points with gliders near the worst."""
        values, points, gliders = before
        best = np.argsort(-values)[:kept]
        groups = [best[first::CLIMBERS] for first in range(CLIMBERS)]
        flights = []
        for group in groups:
            if len(group):
                towards = self._directions(gliders[group[0]])
                towards = towards + width * self._rng.normal(size=towards.shape)
                glider = self._confidence.on_boundary(towards)
                flights.append((glider, strayed(points[group], width, self._rng)))
        return self._fly_all(k, flights)

    def corner(self, k, before, kept, width):
        """Flies the worst corner of the set, to first order from the worst flight."""
        values, points, gliders = before
        best = np.argsort(-values)[:kept]
        factor, worst = self._confidence.factor, best[0]
        if not factor.shape[1] or not np.isfinite(values[worst]):
            return
        nudged = (1.0 - NUDGE) * gliders[worst] + NUDGE * factor.T
        start = points[worst][None]
        around = [self._fly(k, glider, start)[0] for glider in nudged]
        center = self._fly(k, (1.0 - NUDGE) * gliders[worst], start)[0]
        slope = np.array(around)[:, 0] - center
        if self._confidence.shape == "box":
            slope = np.sign(slope)
        glider = self._confidence.on_boundary(slope)
        self._fly_all(k, [(glider, strayed(points[best], width, self._rng))])

    def outcome(self):
        """Returns all that was flown."""
        columns = (np.concatenate(c) for c in zip(*self._found, strict=True))
        starts, levels, later, ends, states, deviations = columns
        return Falsification(
            starts=starts,
            levels=levels,
            later=later,
            ends=ends,
            states=states,
            deviations=deviations,
        )

    def _directions(self, deviation):
        """Returns the direction of w (r,) that a deviation is in."""
        w = np.linalg.pinv(self._confidence.factor) @ deviation
        return w / max(np.linalg.norm(w), 1e-300)

    def _fly_all(self, k, flights):
        """Flies gliders from points each; returns what to climb, points, gliders."""
        told = [(*self._fly(k, d, points), points) for d, points in flights]
        values, flown, points = zip(*told, strict=True)
        gliders = [np.tile(d, (len(p), 1)) for d, p in zip(flown, points, strict=True)]
        return np.concatenate(values), np.concatenate(points), np.concatenate(gliders)

    def _fly(self, k, deviation, points):
        """Flies a glider from points of the boundary; returns what to climb, and δ."""
        funnel, names = self._funnel, self._confidence.names
        deviation = physical(self._model, names, deviation)
        glider = glider_at(self._model, names, deviation)
        if not len(points):
            return np.empty(0), deviation
        states = boundary_states(funnel, k, points, deviation)
        levels, _ = fly_from(funnel, k, states, glider, deviation)
        levels = np.where(np.isfinite(levels), levels, np.inf)
        time = np.full(len(points), funnel.nominal.times[k])
        flown = np.tile(deviation, (len(points), 1))
        later = levels[:, 1:].max(axis=1)
        self._found.append(
            (time, levels.max(axis=1), later, levels[:, -1], states, flown)
        )
        return later, deviation
