"""The making of a funnel: shape it, scale it, certify it at every time.

The size of given shapes is that of the comparison equation: on the boundary of
{eᵀ S e <= ρ}, V̇/V <= h(t); the set stays one that nothing leaves as long as
    d(log ρ)/dt >= h(t),
integrated backward from ρ(T) = 1. Here h is found by ascent, and the set S/ρ is what is
then certified, with a margin.
"""

import dataclasses
import time

import numpy as np
from scipy.interpolate import CubicSpline
from threadpoolctl import threadpool_limits

from glider.control.tvlqr import TrackingPolicy
from glider.errors import InputError, expect
from glider.physics.confidence import ALONE, ConfidenceSet
from glider.physics.model import GliderModel
from glider.planning.problem import PerchingProblem
from glider.progress import Progress, silent
from glider.verification.dynamics.defect import defect_bounds, defect_growth
from glider.verification.dynamics.nominal import make_nominal
from glider.verification.funnel import servo_limits
from glider.verification.funnel.boundary import (
    BoundaryForms,
    BoundarySets,
    boundary_forms,
)
from glider.verification.funnel.funnel import Funnel
from glider.verification.funnel.growth import SHARES, growth_between, largest_growth
from glider.verification.funnel.remainder import SAMPLES
from glider.verification.funnel.settings import FunnelSettings, hook_goal
from glider.verification.funnel.shape_flow import FunnelTask, ShapeFlow
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

_ROUNDS = 40
"""Rounds of scaling: four or five as a rule, eleven where commands are held. For a set
of gliders of four numbers then, 14 were needed, and 31 for one of six."""

_MARGIN_SHARE = 0.6
"""Share of the margin that ends the rounds where it is reached at all times."""

_STARTS = 60
"""Points where the ascent to the largest growth starts, besides the axes of its
quadratic part. With 12, and none from neighbors in time, one funnel was not certified,
and another not proven between two times."""

_EIGENVALUE_SHARE = 0.1
"""Least eigenvalue of a Gram matrix over the margin of V̇/V; all of it would be 0.5."""


@threadpool_limits.wrap(limits=1, user_api="blas")  # Small matrices.
def make_funnel(
    model: GliderModel,
    policy: TrackingPolicy,
    settings: FunnelSettings | None = None,
    *,
    confidence: ConfidenceSet | None = None,
    hook_of: PerchingProblem | None = None,
    seed: int = 0,
    progress: Progress = silent,
) -> Funnel:
    """Computes the funnel of a feedback along its plan.

    Args:
        model: the glider that the plan is for.
        policy: the feedback, e.g. of `glider.control.tvlqr.tracking_policy`.
        settings: goal and margins.
        confidence: set of gliders that are to stay, each in the funnel about its own
            center; None for the model's own. Needs a `remainder`.
        hook_of: problem whose hook is to accept every state of the last set; None for
            the goal of the settings.
        seed: of the points where remainder and growth are sampled.
        progress: called with the current stage.

    Raises:
        InputError: there can be no funnel about this flight.
        SolverError: the sets could not be certified.
    """
    settings = settings or FunnelSettings()
    gain = settings.elevator_gain
    words = "a positive number, where commands are held for a 'period'"
    expect(gain > 0.0 or not settings.period, "field 'elevator_gain'", gain, words)
    began = time.perf_counter()
    rng = np.random.default_rng(seed)
    progress("funnel: the flight and its Taylor polynomials")
    allowed = confidence or ALONE
    if allowed.names and settings.remainder == 0.0:
        raise InputError(
            "A funnel of a confidence set accounts for the differences of its gliders "
            "by a remainder: 'remainder' is 0; expected a positive number."
        )
    nominal = make_nominal(model, policy, settings.step, settings.period)
    if hook_of is not None:
        goal = hook_goal(settings.goal, nominal.states[-1], hook_of)
        settings = dataclasses.replace(settings, goal=goal)
    n = model.num_states
    of_set = allowed.dimension
    of_pushes = 3 if settings.pushes.any() or settings.period else 0
    directions = normalized(rng.normal(size=(SAMPLES, n + of_set + of_pushes)))
    if gain > 0.0:
        own = normalized(np.delete(directions, np.s_[n : n + of_set], axis=1))
        steered = ShapeFlow(FunnelTask(nominal, settings, own), steer=True)
        _shape(steered, progress, "feedback")
        nominal = dataclasses.replace(steered.nominal)  # Expanded again, as a whole.
    task = FunnelTask(nominal, settings, directions, allowed)
    S = _shape(ShapeFlow(task), progress, "shape")
    progress("funnel: its size")
    sets, forms = _Gauge(task).scaled(S)
    progress("funnel: its certificate")
    grams = _certify(nominal.times, forms, settings.margin)
    made = {field.name: getattr(sets, field.name) for field in dataclasses.fields(sets)}
    return Funnel(
        **made,
        grams=grams,
        solver=next(iter(SOLVERS)),
        seconds=time.perf_counter() - began,
        gliders=task.center,
    )


def _shape(flow: ShapeFlow, say: Progress, what: str) -> np.ndarray:
    """Returns S (T, n, n) of a flow."""
    try:
        return flow.run(lambda share: say(f"funnel: its {what}, {100.0 * share:.0f} %"))
    except np.linalg.LinAlgError:
        raise SolverError("The funnel vanishes; a tighter goal may help.") from None


