"""filterpy's extended Kalman filter on a flight as ours sees it.

Its predictions are ours, compiled and with their exact slopes; the filter is its own.
"""

import numpy as np

from benchmarks.peers.pairs import Pair
from glider.estimation.ekf import Ekf
from glider.estimation.perching import perching_filter
from glider.estimation.running import Belief, predict_mean, run_ekf
from tests.helpers.filter_consistency import UNCERTAIN
from tests.helpers.flights import NOMINAL, PROBLEM
from tests.helpers.noisy_flights import draw_starts, fly_watched

SAMPLES = 100


def filter_along(
    ekf: Ekf, prior: Belief, inputs: np.ndarray, measured: np.ndarray
) -> np.ndarray:
    """Returns the last mean (N,) of filterpy's filter along one flight."""
    from filterpy.kalman import ExtendedKalmanFilter

    size, rows = len(ekf.names), len(ekf.noise)

    class Filter(ExtendedKalmanFilter):
        """The filter with our prediction, as its documentation asks for."""

        def predict_x(self, u=0):
            self.x, self.F = predict_mean(
                ekf, self.x, u, ekf.period, differentiate=True
            )

    own = Filter(dim_x=size, dim_z=rows)
    own.x, own.P = prior.mean.copy(), prior.covariance.copy()
    own.Q, own.R = np.diag(ekf.process * ekf.period), ekf.noise
    shows = np.eye(rows, size)
    for u, sample in zip(inputs, measured, strict=True):
        own.predict(u)
        own.update(sample, lambda x: shows, lambda x: x[:rows])
    return own.x


def pairs() -> tuple[Pair, ...]:
    """Returns 100 samples of one flight: 9 numbers, of which 4 are measured."""
    rng = np.random.default_rng(0)
    ekf, prior = perching_filter(NOMINAL, PROBLEM.launch, slow=UNCERTAIN)
    tape = 2.0 * np.sin(np.arange(SAMPLES) / 8.0)[:, None]
    flight = fly_watched(ekf, draw_starts(prior, 1, rng), tape, rng)
    last: dict[str, np.ndarray] = {}

    def ours():
        last["ours"] = run_ekf(ekf, prior, flight.inputs, flight.measured).means[0, -1]

    def theirs():
        last["theirs"] = filter_along(ekf, prior, flight.inputs[0], flight.measured[0])

    def told() -> str:
        apart = np.max(np.abs(last["ours"] - last["theirs"]))
        return f"the same mean to {apart:.0e}"

    return (
        Pair(
            task="extended Kalman filter, 100 samples, 9 numbers",
            peer="filterpy, with our predictions",
            ours=ours,
            theirs=theirs,
            told=told,
        ),
    )
