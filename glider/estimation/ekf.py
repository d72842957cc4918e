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
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from glider.compiled.kernel import (
    Kernel,
    compiled,
)
from glider.errors import InputError
from glider.physics.compose import compose
from glider.physics.model import GliderModel
from glider.physics.parameters import (
    PARAMETER_NAMES,
    parameter_vector,
)
from glider.physics.state import (
    NUM_STATES,
    POSE_NAMES,
)
from glider.systems.plant import GliderPlant

STEP = 0.01
"""Longest Runge-Kutta step of a prediction [s]."""

WIND_NAMES = ("wind_x", "wind_z")
"""Velocity of the air, world [m/s]; a slow state, a known input, or zero."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class SlowState:
    """A number that is estimated beside the state."""

    name: str
    """One of PARAMETER_NAMES, WIND_NAMES, or "effect.coefficient"."""

    std: float
    """Standard deviation before any measurement."""

    walk: float = 0.0
    """Variance that it gains per second."""

    decay: float = 0.0
    """Its expectation falls as exp(-decay t) [1/s]."""

    mean: float | None = None
    """Estimate before any measurement; None: what the model has."""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Ekf:
    """A filter ready to run; `make_ekf` makes it.

    Attributes:
        model: the glider, without absent effects.
        names: of x̄: the states, then the slow states.
        num_states: n.
        slow: the slow states.
        known: inputs that are known beside the elevator's rate.
        period: between samples [s].
        step: of Runge-Kutta [s]; `count` of them are a period.
        count: see `step`.
        process: (N,) variances per second.
        noise: (M, M) covariance of a measurement.
        kernel: the compiled loops.
        z: (n + 12 + coefficients,) constants in their places.
        places: (N,) indices into z of x̄.
        decay: (m,) [1/s].
        acting: indices into x̄ of what the motion depends on.
        seen: indices into x̄ of what the pose depends on.
        entry: (1 + known,) indices into z of the inputs.
    """

    model: GliderModel
    names: tuple[str, ...]
    num_states: int
    slow: tuple[SlowState, ...]
    known: tuple[str, ...]
    period: float
    step: float
    count: int
    process: np.ndarray
    noise: np.ndarray
    kernel: Kernel
    z: np.ndarray
    places: np.ndarray
    decay: np.ndarray
    acting: np.ndarray
    seen: np.ndarray
    entry: np.ndarray

    def loop_arguments(self, time: float) -> tuple:
        """Returns what `ekf_run` and `ekf_fly` both begin with, from a time on [s]."""
        n = self.num_states
        return (
            time,
            self.z.copy(),
            n,
            self.places[n:],
            self.decay,
            self.acting,
            self.seen,
            self.entry,
            self.step,
            self.count,
            self.model.residual_field,
        )

    @property
    def measured_names(self) -> tuple[str, ...]:
        """What is measured: the pose, then the states from the elevator on."""
        return (*POSE_NAMES, *self.names[len(POSE_NAMES) : len(self.noise)])


def make_ekf(
    model: GliderModel,
    *,
    rate: float,
    process: ArrayLike,
    noise: ArrayLike,
    slow: tuple[SlowState, ...] = (),
    known: tuple[str, ...] = (),
    step: float = STEP,
) -> Ekf:
    """Makes a filter.

    Args:
        model: the glider that the filter believes in.
        rate: of the samples [Hz].
        process: variance that each state gains per second, (7,), or (n,) with the
            effects' own states.
        noise: of a measurement: variances (M,) or a covariance (M, M). What is
            measured is the pose as the sensors show it (M = 3), then the elevator
            (M = 4), and so on to the full state (M = n).
        slow: what else to estimate.
        known: what else changes and is known at each sample, by name as in
            SlowState; for example WIND_NAMES.
        step: longest Runge-Kutta step [s].

    Raises:
        InputError: what is given does not fit together.
    """
    for name, value in (("rate", rate), ("step", step)):
        if not (math.isfinite(value) and value > 0.0):
            raise InputError(
                f"make_ekf: '{name}' is {value}; a positive number is needed."
            )
    plant = GliderPlant(model)
    model, n = plant.model, len(plant.state_names)
    process = _checked_process(process, n)
    noise = _checked_noise(noise, n)
    places = _places(plant)
    for name in (*(s.name for s in slow), *known):
        if name not in places:
            raise InputError(
                f"make_ekf: there is no '{name}' in this glider; it has "
                f"{', '.join(places)}."
            )
    names = (*(s.name for s in slow), *known)
    if len(set(names)) != len(names):
        raise InputError(
            f"make_ekf: {', '.join(names)} are slow states and known inputs; each "
            "can be one of them only, and once."
        )
    for s in slow:
        numbers = (s.std, s.walk, s.decay, 0.0 if s.mean is None else s.mean)
        if not all(map(math.isfinite, numbers)) or min(numbers[:2]) < 0.0:
            raise InputError(
                f"make_ekf: slow state '{s.name}' has std {s.std}, walk {s.walk}, "
                f"decay {s.decay}, mean {s.mean}; finite numbers are needed, and "
                "none of the first two negative."
            )

    parameters = parameter_vector(model.parameters)
    z = np.concatenate([np.zeros(n + 3), parameters, model.coefficients])
    taken = np.array([*range(n), *(places[s.name] for s in slow)])
    acting, seen = _depend(plant, z, taken)
    period = 1.0 / rate
    count = math.ceil(period / step - 1e-9)
    return Ekf(
        model=model,
        names=(*plant.state_names, *(s.name for s in slow)),
        num_states=n,
        slow=tuple(slow),
        known=tuple(known),
        period=period,
        step=period / count,
        count=count,
        process=np.append(process, [s.walk for s in slow]),
        noise=noise,
        kernel=compiled(plant.kinds, model.field is not None),
        z=z,
        places=taken,
        decay=np.array([s.decay for s in slow], dtype=float),
        acting=acting,
        seen=seen,
        entry=np.array([n, *(places[name] for name in known)]),
    )


def _places(plant: Any) -> dict[str, int]:
    """Returns where each number that may be slow or known stands in z."""
    n = len(plant.state_names)
    names = [*WIND_NAMES, *PARAMETER_NAMES]
    names += [f"{e.kind}.{c.name}" for e in plant.kinds for c in e.coefficients]
    return {name: n + 1 + i for i, name in enumerate(names)}


def _depend(plant: Any, z: np.ndarray, places: np.ndarray) -> tuple:
    """Returns which of x̄ the motion depends on, and which the pose.

    A NaN reaches all that is computed from it.
    """
    n = len(plant.state_names)
    chain = compose(plant.kinds, plant.model.field is not None)
    acting, seen = [], []
    for k, place in enumerate(places):
        y = z.copy()
        y[4:7] += 1.0  # In motion: nothing is divided by zero.
        y[place] = np.nan
        x, p, c = y[:n], y[n + 3 : n + 12], y[n + 12 :]
        field = plant.model.residual_field
        rates = chain.derivatives(0.0, x, y[n], y[n + 1], y[n + 2], p, c, field)
        if np.any(np.isnan(rates)):
            acting.append(k)
        if np.any(np.isnan(chain.measure(x, p, c))):
            seen.append(k)
    return np.array(acting), np.array(seen)


def _numbers(values: ArrayLike) -> np.ndarray:
    """Returns an array; of what is none, as of rows of different lengths, NaN."""
    try:
        return np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        return np.array(np.nan)


def _checked_process(process: ArrayLike, n: int) -> np.ndarray:
    values = _numbers(process)
    good = values.ndim == 1 and len(values) in (NUM_STATES, n)
    if not good or not np.all(np.isfinite(values) & (values >= 0.0)):
        raise InputError(
            f"make_ekf: 'process' is {process!r}; {n} finite numbers, none negative, "
            "are needed."
        )
    return np.append(values, np.zeros(n - len(values)))


def _checked_noise(noise: ArrayLike, n: int) -> np.ndarray:
    values = _numbers(noise)
    values = np.diag(values) if values.ndim == 1 else values
    rows = len(values) if values.ndim else 0
    fits = values.shape == (rows, rows) and len(POSE_NAMES) <= rows <= n
    positive = (
        fits
        and np.all(np.isfinite(values))
        and np.allclose(values, values.T)
        and np.min(np.linalg.eigvalsh(values)) > 0.0
    )
    if not positive:
        raise InputError(
            f"make_ekf: 'noise' is {noise!r}; variances (M,) or a symmetric "
            f"covariance (M, M), positive, with M from 3 to {n} are needed."
        )
    return values
