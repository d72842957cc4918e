"""A filter along flights: what it believes before, and what it makes of them."""

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike

from glider.compiled.ekf import SampleClock, filter_flights, predict_estimate
from glider.errors import InputError, show
from glider.estimation.ekf import Ekf
from glider.physics.state import NUM_STATES


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Belief:
    """A normal distribution of x̄."""

    mean: np.ndarray
    """(N,)."""

    covariance: np.ndarray
    """(N, N)."""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Estimates:
    """Estimates that a filter makes of B flights of K samples."""

    means: np.ndarray
    """(B, K + 1, N) of x̄: before the first sample, then behind each."""

    covariances: np.ndarray
    """(B, K + 1, N, N)."""

    innovations: np.ndarray
    """(B, K, M) measured minus predicted."""

    innovation_covariances: np.ndarray
    """(B, K, M, M) S."""

    nis: np.ndarray
    """(B, K) νᵀ S⁻¹ ν, the normalized innovation squared."""


def make_prior(ekf: Ekf, state: ArrayLike, std: ArrayLike) -> Belief:
    """Returns what is believed before the first sample.

    Args:
        ekf: the filter.
        state: (7,), the effects' own states at rest, or (n,).
        std: standard deviations of the states, (7,) or (n,); those not given are
            zero. The slow states bring their own.

    Raises:
        InputError: what is given does not fit the filter, or is no number.
    """
    full = ekf.model.initial_state(state)
    if full.shape != (ekf.num_states,) or not np.all(np.isfinite(full)):
        raise InputError(
            f"make_prior: the state is {full}; ({NUM_STATES},) or "
            f"({ekf.num_states},) finite numbers are needed."
        )
    given = np.asarray(std, dtype=float)
    spread = np.zeros(len(ekf.names))
    if given.shape not in ((NUM_STATES,), (ekf.num_states,)):
        raise InputError(
            f"make_prior: the deviations have shape {given.shape}; ({NUM_STATES},) "
            f"or ({ekf.num_states},) is needed."
        )
    spread[: len(given)] = given
    spread[ekf.num_states :] = [s.std for s in ekf.slow]
    if not np.all(np.isfinite(spread) & (spread >= 0.0)):
        raise InputError(
            f"make_prior: the standard deviations are {show(spread)}; finite numbers, "
            "none negative, are needed."
        )
    places = ekf.estimated.places[ekf.num_states :]
    means = [
        ekf.z[place] if s.mean is None else s.mean
        for s, place in zip(ekf.slow, places, strict=True)
    ]
    return Belief(mean=np.append(full, means), covariance=np.diag(spread**2))


def check_belief(ekf: Ekf, prior: Belief, source: str) -> None:
    """Raises InputError where a belief is of another filter's x̄."""
    shapes, size = (np.shape(prior.mean), np.shape(prior.covariance)), len(ekf.names)
    if shapes != ((size,), (size, size)):
        raise InputError(
            f"{source}: the prior's mean and covariance have shapes {shapes[0]} and "
            f"{shapes[1]}; ({size},) and ({size}, {size}) are needed."
        )


def run_ekf(
    ekf: Ekf, prior: Belief, inputs: ArrayLike, measured: ArrayLike, time: float = 0.0
) -> Estimates:
    """Runs a filter along flights.

    Args:
        ekf: the filter.
        prior: before the first sample, of all flights.
        inputs: (B, K, 1 + known) mean of the elevator's rate, then the known inputs,
            between a sample and the one before it.
        measured: (B, K, M) at the samples; with a NaN in it, it is left out.
        time: of the prior [s].

    Raises:
        InputError: what is given does not fit the filter.
    """
    inputs = np.ascontiguousarray(inputs, dtype=float)
    measured = np.ascontiguousarray(measured, dtype=float)
    rows = len(ekf.noise)
    shapes = (inputs.shape[-1:], measured.shape[-1:], measured.ndim)
    if shapes != ((ekf.num_inputs,), (rows,), 3) or (
        inputs.shape[:2] != measured.shape[:2]
    ):
        raise InputError(
            f"run_ekf: the inputs have shape {inputs.shape}, the measurements "
            f"{measured.shape}; (B, K, {ekf.num_inputs}) and (B, K, {rows}) are needed."
        )
    check_belief(ekf, prior, "run_ekf")
    means, covariances, innovations, spreads, squares = filter_flights(
        ekf.model,
        time,
        ekf.z,
        ekf.estimated,
        ekf.clock,
        ekf.process * ekf.period,
        ekf.noise,
        (inputs, measured),
        (prior.mean, prior.covariance),
    )
    return Estimates(
        means=means,
        covariances=covariances,
        innovations=innovations,
        innovation_covariances=spreads,
        nis=squares,
    )


def predict_mean(
    ekf: Ekf,
    mean: np.ndarray,
    inputs: ArrayLike,
    duration: float,
    time: float = 0.0,
    *,
    differentiate: bool = False,
) -> tuple[np.ndarray, np.ndarray]:
    """Predicts x̄ after a time without a measurement.

    Args:
        ekf: the filter.
        mean: (N,) x̄ now.
        inputs: (1 + known,) until then.
        duration: [s].
        time: now [s].
        differentiate: whether to return the derivative.

    Returns:
        x̄ then (N,), and its derivative by x̄ now (N, N), or (0, 0).

    Raises:
        InputError: what is given does not fit the filter.
    """
    shapes, size = (np.shape(mean), np.shape(inputs)), len(ekf.names)
    if shapes != ((size,), (ekf.num_inputs,)):
        raise InputError(
            f"predict_mean: the mean and the inputs have shapes {shapes[0]} and "
            f"{shapes[1]}; ({size},) and ({ekf.num_inputs},) are needed."
        )
    z = ekf.z.copy()
    z[ekf.estimated.places], z[ekf.estimated.entry] = mean, inputs
    count = max(math.ceil(duration / ekf.clock.step - 1e-9), 1)
    clock = SampleClock(step=duration / count, steps=count)
    return predict_estimate(ekf.model, time, z, ekf.estimated, clock, differentiate)
