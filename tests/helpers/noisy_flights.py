"""Flights with the noise that a filter assumes, and the least covariance they allow."""

import dataclasses

import numpy as np

from glider.compiled.runge_kutta import advance
from glider.errors import expect
from glider.estimation.ekf import Ekf
from glider.estimation.running import Belief, run_ekf
from glider.physics.chain import NUM_INPUTS
from glider.physics.servo import limited_rate


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
    """Draws x̄ from a belief, (flights, N)."""
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
    samples, n, rows = inputs.shape[-2], ekf.num_states, len(ekf.noise)
    good = inputs.ndim in (2, 3) and inputs.shape[:-2] in ((), (1,), (batch,))
    good = good and (size, inputs.shape[-1]) == (len(ekf.names), ekf.num_inputs)
    needed = f"(B, {len(ekf.names)}) and (B, K, {ekf.num_inputs})"
    shapes = (starts.shape, inputs.shape)
    expect(good, "fly_watched: the shape of starts and inputs", shapes, needed)
    gain = np.zeros((samples, 0, n)) if gain is None else np.asarray(gain, dtype=float)
    good = gain.ndim == 3 and (gain.shape[0], gain.shape[2]) == (samples, n)
    good = good and gain.shape[1] <= ekf.num_inputs
    needed = f"({samples}, f, {n}) with f at most {ekf.num_inputs}"
    expect(good, "fly_watched: the gain's shape", gain.shape, needed)
    model = ekf.model
    servo = model.parameters.servo
    shocks, errors = np.zeros((batch, samples, size)), np.zeros((batch, samples, rows))
    if rng is not None:
        if is_shaken:
            shocks = rng.normal(size=shocks.shape) * np.sqrt(ekf.process * ekf.period)
        errors = rng.normal(size=errors.shape) @ np.linalg.cholesky(ekf.noise).T
    held = np.broadcast_to(inputs, (batch, samples, ekf.num_inputs)).copy()
    states = np.empty((batch, samples + 1, size))
    measured = np.empty_like(errors)
    states[:, 0] = starts
    z = np.repeat(ekf.z[:, None], batch, axis=1)
    for k in range(samples):
        now = states[:, k]
        held[:, k, : gain.shape[1]] -= now[:, :n] @ gain[k].T
        angles = model.chain.demanded_angle(now.T, model.numbers.c)
        commands = zip(held[:, k, 0], angles, strict=True)
        held[:, k, 0] = [limited_rate(rate, angle, servo) for rate, angle in commands]
        z[ekf.estimated.places], z[ekf.estimated.entry] = now.T, held[:, k].T
        _advance(ekf, k * ekf.period, z)
        z[ekf.estimated.places] += shocks[:, k].T
        states[:, k + 1] = z[ekf.estimated.places].T
        measured[:, k] = _measure(ekf, z) + errors[:, k]
    times = ekf.period * np.arange(samples + 1)
    return WatchedFlights(times=times, states=states, inputs=held, measured=measured)


def _advance(ekf: Ekf, t: float, z: np.ndarray) -> None:
    """Advances x̄ within z (Z, B) by a sample, with the steps of `compiled.ekf`."""
    n, slow = ekf.num_states, ekf.estimated.places[ekf.num_states :]
    gaussians, chain, step = ekf.model.gaussians, ekf.model.chain, ekf.step
    half = np.exp(-0.5 * step * ekf.estimated.decay)[:, None]
    work = np.empty((3, n, z.shape[1]))

    def slope(t, node, x, start, rate):
        z[:n], z[slow] = x, start * half**node
        for i, derivative in enumerate(chain.derivatives_of(t, z, n, gaussians)):
            rate[i] = derivative

    x = z[:n].copy()
    for lap in range(ekf.steps):
        start = z[slow]
        advance(slope, t + lap * step, x, step, 4, start, work)
        z[:n], z[slow] = x, start * half**2


def _measure(ekf: Ekf, z: np.ndarray) -> np.ndarray:
    """Measurements at z (Z, B), shape (B, M)."""
    n, chain = ekf.num_states, ekf.model.chain
    theta = chain.theta_of(z[n + NUM_INPUTS :], ekf.model.gaussians)
    return np.column_stack([*chain.measure(z[:n], theta), *z[3 : len(ekf.noise)]])


def information_bound(ekf: Ekf, prior: Belief, inputs: np.ndarray) -> np.ndarray:
    """Returns the least covariances that a flight allows, (K + 1, N, N) of x̄.

    Without process noise a flight is a function of its start and its slow states, and
    the inverse of prior plus Fisher information, J₀ + Σ Gᵀ R⁻¹ G with the sensitivities
    G = ∂y/∂x̄₀, bounds every estimator's covariance (Van Trees). A Kalman filter along
    the true flight computes that inverse, moved along with the flight.

    Args:
        ekf: the filter; its process noise is omitted.
        prior: about the true x̄ at launch.
        inputs: (K, 1 + known) of the flight.
    """
    quiet = dataclasses.replace(ekf, process=np.zeros(len(ekf.names)))
    flight = fly_watched(quiet, prior.mean, inputs)
    return run_ekf(quiet, prior, flight.inputs, flight.measured).covariances[0]
