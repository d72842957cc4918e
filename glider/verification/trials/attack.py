"""The attempt to break a funnel: flights of the true dynamics from its boundary.

True means: the full physics, not its Taylor polynomial, and the servo with its limits.
Escapes are counted, never dropped.
"""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from glider.control.policy import TrackingPolicy
from glider.errors import InputError
from glider.physics.model import GliderModel
from glider.planning.plan import Plan
from glider.simulation.fly import fly
from glider.verification.funnel.between import nominal_slopes
from glider.verification.funnel.funnel import Funnel
from glider.verification.sos.forms import to_ball

ESCAPE = 1.005
"""A flight whose V passes this has left the funnel."""

SHARES = (0.0, 0.12, 0.25, 0.37, 0.5, 0.62, 0.75, 0.87)
"""Of the flight's duration: when flights start."""

CLIMBS = 6
"""Rounds of ascent along the boundary."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Attack:
    """What became of flights from the boundary."""

    starts: np.ndarray
    """(B,) times when they started [s]."""

    levels: np.ndarray
    """(B,) the largest V of each; 1 is the boundary."""

    ends: np.ndarray
    """(B,) V at the end, in the goal if at most 1."""

    states: np.ndarray
    """(B, n) where they started."""

    @property
    def samples(self) -> int:
        """How many flights were flown."""
        return len(self.levels)

    @property
    def escaped(self) -> np.ndarray:
        """(B,) whether a flight left the funnel."""
        return ~(self.levels <= ESCAPE)  # NaN is an escape.

    @property
    def escapes(self) -> int:
        """How many flights left the funnel."""
        return int(self.escaped.sum())


def funnel_policy(funnel: Funnel, first: int = 0) -> TrackingPolicy:
    """Returns the feedback of a funnel from one of its times on, as a policy."""
    nominal = funnel.nominal
    if not 0 <= first < len(nominal.times) - 1:
        raise InputError(f"There is no flight from the funnel's time {first} on.")
    times = nominal.times[first:] - nominal.times[first]
    plan = Plan(
        times=times,
        states=nominal.states[first:],
        slopes=nominal_slopes(nominal)[first:],
        inputs=nominal.inputs[first:],
        state_names=nominal.state_names,
        cost=0.0,
        max_defect=0.0,
        path_defect=0.0,
        drift=0.0,
    )
    return TrackingPolicy(
        plan=plan,
        times=times,
        gains=nominal.gains[first:],
        corrections=np.zeros(len(times)),
        cost=funnel.S[first:],
        cost_slope=np.zeros((len(times), funnel.num_states)),
    )


def fly_from(
    funnel: Funnel, first: int, states: np.ndarray, model: GliderModel | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Flies states from one of the funnel's times to its end.

    Args:
        funnel: the funnel, whose feedback flies.
        first: index of the time.
        states: (B, n).
        model: the glider that flies; the funnel's own if None.

    Returns:
        V of each at the funnel's times from `first` on, (B, T - first), and the
        paths (B, T - first, n').
    """
    policy = funnel_policy(funnel, first)
    step = (policy.plan.times[1] - policy.plan.times[0]) / 2.0
    model = funnel.nominal.model if model is None else model
    flights = fly(
        model, policy, states, step=step * (1.0 + 1e-9), after=0.0, keep_paths=True
    )
    assert flights.paths is not None
    paths = flights.paths[:, ::2]
    times = funnel.nominal.times[first:]
    return funnel.level(times, paths[..., : funnel.num_states]), paths


def boundary_states(funnel: Funnel, k: int, directions: np.ndarray) -> np.ndarray:
    """Returns states (B, n) on the boundary at a time, given unit vectors (B, n)."""
    return funnel.nominal.states[k] + directions @ to_ball(funnel.S[k])[1].T


def attack_funnel(
    funnel: Funnel,
    samples: int,
    rng: np.random.Generator,
    *,
    model: GliderModel | None = None,
    shares: Sequence[float] = SHARES,
    climb: bool = True,
    progress: Callable[[float], None] | None = None,
) -> Attack:
    """Flies from random points of the boundary, then climbs from the worst of them.

    Args:
        funnel: to break.
        samples: flights from random points, divided among the start times.
        rng: draws the points.
        model: the glider that flies; the funnel's own if None. One with states that
            the funnel does not know starts with them at rest.
        shares: of the duration: when flights start.
        climb: whether to look for worse points near the worst, CLIMBS times with a
            fifth as many flights.
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
        points = _unit(rng.normal(size=(count, n)))
        worst = _fly(funnel, k, points, model, found)
        width = 0.3
        for _ in range(CLIMBS if climb else 0):
            best = np.argsort(-worst)[: max(1, count // 25)]
            points = _unit(
                np.repeat(points[best], 5, axis=0)
                + width * rng.normal(size=(5 * len(best), n)) / np.sqrt(n)
            )
            worst = _fly(funnel, k, points, model, found)
            width *= 0.6
        if progress:
            progress((number + 1) / len(shares))
    starts, levels, ends, states = (np.concatenate(c) for c in zip(*found, strict=True))
    return Attack(starts=starts, levels=levels, ends=ends, states=states)


def draw_inside(funnel: Funnel, count: int, rng: np.random.Generator) -> np.ndarray:
    """Draws launches that are uniform in the inlet, (count, n)."""
    n = funnel.num_states
    points = _unit(rng.normal(size=(count, n))) * rng.uniform(size=(count, 1)) ** (
        1 / n
    )
    return boundary_states(funnel, 0, points)


def fly_inside(
    funnel: Funnel,
    count: int,
    rng: np.random.Generator,
    model: GliderModel | None = None,
) -> np.ndarray:
    """Flies launches that are uniform in the inlet; returns paths (count, T, n)."""
    return fly_from(funnel, 0, draw_inside(funnel, count, rng), model)[1]


def _fly(funnel, k, points, model, found):
    """Flies from points of the boundary and notes it; returns what to climb."""
    states = boundary_states(funnel, k, points)
    levels, _ = fly_from(funnel, k, states, model)
    levels = np.where(np.isfinite(levels), levels, np.inf)
    time = np.full(len(points), funnel.nominal.times[k])
    found.append((time, levels.max(axis=1), levels[:, -1], states))
    # A flight starts at 1: what counts is how close it comes again, or goes beyond.
    return levels[:, 1:].max(axis=1)


def _unit(points):
    return points / np.linalg.norm(points, axis=1, keepdims=True)
