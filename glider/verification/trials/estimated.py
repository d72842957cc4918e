"""The estimation error that a funnel tolerates, by flights on an estimate.

A funnel is proven for a feedback of the true state. Here the same feedback acts on an
extended Kalman filter's estimate from motion capture. An estimate's error e is measured
as √(eᵀ S e): 1 is as far as the boundary. Launches and noise are random: no escape in
300 flights still allows one in a hundred.
"""

import dataclasses
import itertools
import math
from collections.abc import Sequence

import numpy as np

from glider.errors import expect
from glider.estimation.ekf import make_ekf
from glider.estimation.perching import CAPTURE, PROCESS
from glider.estimation.running import Belief
from glider.planning.problem import Hook
from glider.progress import Progress, silent
from glider.simulation.flown_flights import closest_pass
from glider.simulation.fly import AFTER
from glider.simulation.on_estimate import fly_on_estimate
from glider.verification.funnel.funnel import Funnel, funnel_policy
from glider.verification.trials.falsify import draw_inside

NOISES = (0.0001, 0.001, 0.002, 0.003, 0.005, 0.007, 0.01, 0.02)
"""Standard deviations of a measured position [m]; angles in proportion."""

UNKNOWN = (0.1, 0.2, 0.5, 1.0)
"""Shares of a launch's deviation that the filter does not know."""

_TICKS = 4
"""Predictions of the filter, each followed by a command, to each sample."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class EstimatedFlights:
    """The outcome of launches from inside a funnel, flown on an estimate."""

    noise: float  #: Standard deviation of a measured position [m].
    unknown: float  #: Share of the launch's deviation that the filter did not know.
    times: np.ndarray  #: Times (K + 1,) from the launch to the funnel's end [s].
    levels: np.ndarray  #: V (B, K + 1) of the true state; 1 is the boundary.
    believed: np.ndarray  #: V (B, K + 1) of the estimate.
    errors: np.ndarray  #: √(eᵀ S e) (B, K + 1) of the estimate's error.
    command_errors: np.ndarray  #: |K e| (B, K + 1) of it [rad/s].
    miss: np.ndarray  #: Least distance (B,) of the center of mass from the wire [m].
    arrivals: np.ndarray  #: States (B, n) there.

    @property
    def escaped(self) -> np.ndarray:
        """Whether the true state left the funnel, (B,); launches are inside."""
        return ~(self.levels.max(axis=1) <= 1.0)  # NaN is an escape.

    @property
    def believed_escaped(self) -> np.ndarray:
        """Whether the estimate left it, (B,)."""
        return ~(self.believed.max(axis=1) <= 1.0)

    @property
    def perched(self) -> np.ndarray:
        """Whether the article's hook holds the glider at the wire, (B,)."""
        return Hook().takes(self.miss, self.arrivals)


def study_estimates(
    funnel: Funnel,
    flights: int,
    rng: np.random.Generator,
    *,
    noises: Sequence[float] = NOISES,
    unknown: Sequence[float] = UNKNOWN,
    progress: Progress = silent,
) -> list[EstimatedFlights]:
    """Flies launches uniform in the inlet with the same noise, scaled to each level.

    Returns:
        outcomes, one for each share and noise, the noises of a share in a row.
    """
    starts = draw_inside(funnel, flights, rng)
    samples = math.ceil((funnel.nominal.times[-1] + AFTER) * CAPTURE.rate)
    draws = rng.normal(size=(flights, samples, len(CAPTURE.std)))
    found = []
    for share, noise in itertools.product(unknown, noises):
        progress(f"on the estimate, noise {1e3 * noise:g} mm")
        found.append(fly_estimated(funnel, starts, noise, share, draws))
    return found


def fly_estimated(
    funnel: Funnel, starts: np.ndarray, noise: float, unknown: float, draws: np.ndarray
) -> EstimatedFlights:
    """Flies launches with the funnel's feedback on a filter's estimate.

    Args:
        starts: (B, n) launches.
        noise: standard deviation of a measured position [m]; the angles' are in
            proportion, as in CAPTURE.std. The process noise is PROCESS.
        unknown: share, 0 to 1, of the launch's deviation that the filter does not know.
            Its covariance is that of launches uniform in the inlet, S⁻¹ / (n + 2),
            times the share squared.
        draws: (B, K, 4) standard normal, scaled by the noise; of the samples until
            AFTER the funnel's end, one period after launch and so on.

    Raises:
        InputError: the noise or the share is out of range.
    """
    good = math.isfinite(noise) and noise > 0.0
    expect(good, "fly_estimated: the noise", noise, "a positive number of meters")
    good = 0.0 <= unknown <= 1.0
    what = "fly_estimated: the unknown share"
    expect(good, what, unknown, "a number from 0 to 1")
    std = CAPTURE.std * (noise / CAPTURE.position)
    rate = _TICKS * CAPTURE.rate
    policy = funnel_policy(funnel)
    ekf = make_ekf(funnel.nominal.model, rate=rate, process=PROCESS, noise=std**2)
    spread = np.linalg.inv(funnel.shape(0.0)) / (funnel.num_states + 2)
    mean = starts - unknown * (starts - funnel.center(0.0))
    prior = Belief(mean=mean, covariance=unknown**2 * spread)
    states, means = fly_on_estimate(policy, ekf, starts, prior, draws * std, _TICKS)
    times = np.arange(states.shape[1]) / rate
    passes = [closest_pass(times, path, np.zeros(2)) for path in states]
    kept = times <= funnel.nominal.times[-1]
    truth = states[:, kept]
    estimate = means[:, kept]
    times = times[kept]
    errors = np.sqrt(funnel.level(times, funnel.center(times) + estimate - truth))
    off = np.einsum("bki,ki->bk", estimate - truth, policy.sample(times)[1])
    return EstimatedFlights(
        noise=noise,
        unknown=unknown,
        times=times,
        levels=funnel.level(times, truth),
        believed=funnel.level(times, estimate),
        errors=errors,
        command_errors=np.abs(off),
        miss=np.array([passed.miss for passed in passes]),
        arrivals=np.array([passed.arrival for passed in passes]),
    )
