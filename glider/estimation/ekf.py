"""An extended Kalman filter for any glider, augmented with slow states.

x̄ = (x, s): the glider's state and slow states s, which are any of its parameters,
effect coefficients or the wind. Between two samples
    ẋ = f(x, u, s),   ṡ = -decay s
is integrated by Runge-Kutta with the derivative F of the whole step by complex steps,
P ← F P Fᵀ + Q T; at a sample y = h(x̄) + noise corrects the belief. The correction is
in Joseph's form: at these sizes (the square root of P's condition is about 1e4) its
rounding does no harm, and it takes no factorization of P at each step, as a
square-root filter does.
"""

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike

from glider.compiled.ekf import EstimatedFlight
from glider.compiled.jacobian import stacked
from glider.errors import expect
from glider.physics.chain import NUM_INPUTS
from glider.physics.model import GliderModel
from glider.physics.state import NUM_STATES, POSE_NAMES, STATE_NAMES

_STEP = 0.01
"""Longest Runge-Kutta step of a prediction [s]."""

WIND_NAMES = ("wind_x", "wind_z")
"""Velocity of the air, world [m/s]; a slow state, a known input, or zero."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class SlowState:
    """A number that is estimated beside the state."""

    name: str  #: One of WIND_NAMES, or of the names of `GliderModel.space`.
    std: float  #: Standard deviation before any measurement.
    walk: float = 0.0  #: Variance that it gains per second.
    decay: float = 0.0  #: Rate at which its expectation falls, as exp(-decay t) [1/s].
    #: Estimate before any measurement; None: what the model has.
    mean: float | None = None


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Ekf:
    """A filter ready to run; `make_ekf` makes it."""

    model: GliderModel  #: The glider.
    names: tuple[str, ...]  #: Of x̄: the states, then the slow states.
    slow: tuple[SlowState, ...]  #: The slow states.
    known: tuple[str, ...]  #: Inputs that are known beside the elevator's rate.
    period: float  #: Time between samples [s].
    step: float  #: Runge-Kutta step [s].
    steps: int  #: Number of them to a period.
    process: np.ndarray  #: (N,) variances per second.
    noise: np.ndarray  #: (M, M) covariance of a measurement.
    z: np.ndarray  #: Constants in their places, as in `physics.chain.derivatives_of`.
    #: Where x̄ and the inputs stand in z, and what they act on.
    estimated: EstimatedFlight

    @property
    def num_states(self) -> int:
        """Number of the glider's states n."""
        return self.estimated.n

    @property
    def num_inputs(self) -> int:
        """Number of inputs r: the elevator's rate and the known ones."""
        return len(self.estimated.entry)

    @property
    def measured_names(self) -> tuple[str, ...]:
        """Names of what is measured: the pose, then the states from the elevator on."""
        others = self.names[len(POSE_NAMES) : len(self.noise)]
        return (*POSE_NAMES, *others)


