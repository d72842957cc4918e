"""Steps short enough for the explicit integrators: effects have states of their own.

Such a state may be far quicker than the glider: a servo that follows its command with a
lag τ forgets at the rate 1/τ, and a traced model may well have a τ of half a
millisecond. Runge-Kutta's steps must be short beside that, or they swing up without
bound, however slowly the glider itself turns.
"""

import math

from glider.errors import InputError, show
from glider.physics.model import GliderModel
from glider.physics.state import NUM_STATES

STABLE = {1: 1.0, 4: 2.0}
"""Longest step times the largest rate |λ| of the effects' own states, by the order of
the integrator: 1 for explicit Euler, 4 for the classical Runge-Kutta.

Within it a state that forgets does so: with Runge-Kutta at any damping, with Euler at
one above a half. For a real λ they are stable to 2 and to 2.79."""

SHORTEST = 2e-5
"""Shortest step that is worth its time [s]: 1000 of them to a command."""


def longest_step(model: GliderModel, order: int = 4) -> float:
    """Returns the longest step that a model's own states allow, infinite without any.

    Args:
        model: the glider.
        order: of the integrator, 1 or 4.

    Raises:
        InputError: it is so short that the effect should be omitted.
    """
    if not model.settling_rate > 0.0:
        return math.inf
    step = STABLE[order] / model.settling_rate
    if step < SHORTEST:
        states = ", ".join(model.state_names[NUM_STATES:])
        raise InputError(
            f"the model's effects have states ({states}) of which one settles within "
            f"{show(1.0 / model.settling_rate)} s; expected at least "
            f"{SHORTEST / STABLE[order]:g} s, or a model without that effect, which "
            "flies the same."
        )
    return step


def count_laps(model: GliderModel, step: float, order: int = 4) -> int:
    """Returns into how many equal steps a model's own states divide one.

    Args:
        model: the glider.
        step: [s].
        order: of the integrator, 1 or 4.

    Raises:
        InputError: as in `longest_step`.
    """
    return max(math.ceil(step / longest_step(model, order) - 1e-9), 1)
