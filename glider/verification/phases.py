"""Funnels for any phase between clock and launch, made as `proof.phases` has them."""

import dataclasses
from collections.abc import Callable

import numpy as np

from glider.control.tvlqr import TrackingPolicy, still_policy
from glider.errors import InputError, expect
from glider.physics.confidence import ConfidenceSet
from glider.physics.model import GliderModel
from glider.planning.problem import PerchingProblem
from glider.progress import Progress, silent
from glider.verification.dynamics.nominal import make_nominal
from glider.verification.funnel.build import make_funnel
from glider.verification.funnel.funnel import Funnel
from glider.verification.funnel.settings import FunnelSettings
from glider.verification.proof import phases as proof

SIZES = (0.01, 0.1, 0.025, 0.05, 0.05, 0.1, 0.3)
"""Errors when the first command acts that count equally [m, rad, m/s, rad/s]."""

_ROUNDS, _ROOM = 6, 0.98
"""Tries to make the launch funnel, two as a rule, and the size of its sets relative to
what would just fit, of the shapes of the try before."""


def make_phases(
    model: GliderModel,
    policy_of: Callable[[PerchingProblem], TrackingPolicy],
    problem: PerchingProblem,
    settings: FunnelSettings,
    *,
    latency: float,
    confidence: ConfidenceSet | None = None,
    count: int = 4,
    sizes: tuple[float, ...] = SIZES,
    progress: Progress = silent,
) -> tuple[Funnel, list[Funnel]]:
    """Computes a launch funnel, and funnels of held commands for phases of the clock.

    Args:
        model: the glider.
        policy_of: plans a problem and returns its feedback.
        problem: launch, wire and hook, which is to accept every state of the last sets.
        settings: of the funnels of held commands; `period` must not be 0.
        latency: time from the clock's sample to its command, which is predicted [s].
        confidence: set of gliders that they are made for, if not for the model alone.
        count: number of phases that have a funnel of their own.
        sizes: ratio of the half-axes of the launch funnel's last set.
        progress: called with the current stage.

    Raises:
        InputError: there can be no such funnels.
        SolverError: the sets could not be certified.
    """
    period = settings.period
    states = len(model.state_names)
    expect(count >= 1, "the number of phases", count, "at least 1")
    expect(period > 0.0, "field 'period'", period, "more than 0 s")
    words = "0 or more, and less than the period"
    expect(0.0 <= latency < period, "the latency", latency, words)
    words = "none of the effects' own"
    expect(states == len(sizes), "the glider's states", states, words)
    bin_ = period / count
    rests = []
    waiting = still_policy(model, problem, latency + period)
    path = make_nominal(model, waiting, 0.5 * bin_).path
    for k in range(count):
        progress(f"the funnel of phase {k + 1} of {count}")
        start = path(latency + (k + 0.5) * bin_).tolist()
        policy = policy_of(dataclasses.replace(problem, launch=start))
        rests.append(
            make_funnel(
                model,
                policy,
                settings,
                hook_of=problem,
                confidence=confidence,
                progress=progress,
            )
        )
    still = dataclasses.replace(settings, period=0.0, elevator_gain=0.0, floor=1.0)
    own = dataclasses.replace(still, step=0.5 * bin_, sizes=sizes, launch_sizes=None)
    return _launch_funnel(model, waiting, own, rests, confidence, progress), rests


def _launch_funnel(model, waiting, settings, rests, confidence, progress):
    """Returns the largest funnel of a flight without commands that leads to others."""
    sizes = settings.sizes
    axes = np.diag(settings.sizes)
    widest = [np.linalg.norm(axes @ own.S[0] @ axes, 2) for own in rests]
    scale = 1.0 / np.sqrt(min(widest))  # As if they had one center.
    for _ in range(_ROUNDS):
        goal = tuple((scale * np.array(sizes)).tolist())
        shaped = dataclasses.replace(settings, goal=goal)
        found = make_funnel(
            model, waiting, shaped, confidence=confidence, progress=progress
        )
        if not proof.phase_faults(found, rests):
            return found
        progress("launch funnel: its size")
        scale *= _ROOM * _largest_scale(found, rests)
        if scale == 0.0:
            break
    raise InputError(
        "No launch funnel leads into the phases' funnels; more phases may help."
    )


def _largest_scale(found, rests):
    """Returns the factor by which sets fit into the others' inlets, 1 at most."""
    low = 0.0
    high = 1.0
    for _ in range(10):
        scale = 0.5 * (low + high)
        sets = {"S": found.S / scale**2, "slopes": found.slopes / scale**2}
        scaled = dataclasses.replace(found, **sets)
        pieces = [scaled.between(k, k + 1) for k in proof.phase_intervals(found, rests)]
        fits = all(
            any(proof.is_inside(piece, own) for own in rests) for piece in pieces
        )
        low, high = (scale, high) if fits else (low, scale)
    return low


def rest_for(rests: list[Funnel], state: np.ndarray) -> Funnel:
    """Returns the funnel of held commands in which a state (n,) has the least V.

    It is the state in which the first command will begin to act, predicted if need be.
    """
    return rests[proof.choose(rests, state)]
