"""The nominal flight of a funnel: the feedback's own flight along its plan.

A plan by collocation is no exact flight between its knots. The nominal is one, up to
the error of fine Runge-Kutta steps: the glider under the plan's feedback, from the
plan's launch. Between its times x₀ is the cubic Hermite polynomial through states and
slopes; u₀ and the gains are straight lines. So it is flown, checked and proven.

With x = x₀(t) + e and u = u₀(t) - K(t) e, a deviation from it follows
    ė = f(x₀ + e, u₀ - K e) - f(x₀, u₀) + d = F₁ e + F₂(e, e) + F₃(e, e, e) + R(e) + d
as long as the servo follows its command, which the funnel ensures; `defect` bounds d.
"""

import dataclasses
import functools
import math
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import numpy as np
from scipy.interpolate import PPoly

from glider.compiled.flight import Steps, fly_batch, make_feedback
from glider.compiled.runge_kutta import advance
from glider.control.predictor import fly_held, policy_command
from glider.control.tvlqr import TrackingPolicy, aligned_count, check_plan
from glider.errors import InputError
from glider.physics.confidence import theta_at
from glider.physics.model import GliderModel
from glider.physics.servo import limited_rate
from glider.verification.dynamics.numbers import Monomials, monomials
from glider.verification.dynamics.taylor_models import Program, Recording

T = TypeVar("T")

_FLIGHT_STEP = 0.0005
"""Longest step of the integration [s]."""

ORDER = 3
"""Order of the expansion that funnels are built on. With order 2, the remainder leaves
a launch 1.7 cm of height; with order 3, 9 cm."""


def table_of(num_variables: int) -> Monomials:
    """Returns the monomials of the Taylor polynomials."""
    return monomials(num_variables, ORDER)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Nominal:
    """A flight of a glider under u = u₀ - K (x - x₀), at some times.

    A time stands twice where a command that is held begins to act: before it and after.
    The names of the arrays are keys in a funnel's file.
    """

    model: GliderModel  #: Glider that flies.
    times: np.ndarray  #: Times (T,) from 0 [s].
    states: np.ndarray  #: States x₀ (T, n).
    inputs: np.ndarray  #: Elevator rates u₀ (T,) [rad/s].
    gains: np.ndarray  #: Gains K (T, n).
    #: M (T, n, n) of held commands, u₀ - K e + eᵀ M e (`funnel.clock`); else zero.
    bends: np.ndarray

    @functools.cached_property
    def slopes(self) -> np.ndarray:
        """ẋ₀ (T, n) by the dynamics."""
        rates = open_loop_rates(self.model, list(self.states.T), self.inputs)
        return np.array([np.broadcast_to(rate, len(self.times)) for rate in rates]).T

    @functools.cached_property
    def demanded(self) -> np.ndarray:
        """Slopes (n,) of the servo's demanded angle by the states: it is linear."""
        chain = self.model.chain
        c = self.model.numbers.c
        n = self.model.num_states
        return np.array([chain.demanded_angle(unit, c) for unit in np.eye(n)])

    @functools.cached_property
    def flows(self) -> np.ndarray:
        """Indices k of the intervals, from time k to k + 1, that last; (F,)."""
        return np.flatnonzero(np.diff(self.times) > 0.0)

    @functools.cached_property
    def starts(self) -> np.ndarray:
        """Index (T,) of the sample whose command acts at each time."""
        begins = np.append(True, np.diff(self.times) == 0.0)
        return np.maximum.accumulate(np.where(begins, np.arange(len(begins)), 0))

    @property
    def samples(self) -> np.ndarray:
        """Indices of the samples, after which their commands act; (0,) if none."""
        return np.unique(self.starts)

    @functools.cached_property
    def path(self) -> PPoly:
        """x₀ as a function of time."""
        return hermite_path(self.times, self.states, self.slopes)

    @functools.cached_property
    def closed_loop(self) -> np.ndarray:
        """Taylor coefficients (T, n, M) of ė by `table_of(n)`; the constant is zero."""
        values = np.vstack([self.states.T, self.inputs])
        coefficients = expand(self.model, values, ORDER, gains=self.gains)
        coefficients[:, :, 0] = 0.0  # The slope of the nominal flight itself.
        return coefficients

    @functools.cached_property
    def open_loop(self) -> np.ndarray:
        """Taylor coefficients (T, n, M) of f in (x, u) by `table_of(n + 1)`."""
        values = np.vstack([self.states.T, self.inputs])
        return expand(self.model, values, ORDER)

    @functools.cached_property
    def push_slopes(self) -> np.ndarray:
        """G = ∂f/∂(u, w) (T, n, 3, 1 + n) in (1, e): of the command and the wind."""
        n = self.states.shape[1]
        still = np.zeros((2, len(self.times)))
        values = np.vstack([self.states.T, self.inputs, still])
        table = monomials(n + 3, 2)
        given, pushes = np.split(table.exponents[: n + 4], [n + 1])  # Of 1 and e first.
        places = [[table.place(push + one) for one in given] for push in pushes]
        return expand(self.model, values, 2)[:, :, places]

    def part(self, which: slice) -> "Nominal":
        """Returns the flight at some of its times."""
        arrays = {name: getattr(self, name)[which] for name in ARRAYS}
        return dataclasses.replace(self, **arrays)

    def writable(self) -> "Nominal":
        """Returns the flight with gains and bends of its own, to be written."""
        own = {name: getattr(self, name).copy() for name in ("gains", "bends")}
        return dataclasses.replace(self, **own)

    def between(self, share: float) -> "Nominal":
        """Returns the flight at a share of each interval that lasts, 0 to 1."""
        arrays: dict[str, Any]
        arrays = {name: self.mixed(getattr(self, name), share) for name in ARRAYS}
        arrays["states"] = self.path(arrays["times"])
        return dataclasses.replace(self, **arrays)

    def mixed(self, values: np.ndarray, share: float) -> np.ndarray:
        """Returns what is a straight line between the times there, (F, ...)."""
        return (1.0 - share) * values[self.flows] + share * values[self.flows + 1]


