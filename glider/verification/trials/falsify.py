"""Flights of the full dynamics in a funnel, above all from its boundary to falsify it.

Full means: the physics, not its Taylor polynomial, and the servo with its limits, under
the funnel's own feedback. Flights start from random points of the boundary, then near
the worst of them. For a confidence set, gliders are drawn too and climb along the
boundary of their set; at last its worst corner is flown. For a funnel of such a set, V
of each glider is about its own center. Flights that escape are counted, never dropped.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from glider.errors import InputError
from glider.physics.confidence import ALONE, ConfidenceSet, numbers_at, physical
from glider.physics.model import GliderModel
from glider.progress import Shares, silent
from glider.simulation.fly import check_states, full_starts
from glider.verification.dynamics.nominal import fly_plan
from glider.verification.funnel.funnel import Funnel, funnel_policy
from glider.verification.sos.forms import to_ball
from glider.verification.sos.sphere import normalized

ESCAPE_LEVEL = 1.005
"""Level V that only flights which have left the funnel exceed: from 1, rounding and
integration take others to 1 + 1e-6."""

_START_SHARES = (0.0, 0.12, 0.25, 0.37, 0.5, 0.62, 0.75, 0.87)
"""Times when flights start, as shares of the funnel's duration."""

CLIMB_ROUNDS = 6
"""Rounds of ascent along the boundary, each with a fifth as many flights."""

CLIMB_WIDTH = 0.3
"""Length by which the first round strays from the worst points, on the unit sphere."""

CLIMB_NARROWING = 0.6
"""Factor on this length from a round to the next."""

_GLIDERS = 24
"""Gliders drawn at each start time, besides the set's corners: half of them within the
set and half on its boundary."""

_CLIMBERS = 8
"""Gliders that fly in each round of the climb."""

_NUDGE = 0.05
"""Step towards the set's boundary by which its worst corner is looked for."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Falsification:
    """The outcome of flights from a funnel's boundary."""

    starts: np.ndarray  #: Times (B,) when they started [s].
    levels: np.ndarray  #: Largest V (B,) of each; 1 is the boundary.
    later: np.ndarray  #: Largest V (B,) of each at the funnel's times after its start.
    ends: np.ndarray  #: V at the end (B,), in the goal if at most 1.
    states: np.ndarray  #: States (B, n) where they started.
    deviations: np.ndarray  #: δ (B, m) of the gliders; m is 0 where all flew the same.
    confidence: ConfidenceSet | None = None  #: Set that they were drawn from, if any.

    @property
    def samples(self) -> int:
        """Number of flights."""
        return len(self.levels)

    @property
    def escapes(self) -> int:
        """Number of flights that left the funnel."""
        return int((~(self.levels <= ESCAPE_LEVEL)).sum())  # NaN is an escape.


def falsify_funnel(
    funnel: Funnel,
    samples: int,
    rng: np.random.Generator,
    *,
    model: GliderModel | None = None,
    confidence: ConfidenceSet | None = None,
    shares: Sequence[float] = _START_SHARES,
    climb: bool = True,
    progress: Shares = silent,
) -> Falsification:
    """Flies from random points of the boundary, then climbs from the worst of them.

    Args:
        samples: flights from random points, divided among start times and gliders; at
            least one at each time. The climb adds as many and a fifth more.
        model: the glider that flies; the funnel's own if None. States that the funnel
            lacks start at rest.
        confidence: set of deviations from the funnel's glider, whose gliders fly in
            place of `model`.
        shares: of the duration: when flights start.
        climb: whether to look for worse points, and gliders, near the worst.

    Raises:
        InputError: the funnel is of gliders that deviate in other numbers.
    """
    check_gliders(funnel, confidence)
    trial = _Trial(funnel, rng, model, confidence)
    for number, share in enumerate(shares):
        count = samples // len(shares) + (number < samples % len(shares))
        trial.fly_at(share, max(1, count), climb)
        progress((number + 1) / len(shares))
    return trial.outcome()


def check_gliders(funnel: Funnel, confidence: ConfidenceSet | None) -> None:
    """Raises InputError where a funnel is of gliders that deviate in other numbers."""
    made_for = funnel.gliders.confidence.names if funnel.gliders else None
    if confidence and made_for not in (None, confidence.names):
        raise InputError(
            f"The funnel is of gliders that deviate in {', '.join(made_for)}; those to "
            f"fly deviate in {', '.join(confidence.names) or 'nothing'}."
        )


