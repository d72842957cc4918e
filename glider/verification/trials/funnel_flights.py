"""Flights in a funnel: of the true dynamics, under the funnel's own feedback.

True means: the full physics, not its Taylor polynomial, and the servo with its limits.
"""

import numpy as np

from glider.control.tvlqr import TrackingPolicy
from glider.errors import InputError
from glider.physics.model import GliderModel
from glider.planning.plan import Plan
from glider.simulation.fly import fly
from glider.verification.funnel.funnel import Funnel
from glider.verification.sos.forms import to_ball
from glider.verification.sos.sphere import normalized


def funnel_policy(funnel: Funnel, first: int = 0) -> TrackingPolicy:
    """Returns the feedback of a funnel from one of its times on, as a policy."""
    nominal = funnel.nominal
    if not 0 <= first < len(nominal.times) - 1:
        raise InputError(f"There is no flight from the funnel's time {first} on.")
    times = nominal.times[first:] - nominal.times[first]
    plan = Plan(
        times=times,
        states=nominal.states[first:],
        slopes=nominal.slopes[first:],
        inputs=nominal.inputs[first:],
        state_names=nominal.state_names,
        cost=0.0,
        max_defect=0.0,
        path_defect=0.0,
    )
    return TrackingPolicy(
        plan=plan,
        times=times,
        gains=nominal.gains[first:],
        corrections=np.zeros(len(times)),
        cost=funnel.S[first:],
        cost_slope=np.zeros((len(times), funnel.num_states)),
        is_linear=True,
    )


def fly_from(
    funnel: Funnel,
    first: int,
    states: np.ndarray,
    model: GliderModel | None = None,
    deviation: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Flies states (B, n) from one of the funnel's times to its end.

    Args:
        model: the glider that flies; the funnel's own if None.
        deviation: δ (m,) of that glider in the funnel's set; V is then about its own
            center. None: about the nominal.

    Returns:
        V of each at the funnel's times from `first` on, (B, T - first), and the
        paths (B, T - first, n'), n' the states of the glider that flies.
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
    known = paths[..., : funnel.num_states]
    if deviation is not None and funnel.gliders:
        known = known - funnel.gliders.at(times, deviation)
    return funnel.level(times, known), paths


def boundary_states(
    funnel: Funnel, k: int, directions: np.ndarray, deviation: np.ndarray | None = None
) -> np.ndarray:
    """Returns states (B, n) on the boundary at a time, given unit vectors (B, n).

    Those of a glider of the funnel's set are about its own center.
    """
    states = funnel.nominal.states[k] + directions @ to_ball(funnel.S[k])[1].T
    if deviation is not None and funnel.gliders:
        states = states + funnel.gliders.shifts[k] @ deviation
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
