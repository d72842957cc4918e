"""A filter along flights: prior beliefs and estimates."""

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike

from glider.compiled.ekf import LOOPS
from glider.errors import expect
from glider.estimation.ekf import Ekf
from glider.physics.state import NUM_STATES


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Belief:
    """A normal distribution of x̄, or one for each of B flights."""

    mean: np.ndarray  #: (N,) or (B, N).
    covariance: np.ndarray  #: (N, N) or (B, N, N).


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Estimates:
    """Estimates that a filter makes of B flights of K samples."""

    #: (B, K + 1, N) of x̄: before the first sample, then behind each.
    means: np.ndarray
    covariances: np.ndarray  #: (B, K + 1, N, N).
    innovations: np.ndarray  #: (B, K, M) measured minus predicted.
    innovation_covariances: np.ndarray  #: (B, K, M, M) S.
    nis: np.ndarray  #: (B, K) νᵀ S⁻¹ ν, the normalized innovation squared.


def make_prior(ekf: Ekf, state: ArrayLike, std: ArrayLike) -> Belief:
    """Returns the belief before the first sample.

    Args:
        ekf: the filter.
        state: (7,), the effects' own states at rest, or (n,).
        std: standard deviations of the states, (7,) or (n,); those not given are
            zero. The slow states bring their own.

    Raises:
        InputError: what is given does not fit the filter, or is no number.
    """
    n = ekf.num_states
    full = ekf.model.initial_state(state)
    sizes = f"({NUM_STATES},) or ({n},)"
    finite = full.shape == (n,)
    finite = finite and bool(np.isfinite(full).all())
    expect(finite, "make_prior: the state", full, f"{sizes} finite numbers")
    given = np.asarray(std, dtype=float)
    fits = given.shape in ((NUM_STATES,), (n,))
    expect(fits, "make_prior: the shape of the deviations", given.shape, sizes)
    spread = np.zeros(len(ekf.names))
    spread[: len(given)] = given
    spread[n:] = [s.std for s in ekf.slow]
    good = np.isfinite(spread) & (spread >= 0.0)
    needed = "finite numbers, none negative"
    expect(good.all(), "make_prior: the deviations", spread, needed)
    places = ekf.estimated.places[ekf.num_states :]
    means = [
        ekf.z[place] if s.mean is None else s.mean
        for s, place in zip(ekf.slow, places, strict=True)
    ]
    mean = np.append(full, means)
    return Belief(mean=mean, covariance=np.diag(spread**2))


def check_belief(ekf: Ekf, prior: Belief, source: str) -> None:
    """Raises InputError where a belief is of another filter's x̄."""
    size = len(ekf.names)
    shapes = (prior.mean.shape, prior.covariance.shape)
    mean, covariance = shapes
    good = mean[-1:] == (size,)
    good = good and covariance[-2:] == (size, size)
    what = f"{source}: the shape of the prior's mean and covariance"
    expect(good, what, shapes, f"({size},) and ({size}, {size})")


def run_ekf(
    ekf: Ekf,
    prior: Belief,
    inputs: ArrayLike,
    measured: ArrayLike,
    time: float = 0.0,
    *,
    period: float | None = None,
) -> Estimates:
    """Runs a filter along flights.

    Args:
        ekf: the filter.
        prior: before the first sample, of all flights or of each.
        inputs: (B, K, 1 + known) mean of the elevator's rate, then the known inputs,
            between a sample and the one before it.
        measured: (B, K, M) at the samples; one with a NaN is omitted.
        time: of the prior [s].
        period: between samples [s]; None: the filter's.

    Raises:
        InputError: what is given does not fit the filter.
    """
    period = ekf.period if period is None else period
    inputs = np.ascontiguousarray(inputs, dtype=float)
    measured = np.ascontiguousarray(measured, dtype=float)
    rows = len(ekf.noise)
    size = len(ekf.names)
    model = ekf.model
    good = measured.ndim == inputs.ndim == 3
    good = good and inputs.shape[:-1] == measured.shape[:-1]
    good = good and inputs.shape[2] == ekf.num_inputs
    good = good and measured.shape[2] == rows
    needed = f"(B, K, {ekf.num_inputs}) and (B, K, {rows})"
    shapes = inputs.shape, measured.shape
    expect(good, "run_ekf: the shape of inputs and measurements", shapes, needed)
    check_belief(ekf, prior, "run_ekf")
    batch, samples, _ = measured.shape
    found = Estimates(
        means=np.empty((batch, samples + 1, size)),
        covariances=np.empty((batch, samples + 1, size, size)),
        innovations=np.empty((batch, samples, rows)),
        innovation_covariances=np.empty((batch, samples, rows, rows)),
        nis=np.empty((batch, samples)),
    )
    found.means[:, 0] = prior.mean
    found.covariances[:, 0] = prior.covariance
    LOOPS.over(model.kinds).ekf_run(
        time,
        ekf.z.copy(),
        ekf.estimated,
        (period / ekf.steps, ekf.steps),
        model.gaussians,
        ekf.process * period,
        ekf.noise,
        inputs,
        measured,
        (found.means, found.covariances),
        (found.innovations, found.innovation_covariances, found.nis),
    )
    return found


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
    shapes = (np.shape(mean), np.shape(inputs))
    size = len(ekf.names)
    good = ((size,), (ekf.num_inputs,))
    needed = f"({size},) and ({ekf.num_inputs},)"
    what = "predict_mean: the shape of mean and inputs"
    expect(shapes == good, what, shapes, needed)
    z = ekf.z.copy()
    model = ekf.model
    z[ekf.estimated.places] = mean
    z[ekf.estimated.entry] = inputs
    steps = max(math.ceil(duration / ekf.step - 1e-9), 1)
    value = np.empty(size)
    columns = size if differentiate else 0
    slopes = np.empty((columns, columns))
    loop = LOOPS.over(model.kinds).ekf_advance
    step = duration / steps
    gaussians = model.gaussians
    loop(time, z, ekf.estimated, step, steps, gaussians, value, slopes)
    return value, slopes
