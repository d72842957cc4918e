"""Computes a funnel: shape it, scale it, certify it at every time."""

import time
from collections.abc import Callable

import numpy as np
from scipy.interpolate import CubicSpline
from threadpoolctl import threadpool_limits

from glider.control.policy import TrackingPolicy
from glider.physics.model import GliderModel
from glider.verification.dynamics.error_dynamics import expand
from glider.verification.dynamics.nominal import make_nominal
from glider.verification.funnel.between import (
    SHARES,
    Between,
    growth_of,
)
from glider.verification.funnel.descent import (
    boundary_forms,
    scale_funnel,
)
from glider.verification.funnel.funnel import Funnel
from glider.verification.funnel.limits import (
    room,
    servo_bounds,
)
from glider.verification.funnel.remainder import (
    SAMPLES,
    remainder_form,
    remainder_weights,
    sample_remainder,
)
from glider.verification.funnel.settings import FunnelSettings
from glider.verification.funnel.shape_flow import (
    NOISE,
    ShapeFlow,
)
from glider.verification.sos.grams import (
    least_eigenvalue,
    nearby_gram,
    represent,
)
from glider.verification.sos.programs import (
    SOLVERS,
    largest_margin,
)
from glider.verification.sos.solving import (
    SolverError,
    solve_apart,
)
from glider.verification.sos.sphere import sphere

Progress = Callable[[str], None]

PERSISTENCE = 0.1
"""Least eigenvalue of a Gram matrix, as a share of the margin in V̇/V. On the sphere
bᵀb = 2, so that all of it would be a half."""


SAMPLE_EVERY = 4
"""Times between which the remainder is sampled; it goes on in a straight line."""

STARTS = 12
"""Of the ascent to the largest growth, besides the axes of its quadratic part."""


@threadpool_limits.wrap(limits=1, user_api="blas")  # Small matrices.
def make_funnel(
    model: GliderModel,
    policy: TrackingPolicy,
    settings: FunnelSettings | None = None,
    *,
    seed: int = 0,
    progress: Progress | None = None,
) -> Funnel:
    """Computes the funnel of a feedback along its plan.

    Args:
        model: the glider that the plan is for.
        policy: the feedback, e.g. of `glider.control.tvlqr.compiled_policy`.
        settings: goal and margins.
        seed: of the points where remainder and growth are sampled.
        progress: told what is being done.

    Raises:
        InputError: there can be no funnel about this flight.
        SolverError: the sets could not be certified.
    """
    say = progress or (lambda text: None)
    settings = settings or FunnelSettings()
    began = time.perf_counter()
    rng = np.random.default_rng(seed)
    say("funnel: the flight and its Taylor polynomials")
    nominal = make_nominal(model, policy, settings.step)
    coefficients = expand(nominal)
    count, n = nominal.states.shape
    every = np.arange(count)
    some = np.unique(np.append(every[::SAMPLE_EVERY], count - 1))
    directions = rng.normal(size=(SAMPLES, n))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    sizes = settings.size_axes(n)

    flow = ShapeFlow(nominal, coefficients, settings, directions)
    try:
        S = flow.run(lambda share: say(f"funnel: its shape, {100.0 * share:.0f} %"))
    except np.linalg.LinAlgError:
        raise SolverError("The funnel vanishes; a tighter goal may help.") from None

    def beta_of(S):
        if settings.remainder == 0.0:
            return np.zeros((count, n))
        beta = sample_remainder(nominal, coefficients, S[some], directions, some)
        beta = np.array([np.interp(every, some, b) for b in beta.T]).T
        return settings.remainder * np.where(beta > NOISE, beta, 0.0)

    def room_of(S):
        return room(S, *servo_bounds(nominal))

    starts = directions[:STARTS]
    inner = [Between(nominal, share) for share in SHARES]

    def forms_of(S):
        """Returns the forms at the times and what they were made of."""
        slopes = CubicSpline(nominal.times, S)(nominal.times, 1)
        beta = beta_of(S)
        weights = remainder_weights(S, beta, sizes)
        disturbance = remainder_form(S, beta, weights)
        return boundary_forms(S, slopes, coefficients, disturbance), (
            slopes,
            beta,
            weights,
        )

    def growth_at(S):
        forms, (slopes, beta, weights) = forms_of(S)
        growth, _ = growth_of(forms, starts)
        # Between the times it is looked for only where it is good at them.
        for between in inner if growth.max() < 0.0 else ():
            found = between.growth(S, slopes, beta, weights, starts)
            growth[1:] = np.maximum(growth[1:], found)
            growth[:-1] = np.maximum(growth[:-1], found)
        return growth

    say("funnel: its size")
    try:
        S = scale_funnel(nominal.times, S, growth_at, room_of, settings.margin)
    except np.linalg.LinAlgError:
        raise SolverError(
            "The funnel changes too fast between its times; a shorter step may help."
        ) from None
    forms, (slopes, beta, weights) = forms_of(S)
    say("funnel: its certificate")
    grams = certify(nominal.times, forms, settings.margin)
    return Funnel(
        nominal=nominal,
        settings=settings,
        S=S,
        slopes=slopes,
        beta=beta,
        weights=weights,
        grams=grams,
        solver=next(iter(SOLVERS)),
        seconds=time.perf_counter() - began,
    )


def certify(times: np.ndarray, forms: tuple, margin: float) -> np.ndarray:
    """Returns a Gram matrix (T, E) of -V̇/V on the boundary, at each time.

    The first comes from a solver, the others from their neighbors, and again from a
    solver where that fails.

    Raises:
        SolverError: at some time -V̇/V is no sum of squares.
    """
    quadratic, cubic, quartic = forms
    n = quadratic.shape[1]
    tables = sphere(n)
    polynomials = tables.coefficients(-quadratic, -cubic, -quartic)
    least = PERSISTENCE * margin
    grams = np.zeros((len(polynomials), len(tables.rows)))
    before: np.ndarray | None = None
    for k in range(len(polynomials) - 1, -1, -1):
        gram = None
        if before is not None:
            gram = nearby_gram(tables, before, polynomials[k], least)
        if gram is None:
            gram = _solve(tables, polynomials[k])
            if least_eigenvalue(tables, gram) < least:
                raise SolverError(
                    f"The funnel is not certified at {times[k]:.3f} s; a larger margin "
                    "may help."
                )
        grams[k] = before = gram
    return grams


def _solve(tables, polynomial):
    for solver in SOLVERS:
        [(success, margin, gram)] = solve_apart(
            largest_margin, [(polynomial, tables.n, solver)]
        )
        if success and np.all(np.isfinite(gram)):
            spread = 0.5 * margin * tables.entries(np.eye(tables.size))
            return represent(tables, gram + spread, polynomial)
    raise SolverError("No solver certified the funnel.")