def _certify(times: np.ndarray, forms: BoundaryForms, margin: float) -> np.ndarray:
    """Returns a Gram matrix (T, E) of -V̇/V on the boundary, at each time.

    It comes from its neighbor, or from a solver where that fails. Least eigenvalues are
    _EIGENVALUE_SHARE of the margin [1/s].

    Raises:
        SolverError: at some time -V̇/V is no sum of squares.
    """
    tables = sphere(forms.quadratic.shape[1])
    polynomials = tables.coefficients(-forms.quadratic, -forms.cubic, -forms.quartic)
    least = _EIGENVALUE_SHARE * margin
    grams = np.zeros((len(polynomials), len(tables.rows)))
    gram: np.ndarray | None = None
    for k in range(len(polynomials) - 1, -1, -1):
        if gram is not None:
            gram = nearby_gram(tables, gram, polynomials[k], least)
        if gram is None:
            gram = _solve(tables, polynomials[k])
            if least_eigenvalue(tables, gram) < least:
                raise SolverError(
                    f"The funnel is not certified at {times[k]:.3f} s; a larger margin "
                    "or another seed may help."
                )
        grams[k] = gram
    return grams


def _solve(tables, polynomial):
    """Returns a Gram matrix (E,) of a polynomial, its margin shared out evenly."""
    fault = "No solver certified the funnel."
    margin, gram = first_success(largest_margin, polynomial, tables.n, fault=fault)
    even = 0.5 * margin * tables.entries(np.eye(tables.size))
    return represent(tables, gram + even, polynomial)


class _Gauge:
    """A gauge of sets S (T, n, n) along a flight: their growth, the servo's margin."""

    def __init__(self, task: FunnelTask):
        """Expands the dynamics between the times."""
        nominal = task.nominal
        self._task = task
        self._nominal = nominal
        self._starts = normalized(task.directions[:_STARTS, : nominal.states.shape[1]])
        self._between = {share: nominal.between(share) for share in SHARES}
        self._defect = defect_bounds(nominal)
        self._limits = servo_limits.servo_bounds(nominal, task.settings, task.center)

    def scaled(self, S: np.ndarray) -> tuple[BoundarySets, BoundaryForms]:
        """Returns sets of shapes S, scaled so that V̇/V < 0 on their boundary, and V̇/V.

        Raises:
            SolverError: the sets cannot be evaluated between their times.
        """
        if not np.all(np.isfinite(self._defect)):
            raise SolverError(
                "The plan's flight cannot be enclosed; a shorter step may help."
            )
        try:
            return self._sets(self._scale(S))
        except np.linalg.LinAlgError:
            raise SolverError(
                "The funnel changes too fast between its times; a shorter step may "
                "help."
            ) from None

    def _scale(self, S):
        times = self._nominal.times
        margin = self._task.settings.margin
        for turn in range(_ROUNDS):
            growth, (directions, limits) = self.growth(S), self._limits
            errors, _ = self._task.errors(S, np.arange(len(S)))
            left = limits - servo_limits.error_reach(errors)
            largest = servo_limits.margin_to_limits(S, directions, left)
            if growth.max() <= -_MARGIN_SHARE * margin and largest.min() >= 1.0 - 1e-9:
                break
            excess = growth + margin
            # At first as the equation says; then only what is still missing.
            excess = excess if turn == 0 else np.maximum(excess, 0.0)
            S = S / _levels(times, excess, largest)
        return S

    def _sets(self, S):
        """Returns sets with slopes of a cubic spline, and V̇/V on their boundaries."""
        times = self._nominal.times
        at = np.arange(len(S))
        holds = np.split(at, self._nominal.samples[1:])
        slopes = [CubicSpline(times[k], S[k])(times[k], 1) for k in holds]
        sets = self._task.sets(self._nominal, S, np.concatenate(slopes), at)
        forms = boundary_forms(sets, self._nominal.push_slopes)
        drift = defect_growth(S, self._defect)[:, None, None] * np.eye(S.shape[1])
        return sets, forms._replace(quadratic=forms.quadratic + drift)

    def growth(self, S: np.ndarray) -> np.ndarray:
        """Returns the largest V̇/V (T,) at and around each time [1/s]."""
        (sets, forms), starts = self._sets(S), self._starts
        growth = largest_growth(forms, starts)
        drift = defect_growth(S, self._defect)
        drift = np.maximum(drift[:-1], drift[1:])
        # Between the times it is looked for only where it is good at them.
        if growth.max() >= 0.0:
            return growth
        k = self._nominal.flows
        for share, here in self._between.items():
            found = growth_between(sets, share, starts, here) + drift[k]
            for ends in (k + 1, k):
                growth[ends] = np.maximum(growth[ends], found)
        return growth


def _levels(times, rate, largest):
    """Returns ρ (T, 1, 1), backward from 1 and within the servo's margin."""
    log = np.minimum(0.0, np.log(largest))
    change = 0.5 * (rate[:-1] + rate[1:]) * np.diff(times)
    for k in range(len(times) - 2, -1, -1):
        log[k] = min(log[k + 1] - change[k], np.log(largest[k]))
    return np.exp(log)[:, None, None]