ARRAYS = ("times", "states", "inputs", "gains", "bends")
"""Names of the arrays of a nominal, one entry a time."""


def make_nominal(
    model: GliderModel, policy: TrackingPolicy, step: float, period: float = 0.0
) -> Nominal:
    """Flies the feedback from its plan's launch, at times one step [s] apart at most.

    Its commands are held for a period [s] if that is not 0.

    Raises:
        InputError: the plan is for another glider or needs its servo at a limit, or the
            glider's dynamics vary with time.
    """
    check_plan(model, policy.plan)
    if model.is_time_varying:
        raise InputError("A funnel needs a glider whose dynamics do not vary in time.")
    if period > 0.0:
        flight = fly_held(model, policy, period, step, _FLIGHT_STEP)
    else:
        flight = _continuous_flight(model, policy, step)
    gains = policy.sample(flight[0])[1]
    arrays = *flight, gains, np.zeros((*gains.shape, gains.shape[1]))
    nominal = Nominal(model=model, **dict(zip(ARRAYS, arrays, strict=True)))
    angles = nominal.states @ nominal.demanded
    servo = model.parameters.servo
    commands = zip(nominal.inputs, angles, strict=True)
    if any(limited_rate(u, angle, servo) != u for u, angle in commands):
        raise InputError("The plan needs its servo at a limit: no funnel about it.")
    return nominal


def _continuous_flight(model, policy, step):
    """Returns times, states and inputs of the feedback as it is."""
    plan = policy.plan
    count = aligned_count(plan, step)
    times = np.linspace(0.0, plan.duration, count + 1)
    [states] = fly_plan(model, policy, plan.states[:1], count, _FLIGHT_STEP)
    return times, states, policy_command(policy, times, states)


def fly_plan(
    model: GliderModel,
    policy: TrackingPolicy,
    states: np.ndarray,
    count: int,
    step: float,
) -> np.ndarray:
    """Flies states (B, n) to a plan's end.

    Args:
        count: of equal intervals, at whose ends states are returned.
        step: longest step of the integration [s].

    Returns:
        states (B, count + 1, n).
    """
    interval = policy.duration / count
    every = math.ceil(interval / step - 1e-9)
    every *= model.count_laps(interval / every)
    steps = Steps(count * every, interval / every, every=every)
    feedback = make_feedback(policy.sample, steps)
    return fly_batch(model, states, steps, feedback).states


def advanced(
    rate: Callable[[float, np.ndarray], np.ndarray], x: np.ndarray, step: float
) -> np.ndarray:
    """Returns a matrix x one Runge-Kutta step [s] later.

    Its derivative is `rate(share, x)`, after a share of the step.
    """

    def slope(t, node, x, data, rates):
        rates[:] = rate(0.5 * node, x)

    x = x.copy()
    advance(slope, 0.0, x, step, 4, None, np.empty((3, *x.shape)))
    return x


def hermite_path(times: np.ndarray, values: np.ndarray, slopes: np.ndarray) -> PPoly:
    """Returns cubic Hermite polynomials, with a kink where a time stands twice."""
    k = np.flatnonzero(np.diff(times) > 0.0)
    step = np.diff(times)[k].reshape(-1, *(1,) * (values.ndim - 1))
    first = slopes[k]
    last = slopes[k + 1]
    mean = (values[k + 1] - values[k]) / step
    bend = (first + last - 2.0 * mean) / step
    powers = [bend / step, (mean - first) / step - bend, first, values[k]]
    return PPoly(np.array(powers), np.append(times[k], times[-1]))


