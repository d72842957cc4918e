"""The attempt to falsify a funnel: flights of the true dynamics from its boundary.

Flights that escape are counted, never dropped.
"""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from glider.errors import InputError
from glider.physics.model import GliderModel
from glider.verification.funnel.funnel import Funnel
from glider.verification.sos.sphere import normalized
from glider.verification.trials.flights import boundary_states, fly_from

ESCAPE_LEVEL = 1.005
"""Level V that a flight passes which has left the funnel. Flights start at 1, and those
that stay come to 1 + 1e-6 by rounding and integration."""

START_SHARES = (0.0, 0.12, 0.25, 0.37, 0.5, 0.62, 0.75, 0.87)
"""Times when flights start, as shares of the funnel's duration."""

CLIMB_ROUNDS = 6
"""Rounds of ascent along the boundary."""

CLIMB_WIDTH = 0.3
"""Length by which the first round strays from the worst points, on the unit sphere."""

CLIMB_NARROWING = 0.6
"""Factor on that length from a round to the next."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Falsification:
    """The outcome of flights from a funnel's boundary."""

    starts: np.ndarray
    """Times (B,) when they started [s]."""

    levels: np.ndarray
    """Largest V (B,) of each; 1 is the boundary."""

    later: np.ndarray
    """Largest V (B,) of each at the funnel's times after its start."""

    ends: np.ndarray
    """V at the end (B,), in the goal if at most 1."""

    states: np.ndarray
    """States (B, n) where they started."""

    deviations: np.ndarray | None = None
    """Deviations δ (B, m) of the gliders that flew; None where it was the same."""

    @property
    def samples(self) -> int:
        """Number of flights."""
        return len(self.levels)

    @property
    def escaped(self) -> np.ndarray:
        """Whether each flight left the funnel, (B,)."""
        return ~(self.levels <= ESCAPE_LEVEL)  # NaN is an escape.

    @property
    def escapes(self) -> int:
        """Number of flights that left the funnel."""
        return int(self.escaped.sum())


def falsify_funnel(
    funnel: Funnel,
    samples: int,
    rng: np.random.Generator,
    *,
    model: GliderModel | None = None,
    shares: Sequence[float] = START_SHARES,
    climb: bool = True,
    progress: Callable[[float], None] | None = None,
) -> Falsification:
    """Flies from random points of the boundary, then climbs from the worst of them.

    Args:
        funnel: to falsify.
        samples: flights from random points, divided among the start times.
        rng: draws the points.
        model: the glider that flies; the funnel's own if None. One with states that
            the funnel does not know starts with them at rest.
        shares: of the duration: when flights start.
        climb: whether to look for worse points near the worst, CLIMB_ROUNDS times with
            a fifth as many flights.
        progress: called with the share that is done.
    """
    if samples < len(shares):
        raise InputError(f"{samples} flights are too few; {len(shares)} are needed.")
    last = len(funnel.nominal.times) - 1
    n = funnel.num_states
    found: list[tuple] = []
    for number, share in enumerate(shares):
        k = min(round(share * last), last - 1)
        count = samples // len(shares) + (number < samples % len(shares))
        points = normalized(rng.normal(size=(count, n)))
        worst = _fly(funnel, k, points, model, found)
        width = CLIMB_WIDTH
        for _ in range(CLIMB_ROUNDS if climb else 0):
            best = np.argsort(-worst)[: max(1, count // 25)]
            points = strayed(points[best], width, rng)
            worst = _fly(funnel, k, points, model, found)
            width *= CLIMB_NARROWING
        if progress:
            progress((number + 1) / len(shares))
    columns = (np.concatenate(c) for c in zip(*found, strict=True))
    starts, levels, later, ends, states = columns
    return Falsification(
        starts=starts, levels=levels, later=later, ends=ends, states=states
    )


def strayed(points: np.ndarray, width: float, rng: np.random.Generator) -> np.ndarray:
    """Returns five points (5 B, n) near each of some (B, n) on the unit sphere."""
    n = points.shape[1]
    noise = rng.normal(size=(5 * len(points), n)) / np.sqrt(n)
    return normalized(np.repeat(points, 5, axis=0) + width * noise)


def _fly(funnel, k, points, model, found):
    """Flies from points of the boundary and notes it; returns what to climb, (B,)."""
    states = boundary_states(funnel, k, points)
    levels, _ = fly_from(funnel, k, states, model)
    levels = np.where(np.isfinite(levels), levels, np.inf)
    time = np.full(len(points), funnel.nominal.times[k])
    later = levels[:, 1:].max(axis=1)
    found.append((time, levels.max(axis=1), later, levels[:, -1], states))
    # A flight starts at 1: what counts is how close it comes again, or goes beyond.
    return later
