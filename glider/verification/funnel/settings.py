"""Settings of a funnel: its goal, margins and steps; the goal of a hook."""

import dataclasses
import math

import numpy as np

from glider.errors import InputError, expect
from glider.physics.state import NUM_STATES, PITCH, POSITION, STATE_NAMES, VELOCITY
from glider.planning.problem import Hook, PerchingProblem

LAUNCH_SIZES = (0.02, 0.1, 0.05, 0.1, 0.1, 0.2, 0.6)
"""Launch errors that count equally where a high inlet is wanted, as `launch_sizes`."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class FunnelSettings:
    """The goal at the wire and how the funnel towards it is computed.

    The names are keys in a funnel's file. Tuples are in the order of STATE_NAMES, in
    [m, rad, m/s, rad/s].
    """

    #: Half-axes of the goal about the nominal's end. A hook reaches that far; the
    #: speeds are such that the Taylor polynomial still fits there.
    goal: tuple[float, ...] = (Hook().reach, Hook().reach, 0.5, 0.39, 0.82, 0.82, 2.0)
    #: Half-axis of the goal in each of the effects' own states, in its unit.
    goal_extra: float = 4.0
    #: Deviations that count equally: what the shape of the funnel trades against each
    #: other. It is not sensitive to them, but diverges without any.
    sizes: tuple[float, ...] = (0.05, 0.05, 0.15, 0.3, 0.3, 0.3, 1.0)
    #: Launch errors that count equally: carried along the flight, they shape the funnel
    #: together with a share of `sizes`; None for `sizes` alone, at all times.
    #: LAUNCH_SIZES makes an inlet that is wider in all but the elevator.
    launch_sizes: tuple[float, ...] | None = None
    #: Deviation that counts as much, of each of the effects' own states.
    sizes_extra: float = 2.0
    step: float = 0.0045  #: Longest step between the times that are certified [s].
    #: Time between the programs that shape the funnel [s]. More is faster and narrower:
    #: with 0.026, one times the remainder leaves less than 9 cm of height.
    hold: float = 0.022
    margin: float = 0.03  #: By which V̇/V is to stay below zero on the boundary [1/s].
    #: Factor on the largest Taylor remainder that is found, which then acts as a
    #: disturbance; 0 for a funnel of the Taylor polynomial alone. With less than 1.6,
    #: the proof that the true one is no larger takes many times as long.
    remainder: float = 0.0
    #: Share of the largest remainder that its bound keeps where the remainder is small.
    #: Less makes a funnel wider and its proof longer; with 1 the bound is constant.
    floor: float = 0.3
    #: Largest gain on the elevator's own deviation of a feedback that is made with the
    #: shape; 0 for the policy's own. 40 suits commands held for 20 ms [1/s].
    elevator_gain: float = 0.0
    command_error: float = 0.0  #: Largest error of the command, at any time [rad/s].
    #: Time that each command is held; 0 for a feedback that acts at all times [s].
    period: float = 0.0
    wind: float = 0.0  #: Largest wind beyond the model's own, at any time [m/s].

    def __post_init__(self):
        """Raises InputError where a setting is out of range."""
        vector = f"{NUM_STATES} positive numbers ({', '.join(STATE_NAMES)})"
        for name in ("goal", "sizes", "launch_sizes"):
            values = getattr(self, name)
            if name != "launch_sizes" or values is not None:
                good = all(0.0 < value < math.inf for value in values)
                good = good and len(values) == NUM_STATES
                expect(good, f"field '{name}'", values, vector)
        for name in ("goal_extra", "sizes_extra", "step", "hold", "margin", "floor"):
            value = getattr(self, name)
            words = "a positive number"
            expect(0.0 < value < math.inf, f"field '{name}'", value, words)
        for name in ("remainder", "elevator_gain", "command_error", "wind", "period"):
            value = getattr(self, name)
            words = "a number that is zero or positive"
            expect(0.0 <= value < math.inf, f"field '{name}'", value, words)
        good = self.remainder > 0.0 or not (self.pushes.any() or self.period)
        words = "a positive number where there is a command_error, wind or period"
        expect(good, "field 'remainder'", self.remainder, words)

    @property
    def pushes(self) -> np.ndarray:
        """Bounds (2,) of the command's error [rad/s] and of the wind [m/s]."""
        return np.array([self.command_error, self.wind])

    def goal_axes(self, num_states: int) -> np.ndarray:
        """Returns the goal's half-axes (n,), the effects' own states included."""
        return np.append(self.goal, [self.goal_extra] * (num_states - NUM_STATES))

    def size_axes(self, num_states: int) -> np.ndarray:
        """Returns the sizes (n,), the effects' own states included."""
        return np.append(self.sizes, [self.sizes_extra] * (num_states - NUM_STATES))


_HOOK_MARGIN = 1e-6
"""Margin to the hook's limits [m, m/s, rad], which are compared in floating point."""


def hook_goal(
    axes: tuple[float, ...], end: np.ndarray, problem: PerchingProblem
) -> tuple[float, ...]:
    """Returns the half-axes (7,) of the goal that fills what a problem's hook accepts.

    Distance, speed and pitch in the ellipsoid are at most those of its center, the
    nominal's end, and the longest of their half-axes together. Of the given axes, those
    of the elevator and the pitch's rate are kept.

    Raises:
        InputError: the hook does not take the nominal's end itself.
    """
    hook = problem.hook
    low, high = hook.pitch_limits
    pitch = float(end[PITCH])
    miss = float(np.linalg.norm(end[POSITION] - problem.wire))
    speed = float(np.linalg.norm(end[VELOCITY]))
    limits = {
        "distance from the wire": (miss, hook.reach - miss, POSITION),
        "speed": (speed, hook.speed_limit - speed, VELOCITY),
        "pitch": (pitch, min(pitch - low, high - pitch), [PITCH]),
    }
    goal = np.array(axes, dtype=float)
    for name, (value, left, of) in limits.items():
        if left <= _HOOK_MARGIN:
            raise InputError(
                f"The flight ends with a {name} of {value:.4g}, which the hook does "
                "not accept; expected a plan that ends within its limits."
            )
        goal[of] = left - _HOOK_MARGIN
    return tuple(map(float, goal))
