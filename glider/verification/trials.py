"""Flights of the full dynamics that try to leave a funnel; they prove nothing.

Full means: the physics, not its Taylor polynomial, and the servo with its limits. The
feedback acts at all times, as in the theorem.
"""

import numpy as np

from glider.physics.model import GliderModel
from glider.simulation.fly import check_states, full_starts
from glider.verification.dynamics.nominal import fly_plan
from glider.verification.funnel.funnel import Funnel, funnel_policy
from glider.verification.sos.forms import to_ball
from glider.verification.sos.sphere import normalized

ESCAPE_LEVEL = 1.005
"""Level V that only flights which have left the funnel exceed: from 1, rounding and
integration take others to 1 + 1e-6."""

_STARTS = 8
"""Times when flights start, equally far apart."""


def falsify_funnel(
    funnel: Funnel,
    samples: int,
    rng: np.random.Generator,
    model: GliderModel | None = None,
) -> np.ndarray:
    """Flies from random points of the boundary, at several times.

    Args:
        samples: flights, at least eight.
        model: the glider that flies; None for the funnel's own. States that the funnel
            lacks start at rest.

    Returns:
        the largest V (samples,) of each flight: infinite where it diverges; above
        `ESCAPE_LEVEL` where it leaves.

    Raises:
        InputError: the funnel is for held commands.
    """
    last = len(funnel.nominal.times) - 1
    starts = np.linspace(0, last, _STARTS, endpoint=False).astype(int)
    levels = []
    for k, own in zip(starts, np.array_split(np.arange(samples), _STARTS), strict=True):
        directions = normalized(rng.normal(size=(len(own), funnel.num_states)))
        paths = fly_from(funnel, k, boundary_states(funnel, k, directions), model)
        V = funnel.level(funnel.nominal.times[k:], paths[..., : funnel.num_states])
        largest = np.max(V, axis=1)
        levels.append(np.where(np.isfinite(largest), largest, np.inf))
    return np.concatenate(levels)


def boundary_states(funnel: Funnel, k: int, directions: np.ndarray) -> np.ndarray:
    """Returns states (B, n) on the boundary at a time, given unit vectors (B, n)."""
    return funnel.nominal.states[k] + directions @ to_ball(funnel.S[k])[1].T


def fly_from(
    funnel: Funnel, first: int, states: np.ndarray, model: GliderModel | None = None
) -> np.ndarray:
    """Flies states (B, n) from one of the funnel's times to its end.

    Returns:
        paths (B, T - first, n'), n' the states of the glider that flies: the funnel's
        own if no other does.
    """
    model = model or funnel.nominal.model
    policy = funnel_policy(funnel, first)
    check_states(model, policy)
    times = funnel.nominal.times[first:]
    step = 0.5 * (times[1] - times[0])
    return fly_plan(model, policy, full_starts(model, states), len(times) - 1, step)


def draw_inside(funnel: Funnel, count: int, rng: np.random.Generator) -> np.ndarray:
    """Draws launches (count, n) that are uniform in the inlet."""
    n = funnel.num_states
    points = normalized(rng.normal(size=(count, n)))
    points *= rng.uniform(size=(count, 1)) ** (1 / n)
    return boundary_states(funnel, 0, points)


def fly_inside(funnel: Funnel, count: int, rng: np.random.Generator) -> np.ndarray:
    """Flies launches that are uniform in the inlet; returns paths (count, T, n)."""
    return fly_from(funnel, 0, draw_inside(funnel, count, rng))
