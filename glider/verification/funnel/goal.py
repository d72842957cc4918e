"""The goal at the wire: half-axes of an ellipsoid about the nominal's end.

A goal for the hook holds only states that the problem's hook takes: within its reach
of the wire, slow enough, and with a pitch at which its mouth meets the wire.
"""

import numpy as np

from glider.errors import InputError
from glider.physics.state import STATE_NAMES, VELOCITY
from glider.planning.problem import PerchingProblem

ROOM = 1e-6
"""Room that is left of each of the hook's limits [m, m/s, rad]: how far it takes a
glider is compared in floating point."""

_X, _Z, _PITCH = (STATE_NAMES.index(name) for name in ("x", "z", "pitch"))


def hook_goal(
    axes: tuple[float, ...], end: np.ndarray, problem: PerchingProblem
) -> tuple[float, ...]:
    """Returns the half-axes (7,) of the goal that fills what the problem's hook takes.

    The largest distance, speed and pitch in an ellipsoid with axes along the states are
    at most those of its center and the longest of their half-axes together.

    Args:
        axes: (7,) half-axes, in the order of STATE_NAMES, of which those of what the
            hook does not ask for are kept: of the elevator and the pitch's rate.
        end: (7 or more) state at the nominal's end.
        problem: whose hook and wire.

    Raises:
        InputError: the hook does not take the nominal's end itself.
    """
    hook = problem.hook
    low, high = hook.pitch_limits
    pitch, place = float(end[_PITCH]), [_X, _Z]
    miss = float(np.linalg.norm(end[place] - problem.wire))
    speed = float(np.linalg.norm(end[VELOCITY]))
    room = {
        "distance from the wire": (miss, hook.reach - miss, place),
        "speed": (speed, hook.speed_limit - speed, VELOCITY),
        "pitch": (pitch, min(pitch - low, high - pitch), [_PITCH]),
    }
    goal = np.array(axes, dtype=float)
    for name, (value, left, of) in room.items():
        if left <= ROOM:
            raise InputError(
                f"The flight ends with a {name} of {value:.4g}, which the hook does "
                "not take: a plan is needed that ends within its limits."
            )
        goal[of] = left - ROOM
    return tuple(map(float, goal))
