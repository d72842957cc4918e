"""Settings of a funnel: its goal, margins and steps."""

import dataclasses
import math

import numpy as np

from glider.errors import InputError, show
from glider.physics.state import NUM_STATES, STATE_NAMES
from glider.planning.problem import Hook

LAUNCH_SIZES = (0.02, 0.1, 0.05, 0.1, 0.1, 0.2, 0.6)
"""Errors of a launch that matter alike where height is what is wanted, in the order of
STATE_NAMES [m, rad, m/s, rad/s]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class FunnelSettings:
    """The goal at the wire and how the funnel towards it is computed.

    The names are keys in a funnel's file.
    """

    goal: tuple[float, ...] = (Hook().reach, Hook().reach, 0.5, 0.39, 0.82, 0.82, 2.0)
    """Half-axes of the goal ellipsoid about the nominal's end, in the order of
    STATE_NAMES [m, rad, m/s, rad/s]. A hook reaches so far; the speeds are
    chosen so that the Taylor polynomial still fits there."""

    goal_extra: float = 4.0
    """Half-axis of the goal in each of the effects' own states, in its unit."""

    sizes: tuple[float, ...] = (0.05, 0.05, 0.15, 0.3, 0.3, 0.3, 1.0)
    """Deviations that matter alike, in the order of STATE_NAMES [m, rad, m/s, rad/s]:
    what the shape of the funnel trades against each other. It is not sensitive to
    them, but without any it runs away."""

    launch_sizes: tuple[float, ...] | None = None
    """Errors of a launch that matter alike, in the order of STATE_NAMES [m, rad, m/s,
    rad/s]: what becomes of them on the flight shapes the funnel, and a share of `sizes`
    (`glider.verification.funnel.sizes`). None for `sizes` alone, the same at all times.
    LAUNCH_SIZES makes an inlet that is wider in all but the elevator."""

    sizes_extra: float = 2.0
    """Deviation that matters like these, of each of the effects' own states."""

    step: float = 0.0045
    """Longest step between the times that are certified [s]."""

    hold: float = 0.022
    """Time between the programs that shape the funnel [s]. More is faster and narrower:
    with 0.026, one times the remainder leaves less than 9 cm of height."""

    margin: float = 0.03
    """Margin by which V̇/V is to stay below zero on the boundary [1/s]."""

    remainder: float = 0.0
    """Inflation: how many times the largest Taylor remainder that is found acts as a
    disturbance; 0 for a funnel of the Taylor polynomial alone. With 1.1 it can be
    proven that the true one is no larger, at all times."""

    elevator_gain: float = 0.0
    """Largest gain on the elevator's own deviation [1/s] of a feedback that is made
    with the funnel's shape, the steepest descent of V that the servo can follow
    (`glider.verification.funnel.feedback`); 0 for the policy's own feedback. 40 is
    slow enough for commands that are held for 20 ms."""

    def __post_init__(self):
        """Raises InputError where a setting is out of range."""
        for name in ("goal", "sizes", "launch_sizes"):
            values = getattr(self, name)
            if name == "launch_sizes" and values is None:
                continue
            if len(values) != NUM_STATES or not all(map(_is_positive, values)):
                raise InputError(
                    f"field '{name}' is {show(values)}; expected {NUM_STATES} positive "
                    f"numbers ({', '.join(STATE_NAMES)})."
                )
        for name in ("goal_extra", "sizes_extra", "step", "hold", "margin"):
            value = getattr(self, name)
            if not _is_positive(value):
                raise InputError(
                    f"field '{name}' is {show(value)}; expected a positive number."
                )
        for name in ("remainder", "elevator_gain"):
            value = getattr(self, name)
            if not (_is_positive(value) or value == 0.0):
                raise InputError(
                    f"field '{name}' is {show(value)}; expected a number that is "
                    "zero or positive."
                )

    def goal_axes(self, num_states: int) -> np.ndarray:
        """Returns the goal's half-axes (n,), the effects' own states included."""
        return np.append(self.goal, [self.goal_extra] * (num_states - NUM_STATES))

    def launch_axes(self, num_states: int) -> np.ndarray:
        """Returns the launch's sizes (n,): 0 for the effects' own states, at rest."""
        given = self.launch_sizes or (0.0,) * NUM_STATES
        return np.append(given, [0.0] * (num_states - NUM_STATES))

    def size_axes(self, num_states: int) -> np.ndarray:
        """Returns the sizes (n,), the effects' own states included."""
        return np.append(self.sizes, [self.sizes_extra] * (num_states - NUM_STATES))


def _is_positive(value: float) -> bool:
    return 0.0 < value < math.inf
