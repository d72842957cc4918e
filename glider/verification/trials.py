"""Flights of the full dynamics that try to falsify a funnel; they prove nothing.

Full means: the physics, not its Taylor polynomial, and the servo with its limits.
Flights start from random points of the boundary and with random gliders on the edge of
a confidence set, if one is given. For a funnel of a set, V of each glider is about its
own center. Flights that escape are counted, never dropped. The feedback acts at all
times, as in the theorem.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np

from glider.errors import InputError
from glider.physics.confidence import ALONE, ConfidenceSet, numbers_at, physical
from glider.physics.model import GliderModel
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


@dataclasses.dataclass(frozen=True, kw_only=True)
class Trial:
    """The outcome of flights from a funnel's boundary."""

    deviations: np.ndarray  #: δ (B, m) of the gliders; m is 0 where all flew the same.
    levels: np.ndarray  #: Largest V (B,) of each; 1 is the boundary, where it starts.
    ends: np.ndarray  #: V (B,) at the end, in the last set if at most 1.

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
    gliders: ConfidenceSet | None = None,
    *,
    model: GliderModel | None = None,
    shares: Sequence[float] = _START_SHARES,
) -> Trial:
    """Flies from random points of the boundary.

    Args:
        samples: flights, divided among start times; at least one at each.
        gliders: set on whose edge the gliders are that fly; None for the funnel's own.
        model: another glider that flies alone; states that the funnel lacks start at
            rest.
        shares: of the duration: when flights start.

    Raises:
        InputError: the funnel is for held commands, or of gliders that deviate in other
            numbers.
    """
    made_for = funnel.allowed.names
    if gliders and made_for not in ((), gliders.names):
        raise InputError(
            f"The funnel is of gliders that deviate in {', '.join(made_for)}; those to "
            f"fly deviate in {', '.join(gliders.names) or 'nothing'}."
        )
    allowed = gliders or ALONE
    last = len(funnel.nominal.times) - 1
    deviations = []
    levels = []
    for number, share in enumerate(shares):
        k = min(round(share * last), last - 1)
        more = number < samples % len(shares)
        count = max(1, samples // len(shares) + more)
        directions = normalized(rng.normal(size=(count, funnel.num_states)))
        at_edge = allowed.on_boundary(rng.normal(size=(count, allowed.dimension)))
        deviation = physical(funnel.nominal.model, allowed.names, at_edge)
        own = deviation if gliders else None
        states = _boundary_states(funnel, k, directions, own)
        V, _ = _fly_from(funnel, k, states, model, allowed.names, own)
        V = np.where(np.isfinite(V), V, np.inf)  # What diverges is the worst.
        deviations.append(deviation)
        levels.append([V.max(axis=1), V[:, -1]])
    largest, ends = np.concatenate(levels, axis=1)
    return Trial(deviations=np.concatenate(deviations), levels=largest, ends=ends)


def _boundary_states(
    funnel: Funnel, k: int, directions: np.ndarray, deviation: np.ndarray | None = None
) -> np.ndarray:
    """Returns states (B, n) on the boundary at a time, given unit vectors (B, n).

    Those of gliders of the funnel's set, (m,) or (B, m), are about their own centers.
    """
    states = funnel.nominal.states[k] + directions @ to_ball(funnel.S[k])[1].T
    if deviation is not None and funnel.is_of_set:
        states = states + deviation @ funnel.gliders.shifts[k].T
    return states


def _fly_from(
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


def draw_inside(funnel: Funnel, count: int, rng: np.random.Generator) -> np.ndarray:
    """Draws launches (count, n) that are uniform in the inlet."""
    n = funnel.num_states
    points = normalized(rng.normal(size=(count, n)))
    points *= rng.uniform(size=(count, 1)) ** (1 / n)
    return _boundary_states(funnel, 0, points)


def fly_inside(funnel: Funnel, count: int, rng: np.random.Generator) -> np.ndarray:
    """Flies launches that are uniform in the inlet; returns paths (count, T, n)."""
    return _fly_from(funnel, 0, draw_inside(funnel, count, rng))[1]
