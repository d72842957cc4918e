"""Tracking feedback as a table over time, computed by compiled code."""

import dataclasses
import functools
import math

import numpy as np
from scipy.interpolate import CubicHermiteSpline, CubicSpline, make_interp_spline

from glider.compiled.jacobian import stacked
from glider.compiled.riccati import LOOPS, integrate_back
from glider.errors import expect
from glider.physics.held_commands import latest_command
from glider.physics.model import GliderModel
from glider.physics.state import NUM_STATES
from glider.planning.plan import Plan

STEP = 0.003
"""Longest step of the pass [s]: gains to about 1e-7 of their largest."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class TrackingWeights:
    """Weights of following a plan; the defaults are the article's.

    minimize   ∫ (x̃ᵀ diag(state) x̃ + rate ũ²) dt + x̃(T)ᵀ diag(final) x̃(T)
    with x̃, ũ the departures from the plan. The effects' own states weigh nothing.
    """

    #: Weights of the states, in the order of STATE_NAMES.
    state: tuple[float, ...] = (10.0, 10.0, 10.0, 1.0, 1.0, 1.0, 1.0)
    rate: float = 0.1  #: Weight of the elevator-rate command.
    #: Weights of the states at the plan's end, in the order of STATE_NAMES.
    final: tuple[float, ...] = (400.0, 400.0, 1 / 9, 1 / 9, 1.0, 1.0, 1 / 9)

    def __post_init__(self):
        """Raises InputError where Riccati's equation would have no solution."""
        needed = f"{NUM_STATES} finite numbers, none negative"
        for name in ("state", "final"):
            values = np.asarray(getattr(self, name), dtype=float)
            good = values.shape == (NUM_STATES,)
            good = good and bool(np.all(np.isfinite(values) & (values >= 0.0)))
            expect(good, f"TrackingWeights: '{name}'", values, needed)
        good = math.isfinite(self.rate) and self.rate > 0.0
        expect(good, "TrackingWeights: 'rate'", self.rate, "a positive number")


def weight_matrix(diagonal: tuple[float, ...], num_states: int) -> np.ndarray:
    """Returns a diagonal matrix (n, n), zero for the effects' own states."""
    return np.diag(np.append(diagonal, np.zeros(num_states - len(diagonal))))


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class TrackingPolicy:
    """u = u₀ - K (x - x₀) - k₀ about a plan, and its cost-to-go.

    Holds numbers only, so that a copy can go to another process.
    """

    plan: Plan  #: Plan, x₀ and u₀.
    times: np.ndarray  #: (M + 1,) from 0 to the end of the plan [s].
    gains: np.ndarray  #: (M + 1, n) K at the times.
    #: (M + 1,) k₀ at the times [rad/s]; what the plan lacks to be a flight.
    corrections: np.ndarray
    #: (M + 1, n, n) S of the cost-to-go x̃ᵀ S x̃ + 2 x̃ᵀ s + (a number).
    cost: np.ndarray
    cost_slope: np.ndarray  #: (M + 1, n) s.
    #: Whether K and k₀ are straight lines between the times, as a funnel has them; else
    #: they are cubic splines.
    is_linear: bool = False
    #: Time that its commands are held [s], for which the gains were made; 0 if none.
    period: float = 0.0

    def __repr__(self) -> str:
        """Returns one line, as a notebook shows it."""
        return f"TrackingPolicy({self.plan})"

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the states that are fed back."""
        return self.plan.state_names

    @property
    def duration(self) -> float:
        """Duration of the plan [s]."""
        return self.plan.duration

    def count(self, step: float) -> int:
        """Number of equal steps, none longer, that the plan divides into."""
        return aligned_count(self.plan, step)

    @functools.cached_property
    def _curves(self):
        """K and k₀ as functions of time."""
        curve = functools.partial(make_interp_spline, k=1)
        curve = curve if self.is_linear else CubicSpline
        return [curve(self.times, values) for values in (self.gains, self.corrections)]

    def sample(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns the policy as u = offset - gain x at some times.

        After the plan's end its last values stay, as with Drake's regulator.

        Args:
            times: (J,) [s].

        Returns:
            offset (J,) [rad/s] and gain (J, n).
        """
        at = np.clip(times, 0.0, self.duration)
        gain, correction = (curve(at) for curve in self._curves)
        nominal, _, inputs = sample_plan(self.plan, at)
        return inputs - correction + np.sum(gain * nominal, axis=1), gain


