"""The making of a funnel: shape it, scale it, certify it at every time."""

import dataclasses
import functools
import time
from collections.abc import Callable

import numpy as np
from threadpoolctl import threadpool_limits

from glider.control.tvlqr import TrackingPolicy
from glider.errors import InputError
from glider.physics.model import GliderModel
from glider.planning.problem import PerchingProblem
from glider.verification.dynamics.confidence import ConfidenceSet
from glider.verification.dynamics.moving_center import make_moving_center
from glider.verification.dynamics.nominal import make_nominal
from glider.verification.funnel.funnel import Funnel
from glider.verification.funnel.growth import BoundaryForms
from glider.verification.funnel.remainder import SAMPLES
from glider.verification.funnel.scaling import Gauge
from glider.verification.funnel.settings import FunnelSettings, hook_goal
from glider.verification.funnel.shape_flow import ShapeFlow
from glider.verification.sos.programs import (
    SOLVERS,
    SolverError,
    first_success,
    largest_margin,
)
from glider.verification.sos.sphere import (
    least_eigenvalue,
    nearby_gram,
    normalized,
    represent,
    sphere,
)

Progress = Callable[[str], None]

EIGENVALUE_SHARE = 0.1
"""Least eigenvalue of a Gram matrix, as a share of the margin of V̇/V. On the sphere
bᵀb = 2, so that all of the margin would be a half."""


@threadpool_limits.wrap(limits=1, user_api="blas")  # Small matrices.
def make_funnel(
    model: GliderModel,
    policy: TrackingPolicy,
    settings: FunnelSettings | None = None,
    *,
    confidence: ConfidenceSet | None = None,
    hook_of: PerchingProblem | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> Funnel:
    """Computes the funnel of a feedback along its plan.

    Args:
        model: the glider that the plan is for.
        policy: the feedback, e.g. of `glider.control.tvlqr.tracking_policy`.
        settings: goal and margins.
        confidence: set of gliders that are to stay, each in the funnel about its own
            center; None for the model's own. Needs a `remainder`.
        hook_of: problem whose hook is to accept every state of the last set
            (`hook_goal`); None for the goal of the settings.
        seed: of the points where remainder and growth are sampled.
        progress: called with the current stage.

    Raises:
        InputError: there can be no funnel about this flight.
        SolverError: the sets could not be certified.
    """
    say = progress or (lambda text: None)
    settings = settings or FunnelSettings()
    began = time.perf_counter()
    rng = np.random.default_rng(seed)
    say("funnel: the flight and its Taylor polynomials")
    if confidence and settings.remainder == 0.0:
        raise InputError(
            "A funnel of a confidence set accounts for the differences of its gliders "
            "by a remainder: 'remainder' is 0; expected a positive number."
        )
    nominal = make_nominal(model, policy, settings.step)
    if hook_of is not None:
        goal = hook_goal(settings.goal, nominal.states[-1], hook_of)
        settings = dataclasses.replace(settings, goal=goal)
    n = nominal.states.shape[1]
    total = n + (confidence.dimension if confidence else 0)
    directions = normalized(rng.normal(size=(SAMPLES, total)))
    if settings.elevator_gain > 0.0:
        own = normalized(directions[:, :n])
        steered = ShapeFlow(nominal, settings, own, steer=True)
        _shape(steered, say, "feedback")
        nominal = dataclasses.replace(steered.nominal)  # Expanded again, as a whole.
    center = make_moving_center(nominal, confidence) if confidence else None
    parts = nominal, settings, directions, center
    S = _shape(ShapeFlow(*parts), say, "shape")
    say("funnel: its size")
    sets, forms = Gauge(*parts).scaled(S)
    say("funnel: its certificate")
    grams = certify(nominal.times, forms, settings.margin)
    return Funnel(
        **{field.name: getattr(sets, field.name) for field in dataclasses.fields(sets)},
        settings=settings,
        grams=grams,
        solver=next(iter(SOLVERS)),
        seconds=time.perf_counter() - began,
        gliders=center,
    )


def _shape(flow: ShapeFlow, say: Progress, what: str) -> np.ndarray:
    """Returns S (T, n, n) of a flow."""
    try:
        return flow.run(lambda share: say(f"funnel: its {what}, {100.0 * share:.0f} %"))
    except np.linalg.LinAlgError:
        raise SolverError("The funnel vanishes; a tighter goal may help.") from None


def certify(times: np.ndarray, forms: BoundaryForms, margin: float) -> np.ndarray:
    """Returns a Gram matrix (T, E) of -V̇/V on the boundary, at each time.

    The first comes from a solver, the others from their neighbors, and again from a
    solver where that fails.

    Args:
        times: (T,) [s].
        margin: of V̇/V; the least eigenvalues are EIGENVALUE_SHARE of it [1/s].

    Raises:
        SolverError: at some time -V̇/V is no sum of squares.
    """
    tables = sphere(forms.quadratic.shape[1])
    polynomials = tables.coefficients(-forms.quadratic, -forms.cubic, -forms.quartic)
    least = EIGENVALUE_SHARE * margin
    grams = np.zeros((len(polynomials), len(tables.rows)))
    before: np.ndarray | None = None
    for k in range(len(polynomials) - 1, -1, -1):
        gram = None
        if before is not None:
            closest = functools.partial(represent, tables, coefficients=polynomials[k])
            gram = nearby_gram(tables, before, closest, least)
        if gram is None:
            gram = _solve(tables, polynomials[k])
            if least_eigenvalue(tables, gram) < least:
                raise SolverError(
                    f"The funnel is not certified at {times[k]:.3f} s; a larger margin "
                    "or another seed may help."
                )
        grams[k] = before = gram
    return grams


def _solve(tables, polynomial):
    """Returns a Gram matrix (E,) of a polynomial, its margin shared out evenly."""
    fault = "No solver certified the funnel."
    margin, gram = first_success(largest_margin, polynomial, tables.n, fault=fault)
    even = 0.5 * margin * tables.entries(np.eye(tables.size))
    return represent(tables, gram + even, polynomial)