class _Trial:
    """Flights from the boundary, of one glider or of those of a set."""

    def __init__(self, funnel, rng, model, confidence):
        """Has flown nothing yet."""
        self._funnel = funnel
        self._rng = rng
        self._model = None if confidence else model
        self._confidence = confidence
        self._found = []

    def fly_at(self, share, count, climb):
        """Flies from one time: random points first, then near the worst."""
        last = len(self._funnel.nominal.times) - 1
        k = min(round(share * last), last - 1)
        found = self._fly(k, *self._draw(count))
        width = CLIMB_WIDTH
        kept = max(1, count // 25)
        for _ in range(CLIMB_ROUNDS if climb else 0):
            found = self._fly(k, *self._stray(_worst(found, kept), width))
            width *= CLIMB_NARROWING
        if climb and self._confidence:
            self._fly_corner(self._confidence, k, _worst(found, kept), width)

    def outcome(self) -> Falsification:
        """Returns all that was flown."""
        names = ("starts", "levels", "later", "ends", "states", "deviations")
        columns = map(np.concatenate, zip(*self._found, strict=True))
        found: dict[str, Any] = dict(zip(names, columns, strict=True))
        return Falsification(**found, confidence=self._confidence)

    def _draw(self, count):
        """Returns deviations (B, m) of gliders, and a random point (B, n) of each."""
        rng = self._rng
        allowed = self._confidence
        gliders = np.empty((1, 0))
        if allowed is not None:
            inside = allowed.draw(_GLIDERS // 2, rng)
            directions = rng.normal(size=(_GLIDERS // 2, allowed.dimension))
            at_edge = allowed.on_boundary(directions)
            gliders = np.concatenate([allowed.corners(), inside, at_edge])
        points = normalized(rng.normal(size=(count, self._funnel.num_states)))
        shares = [len(part) for part in np.array_split(points, len(gliders))]
        return np.repeat(gliders, shares, axis=0), points

    def _stray(self, worst, width):
        """Returns points near the worst, and gliders near theirs."""
        _, points, gliders = worst
        allowed = self._confidence
        rng = self._rng
        near_gliders = []
        near_points = []
        climbers = min(_CLIMBERS, len(points)) if allowed else 1
        for first in range(climbers):
            glider = gliders[first]
            if allowed:
                w = np.linalg.pinv(allowed.factor) @ glider
                w = w / max(np.linalg.norm(w), 1e-300)
                glider = allowed.on_boundary(w + width * rng.normal(size=w.shape))
            near = strayed(points[first::climbers], width, rng)
            near_points.append(near)
            near_gliders.append(np.tile(glider, (len(near), 1)))
        return np.concatenate(near_gliders), np.concatenate(near_points)

    def _fly_corner(self, allowed, k, worst, width):
        """Flies the worst corner of the set, to first order from the worst flight."""
        values, points, gliders = worst
        if not allowed.dimension or not np.isfinite(values[0]):
            return
        shrunk = (1.0 - _NUDGE) * gliders[0]
        around = np.vstack([shrunk + _NUDGE * allowed.factor.T, shrunk])
        start = np.repeat(points[:1], len(around), axis=0)
        *moved, usual = self._fly(k, around, start)[0]
        slope = np.array(moved) - usual
        if allowed.shape == "box":
            slope = np.sign(slope)
        points = strayed(points, width, self._rng)
        corner = np.tile(allowed.on_boundary(slope), (len(points), 1))
        self._fly(k, corner, points)

    def _fly(self, k, deviations, points):
        """Flies gliders from points; returns what to climb, points and gliders."""
        funnel = self._funnel
        allowed = self._confidence or ALONE
        deviations = physical(funnel.nominal.model, allowed.names, deviations)
        own = deviations if self._confidence else None
        states = boundary_states(funnel, k, points, own)
        levels, _ = fly_from(funnel, k, states, self._model, allowed.names, own)
        levels = np.where(np.isfinite(levels), levels, np.inf)
        time = np.full(len(points), funnel.nominal.times[k])
        # A flight starts at 1: what counts is how close it comes again, or goes beyond.
        later = levels[:, 1:].max(axis=1)
        most = levels.max(axis=1)
        self._found.append((time, most, later, levels[:, -1], states, deviations))
        return later, points, deviations


def _worst(found, kept):
    """Returns values, points and gliders of the largest values, the worst first."""
    best = np.argsort(-found[0])[:kept]
    return [values[best] for values in found]


def strayed(points: np.ndarray, width: float, rng: np.random.Generator) -> np.ndarray:
    """Returns five points (5 B, n) near each of some (B, n) on the unit sphere."""
    n = points.shape[1]
    noise = rng.normal(size=(5 * len(points), n)) / np.sqrt(n)
    return normalized(np.repeat(points, 5, axis=0) + width * noise)


def fly_from(
    funnel: Funnel,
    first: int,
    states: np.ndarray,
    model: GliderModel | None = None,
    names: tuple[str, ...] = (),
    deviations: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Flies states (B, n) from one of the funnel's times to its end.

    The funnel's own glider flies if no other does, or gliders that deviate from it in
    some numbers by (B, m). V is about the center of each if the funnel is of a set.

    Returns:
        V of each at the funnel's times from `first` on, (B, T - first), and the
        paths (B, T - first, n'), n' the states of the glider that flies.
    """
    model = model or funnel.nominal.model
    policy = funnel_policy(funnel, first)
    check_states(model, policy)
    times = funnel.nominal.times[first:]
    numbers = None
    center = None
    if deviations is not None:
        numbers = numbers_at(model, names, deviations)
        center = deviations[:, None]
    starts = full_starts(model, states)
    step = 0.5 * (times[1] - times[0])
    paths = fly_plan(model, policy, starts, len(times) - 1, step, numbers)
    return funnel.level(times, paths[..., : funnel.num_states], center), paths


def boundary_states(
    funnel: Funnel, k: int, directions: np.ndarray, deviation: np.ndarray | None = None
) -> np.ndarray:
    """Returns states (B, n) on the boundary at a time, given unit vectors (B, n).

    Those of gliders of the funnel's set, (m,) or (B, m), are about their own centers.
    """
    states = funnel.nominal.states[k] + directions @ to_ball(funnel.S[k])[1].T
    if deviation is not None and funnel.gliders:
        states = states + deviation @ funnel.gliders.shifts[k].T
    return states


def draw_inside(funnel: Funnel, count: int, rng: np.random.Generator) -> np.ndarray:
    """Draws launches (count, n) that are uniform in the inlet."""
    n = funnel.num_states
    points = normalized(rng.normal(size=(count, n)))
    points *= rng.uniform(size=(count, 1)) ** (1 / n)
    return boundary_states(funnel, 0, points)


def fly_inside(
    funnel: Funnel,
    count: int,
    rng: np.random.Generator,
    model: GliderModel | None = None,
) -> np.ndarray:
    """Flies launches that are uniform in the inlet; returns paths (count, T, n)."""
    return fly_from(funnel, 0, draw_inside(funnel, count, rng), model)[1]