def linear_policy(
    plan: Plan, gains: np.ndarray, cost: np.ndarray | None = None, period: float = 0.0
) -> TrackingPolicy:
    """Returns u = u₀ - K (x - x₀) with K (N, n) in straight lines between the knots.

    Args:
        plan: x₀ and u₀.
        gains: K at the plan's knots.
        cost: (N, n, n) S of x̃ᵀ S x̃ there; zero if None.
        period: time that commands are held [s]; 0 if none.
    """
    count, n = gains.shape
    return TrackingPolicy(
        plan=plan,
        times=plan.times,
        gains=gains,
        corrections=np.zeros(count),
        cost=np.zeros((count, n, n)) if cost is None else cost,
        cost_slope=np.zeros((count, n)),
        is_linear=True,
        period=period,
    )


def check_plan(model: GliderModel, plan: Plan) -> None:
    """Raises InputError unless the plan has the states of the glider."""
    mine = tuple(plan.state_names)
    needed = f"those of the glider, {model.state_names}"
    expect(mine == model.state_names, "the plan's states", mine, needed)


def sample_plan(
    plan: Plan, times: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns states (J, n), their slopes (J, n) and inputs (J,) at some times."""
    path = CubicHermiteSpline(plan.times, plan.states, plan.slopes)
    if plan.is_held:
        knot = latest_command(plan.times, times)
        inputs = plan.inputs[np.minimum(knot, len(plan.inputs) - 1)]
    else:
        inputs = np.interp(times, plan.times, plan.inputs)
    return path(times), path(times, 1), inputs


def aligned_count(plan: Plan, step: float) -> int:
    """Number of equal steps, none longer than `step`, that a plan divides into.

    An integer for each interval between equally spaced knots, because the
    plan has kinks there.
    """
    good = math.isfinite(step) and step > 0.0
    expect(good, "the step", step, "a positive number of seconds")
    intervals = len(plan.times) - 1
    return intervals * math.ceil(plan.duration / (intervals * step) - 1e-9)


def tracking_policy(
    model: GliderModel,
    plan: Plan,
    weights: TrackingWeights | None = None,
    step: float = STEP,
) -> TrackingPolicy:
    """Computes the tracking feedback of `glider.systems.regulator` in milliseconds.

    Jacobians along the plan by complex steps, then one Runge-Kutta pass of the
    Riccati equation on a fixed grid (`compiled.riccati`).

    Args:
        model: the glider that the plan is for.
        plan: what to follow.
        weights: of the feedback; None for the article's.
        step: longest step of the pass [s]; shorter where the effects' own states ask
            for it.

    Raises:
        InputError: the plan is for another glider.
    """
    check_plan(model, plan)
    weights = TrackingWeights() if weights is None else weights
    # The cost-to-go settles at twice the rate of a state.
    step = min(step, 0.5 * model.longest_step())
    n = model.num_states
    count = aligned_count(plan, step)
    times = np.linspace(0.0, plan.duration, 2 * count + 1)
    states, slopes, inputs = sample_plan(plan, times)
    rates = np.empty(states.shape)
    jacobians = np.empty((*states.shape, n + 1))
    z = stacked(model)
    loop = LOOPS.over(model.kinds).linearize
    loop(times, states, inputs, z, model.gaussians, rates, jacobians)
    # Of (x̃, 1): what the plan lacks to be a flight is the last column.
    steady = np.zeros((len(times), n + 1, n + 1))
    steady[:, :n, :n] = jacobians[..., :n]
    steady[:, :n, n] = rates - slopes
    push = np.zeros((len(times), n + 1))
    push[:, :n] = jacobians[..., n]
    cost = np.zeros((count + 1, n + 1, n + 1))
    cost[-1] = weight_matrix(weights.final, n + 1)
    weight = weight_matrix(weights.state, n + 1)
    span = times[2] - times[0]
    integrate_back(steady, push, weight, float(weights.rate), span, cost)
    gains = np.einsum("kij,ki->kj", cost, push[::2]) / weights.rate
    return TrackingPolicy(
        plan=plan,
        times=times[::2],
        gains=gains[:, :n].copy(),
        corrections=gains[:, n].copy(),
        cost=cost[:, :n, :n].copy(),
        cost_slope=cost[:, :n, n].copy(),
    )
