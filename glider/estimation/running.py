"""A filter along flights: what it believes before, and what it makes of them."""

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike

from glider.errors import InputError
from glider.estimation.ekf import Ekf
from glider.physics.state import NUM_STATES
from glider.systems.plant import (
    GliderPlant,
    initial_state,
)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Belief:
    """A normal distribution of x̄."""

    mean: np.ndarray
    """(N,)."""

    covariance: np.ndarray
    """(N, N)."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Estimates:
    """What a filter makes of B flights of K samples."""

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
    full = initial_state(GliderPlant(ekf.model), state)
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
            f"make_prior: the standard deviations are {spread}; finite numbers, "
            "none negative, are needed."
        )
    means = [
        ekf.z[place] if s.mean is None else s.mean
        for s, place in zip(ekf.slow, ekf.places[ekf.num_states :], strict=True)
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
    ekf: Ekf,
    prior: Belief,
    inputs: ArrayLike,
    measured: ArrayLike,
    time: float = 0.0,
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
    size, rows = len(ekf.names), len(ekf.noise)
    shapes = (inputs.shape[-1:], measured.shape[-1:], measured.ndim)
    if shapes != ((len(ekf.entry),), (rows,), 3) or (
        inputs.shape[:2] != measured.shape[:2]
    ):
        raise InputError(
            f"run_ekf: the inputs have shape {inputs.shape}, the measurements "
            f"{measured.shape}; (B, K, {len(ekf.entry)}) and (B, K, {rows}) are needed."
        )
    check_belief(ekf, prior, "run_ekf")
    batch, samples = inputs.shape[:2]
    means = np.empty((batch, samples + 1, size))
    covariances = np.empty((batch, samples + 1, size, size))
    means[:, 0], covariances[:, 0] = prior.mean, prior.covariance
    innovations = np.empty((batch, samples, rows))
    spreads = np.empty((batch, samples, rows, rows))
    squares = np.empty((batch, samples))
    ekf.kernel.ekf_run(
        *ekf.loop_arguments(time),
        ekf.process * ekf.period,
        ekf.noise,
        inputs,
        measured,
        means,
        covariances,
        innovations,
        spreads,
        squares,
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
    n, size = ekf.num_states, len(ekf.names)
    shapes = np.shape(mean), np.shape(inputs)
    if shapes != ((size,), (len(ekf.entry),)):
        raise InputError(
            f"predict_mean: the mean and the inputs have shapes {shapes[0]} and "
            f"{shapes[1]}; ({size},) and ({len(ekf.entry)},) are needed."
        )
    z = ekf.z.copy()
    z[ekf.places], z[ekf.entry] = mean, inputs
    count = max(math.ceil(duration / ekf.step - 1e-9), 1)
    value = np.empty(size)
    slopes = np.empty((size, size) if differentiate else (0, 0))
    ekf.kernel.ekf_advance(
        time,
        z,
        n,
        ekf.places[n:],
        ekf.decay,
        ekf.acting,
        duration / count,
        count,
        ekf.model.residual_field,
        value,
        slopes,
    )
    return value, slopes
