"""Flights with the noise that a filter believes in, for it to watch."""

import dataclasses

import numpy as np

from glider.compiled.ekf import fly_believed
from glider.errors import InputError
from glider.estimation.ekf import Ekf
from glider.estimation.running import Belief


@dataclasses.dataclass(frozen=True, kw_only=True)
class WatchedFlights:
    """B flights of K samples; of x̄ all are known."""

    times: np.ndarray
    """(K + 1,) [s]."""

    states: np.ndarray
    """(B, K + 1, N) x̄."""

    inputs: np.ndarray
    """(B, K, 1 + known) held between the samples."""

    measured: np.ndarray
    """(B, K, M) behind each."""


def draw_starts(prior: Belief, flights: int, rng: np.random.Generator) -> np.ndarray:
    """Draws x̄ from what is believed of it, (flights, N)."""
    return rng.multivariate_normal(prior.mean, prior.covariance, flights)


def fly_watched(
    ekf: Ekf,
    starts: np.ndarray,
    inputs: np.ndarray,
    rng: np.random.Generator | None = None,
    *,
    gain: np.ndarray | None = None,
    is_shaken: bool = True,
) -> WatchedFlights:
    """Flies a filter's own glider, with the filter's noise on it.

    Args:
        ekf: the filter, whose glider, samples and noise are taken.
        starts: (B, N) x̄ at launch; slow states that no noise moves are constants.
        inputs: (K, 1 + known) for all flights or (B, K, 1 + known).
        rng: draws the noise; None for none at all.
        gain: (K, f, n), a feedback of the true state that is subtracted from the
            first f inputs; None for none.
        is_shaken: whether the process noise acts; the measurements' does.

    Raises:
        InputError: what is given does not fit the filter.
    """
    starts = np.array(starts, dtype=float, ndmin=2)
    batch, size = starts.shape
    inputs = np.asarray(inputs, dtype=float)
    given = inputs.ndim in (2, 3) and inputs.shape[:-2] in ((), (1,), (batch,))
    if size != len(ekf.names) or not given or inputs.shape[-1] != ekf.num_inputs:
        raise InputError(
            f"fly_watched: starts of shape {starts.shape} and inputs of shape "
            f"{inputs.shape} are given; (B, {len(ekf.names)}) and "
            f"(B, K, {ekf.num_inputs}) are needed."
        )
    samples, n, rows = inputs.shape[-2], ekf.num_states, len(ekf.noise)
    gain = np.zeros((samples, 0, n)) if gain is None else np.asarray(gain, dtype=float)
    if gain.ndim != 3 or (
        (gain.shape[0], gain.shape[2]) != (samples, n) or gain.shape[1] > ekf.num_inputs
    ):
        raise InputError(
            f"fly_watched: the gain has shape {gain.shape}; ({samples}, f, {n}) with "
            f"f at most {ekf.num_inputs} is needed."
        )
    inputs = np.broadcast_to(inputs, (batch, samples, ekf.num_inputs))
    shocks, errors = np.zeros((batch, samples, size)), np.zeros((batch, samples, rows))
    if rng is not None:
        if is_shaken:
            shocks = rng.normal(size=shocks.shape) * np.sqrt(ekf.process * ekf.period)
        errors = rng.normal(size=errors.shape) @ np.linalg.cholesky(ekf.noise).T
    inputs, states, measured = fly_believed(
        ekf.model,
        ekf.z,
        ekf.estimated,
        ekf.clock,
        gain,
        (shocks, errors),
        inputs,
        starts,
    )
    times = ekf.period * np.arange(samples + 1)
    return WatchedFlights(times=times, states=states, inputs=inputs, measured=measured)