def hermite_powers(
    times: np.ndarray, values: np.ndarray, slopes: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Returns a cubic Hermite polynomial (..., 4) as powers of s, lowest first.

    Values and slopes (2, ...) are at both times, which are s = -1 and 1. The second is
    its slope in time, (..., 3).
    """
    half = 0.5 * (times[1] - times[0])
    a, b = values
    da, db = half * slopes
    powers = [
        0.5 * (a + b) + 0.25 * (da - db),
        0.75 * (b - a) - 0.25 * (da + db),
        0.25 * (db - da),
        0.25 * (a - b + da + db),
    ]
    curve = np.stack(powers, axis=-1)
    return curve, curve[..., 1:] * [1.0, 2.0, 3.0] / half


def line_powers(values: Sequence[np.ndarray] | np.ndarray) -> np.ndarray:
    """Returns a and b of the straight line a + b s, given its ends at s = -1 and 1."""
    return 0.5 * np.array([values[0] + values[1], values[1] - values[0]])


def for_one_glider(function: Callable[..., T]) -> Callable[..., T]:
    """Remembers what a function of a model and hashable numbers returned.

    It does so for one model, an object that the parts of a funnel share. Threads that
    have others each keep to their own.
    """
    memory: tuple[GliderModel | None, Callable[..., T]] = None, function

    @functools.wraps(function)
    def remembered(model: GliderModel, *others: Any) -> T:
        nonlocal memory
        last, known = memory
        if last is not model:
            known = functools.cache(functools.partial(function, model))
            memory = model, known
        return known(*others)

    return remembered


@for_one_glider
def _rates_of(
    model: GliderModel,
    names: tuple[str, ...],
    variables: int,
    degree: int,
    keeps_zeros: bool = False,
) -> Program:
    """Returns what computes Taylor polynomials of the rates.

    Inputs are the n states, the command, the deviations of the named numbers and the
    wind along x and z. So many of them, the first, are variables, or at least the
    command depends on those.
    """
    n = model.num_states
    last = n + 1 + len(names)
    recording = Recording(monomials(variables, degree), keeps_zeros)
    own = recording.inputs(last + 2)
    theta = theta_at(model, names, own[n + 1 : last])
    rates = open_loop_rates(model, own[:n], own[n], theta, own[last:])
    present = np.zeros((len(own), len(recording.table.degrees)), dtype=bool)
    present[: max(variables, n + 1), 0] = True
    present[:variables, 1 : variables + 1] = np.eye(variables)
    if variables == n:
        present[n, : n + 1] = True
    return recording.program(rates, present)


def expand(
    model: GliderModel,
    values: np.ndarray,
    degree: int,
    names: tuple[str, ...] = (),
    gains: np.ndarray | None = None,
) -> np.ndarray:
    """Returns the Taylor coefficients (T, n, M) of the rates at T points.

    Args:
        model: the glider.
        values: (V, T) of the variables: the states, the command, and in the order of
            `rate_dependences` those that follow. The others are 0.
        degree: of the polynomials.
        names: numbers that deviate.
        gains: (T, n) of a command that follows the states; then these are the only
            variables.
    """
    n = model.num_states
    variables = len(values) if gains is None else n
    inputs = np.zeros(
        (n + 3 + len(names), len(monomials(variables, degree).degrees), len(values.T))
    )
    inputs[: len(values), 0] = values
    for i in range(variables):
        inputs[i, 1 + i] = 1.0
    if gains is not None:
        inputs[n, 1 : n + 1] = -gains.T
    program = _rates_of(model, names, variables, degree)
    found, _ = program.run(inputs, np.full_like(inputs[:, 0], np.nan))
    return found.transpose(2, 0, 1)


def rate_dependences(
    model: GliderModel, names: tuple[str, ...] = (), in_wind: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """Returns on which variables each rate may depend, and in which it is not linear.

    Both are (n, V); the latter is meant jointly with other variables. These are the n
    states, the command, the named numbers that deviate, and the wind along x and z.
    What a glider multiplies by zero counts: another, that deviates, may not.
    """
    count = model.num_states + 1 + len(names) + 2 * in_wind
    shown = _rates_of(model, names, count, 2, True).shown
    has = monomials(count, 2).exponents > 0
    return shown @ has, shown[:, 1 + count :] @ has[1 + count :]


def nonlinear_parts(
    model: GliderModel, names: tuple[str, ...] = ()
) -> tuple[list[int], list[int]]:
    """Returns the indices of the variables, and of the rates, that are not linear."""
    _, nonlinear = rate_dependences(model, names)
    which = np.flatnonzero(nonlinear.any(axis=0))
    rows = np.flatnonzero(nonlinear.any(axis=1))
    return which.tolist(), rows.tolist()


def evaluate(coefficients: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """Returns ė (..., B, n) by the Taylor polynomials, at errors (..., B, n)."""
    n = errors.shape[-1]
    shape = (*errors.shape[:-1], -1)
    values = table_of(n).values(errors.reshape(-1, n)).reshape(shape)
    return values @ np.swapaxes(coefficients, -1, -2)


def open_loop_rates(model, states, command, theta=None, wind=(0.0, 0.0)):
    """Returns ẋ for any kind of number, without the servo limits.

    Args:
        command: u [rad/s].
        theta: the numbers of a glider that deviates from it; None for its own.
        wind: along x and z, beyond the model's own [m/s].
    """
    theta = model.numbers if theta is None else theta
    return model.chain.derivatives(0.0, states, command, *wind, theta)