def make_ekf(
    model: GliderModel,
    *,
    rate: float,
    process: ArrayLike,
    noise: ArrayLike,
    slow: tuple[SlowState, ...] = (),
    known: tuple[str, ...] = (),
    step: float = _STEP,
) -> Ekf:
    """Makes a filter.

    Args:
        model: the filter's glider.
        rate: of the samples [Hz].
        process: variance that each state gains per second, (7,), or (n,) with the
            effects' own states.
        noise: of a measurement: variances (M,) or a covariance (M, M). What is
            measured is the pose as the sensors show it (M = 3), then the elevator
            (M = 4), and so on to the full state (M = n).
        slow: what else to estimate.
        known: what else changes and is known at each sample, by name as in
            SlowState; for example WIND_NAMES.
        step: longest Runge-Kutta step [s]; shorter where the effects' own states ask
            for it.

    Raises:
        InputError: what is given does not fit together.
    """
    for name, value in (("rate", rate), ("step", step)):
        good = math.isfinite(value) and value > 0.0
        expect(good, f"make_ekf: '{name}'", value, "a positive number")
    n = model.num_states
    # As they stand in z, after the command.
    named = (*WIND_NAMES, *model.space.names)
    places = {name: n + 1 + i for i, name in enumerate(named)}
    process = _checked_process(process, n)
    noise = _checked_noise(noise, n)
    names = (*(s.name for s in slow), *known)
    for name in names:
        needed = f"one of {', '.join(places)}"
        expect(name in places, "make_ekf: a slow state or known input", name, needed)
    what = "make_ekf: the list of slow and known"
    needed = "each name only once"
    expect(len(set(names)) == len(names), what, names, needed)
    for s in slow:
        mean = 0.0 if s.mean is None else s.mean
        numbers = (s.std, s.walk, s.decay, mean)
        good = all(map(math.isfinite, numbers))
        good = good and s.std >= 0.0 and s.walk >= 0.0
        what = f"make_ekf: slow state '{s.name}' (std, walk, decay, mean)"
        expect(good, what, numbers, "finite numbers, std and walk not negative")
    z = stacked(model)
    slow_places = [places[s.name] for s in slow]
    taken = np.array([*range(n), *slow_places])
    acting, seen = _depend(model, z, taken)
    known_places = [places[name] for name in known]
    period = 1.0 / rate
    step = min(step, model.longest_step())
    count = math.ceil(period / step - 1e-9)
    return Ekf(
        model=model,
        names=(*model.state_names, *(s.name for s in slow)),
        slow=tuple(slow),
        known=tuple(known),
        period=period,
        step=period / count,
        steps=count,
        process=np.append(process, [s.walk for s in slow]),
        noise=noise,
        z=z,
        estimated=EstimatedFlight(
            n=n,
            places=taken,
            decay=np.array([s.decay for s in slow], dtype=float),
            acting=acting,
            seen=seen,
            entry=np.array([n, *known_places]),
        ),
    )


def _depend(model: GliderModel, z: np.ndarray, places: np.ndarray) -> tuple:
    """Returns which of x̄ the motion depends on, and which the pose.

    A NaN reaches all that is computed from it.
    """
    n = model.num_states
    chain = model.chain
    gaussians = model.gaussians
    moving = slice(STATE_NAMES.index("xdot"), NUM_STATES)
    acting = []
    seen = []
    for k, place in enumerate(places):
        y = z.copy()
        y[moving] += 1.0  # In motion: nothing is divided by zero.
        y[place] = np.nan
        rates = chain.derivatives_of(0.0, y, n, gaussians)
        if np.any(np.isnan(rates)):
            acting.append(k)
        theta = chain.theta_of(y[n + NUM_INPUTS :], gaussians)
        pose = chain.measure(y[:n], theta)
        if np.any(np.isnan(pose)):
            seen.append(k)
    return np.array(acting), np.array(seen)


def _numbers(values: ArrayLike) -> np.ndarray:
    """Converts values to an array; NaN if that fails, as for rows of two lengths."""
    try:
        return np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        return np.array(np.nan)


def _checked_process(process: ArrayLike, n: int) -> np.ndarray:
    values = _numbers(process)
    good = values.ndim == 1 and len(values) in (NUM_STATES, n)
    good = good and bool(np.isfinite(values).all())
    good = good and bool(np.min(values) >= 0.0)
    needed = f"{n} finite numbers, none negative"
    expect(good, "make_ekf: 'process'", process, needed)
    return np.append(values, np.zeros(n - len(values)))


def _checked_noise(noise: ArrayLike, n: int) -> np.ndarray:
    values = _numbers(noise)
    values = np.diag(values) if values.ndim == 1 else values
    rows = len(values) if values.ndim else 0
    good = values.shape == (rows, rows)
    good = good and len(POSE_NAMES) <= rows <= n
    good = good and bool(np.isfinite(values).all())
    good = good and np.allclose(values, values.T)
    good = good and bool(np.min(np.linalg.eigvalsh(values)) > 0.0)
    needed = f"positive variances (M,) or a covariance (M, M) with M from 3 to {n}"
    expect(good, "make_ekf: 'noise'", noise, needed)
    return values
