"""The article's study: wing offset and elevator area from no knowledge, in flight.

A glider with a motor cruises under an infinite-horizon LQR through a drifting wind.
The filter measures the full state, is given the wind and the thrust, and starts with
both numbers at zero. The same filter then watches a perch, which the article only
asks for: of another glider, whose wing offset is zero (that of the cruise finds no
perch plan), and which it guesses at PERCH_GUESS. The thrust is the coefficient of
the effect of that name, which the controller sets at each sample: the one physics has
no other motor and needs none.
Where the article's own numbers cannot be, this is what is done instead:
- its cruise (nose up 0.05 rad at 9 m/s) carries less than half the weight; here it
  is the level flight at 9 m/s;
- its filter steps by 1/119 s on data of 0.01 s; here both take 0.01 s;
- its Q does not say of which time; here it is a variance per second, so that it
  means the same at every rate. Per sample, S_e would wander 0.3 m² in a second.

A settled cruise is flown too, but no filter's word on it is passed on: see
`settled_bound`.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np

from glider.control.tvlqr import TrackingPolicy
from glider.estimation.ekf import WIND_NAMES, Ekf, SlowState, make_ekf
from glider.estimation.running import Belief, Estimates, make_prior, run_ekf
from glider.physics.effects import THRUST
from glider.physics.model import GliderModel
from glider.physics.parameters import GliderParameters
from noisy_flights import WatchedFlights, fly_watched, information_bound
from powered_cruise import cruise_gain, level_flight

RATE = 100.0
"""Rate of samples, commands and wind [Hz]."""

SLOW = ("wing_offset", "elevator_area")
"""Parameters that are estimated [m, m²]."""

SYMBOLS = ("l_w", "S_e")
"""Symbols of SLOW in the article."""

PERCH_GUESS = (0.02, 0.0)
"""Estimate of SLOW before the perch, whose glider's wing offset is zero."""

CRUISE_START = (-3.5, 0.5, 0.0, 0.0, 7.0, 0.0, 0.0)
"""Launch of the article's cruise, in the order of STATE_NAMES."""

CRUISE_SPEED = 9.0
"""Speed of the cruise over ground [m/s]."""

CRUISE_WIND = (-1.0, 0.5)
"""Wind at the start of the cruise, (x, z) [m/s]."""

STILL = (0.0, 0.0)
"""Wind at the start of the other flights, (x, z) [m/s]; it drifts from there."""

CRUISE_DURATION = 4.0
"""Duration of the cruise [s]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class StudyNoise:
    """Variances that the filter believes in; the defaults are the article's."""

    prior: float = 0.1
    """Variance of each state before the first sample."""

    slow_prior: tuple[float, float] = (0.1, 0.1)
    """Variances of SLOW before the first sample."""

    measurement: float = 0.01
    """Variance of each measured state."""

    state: float = 0.01
    """Variance that each state gains per second."""

    slow: float = 0.001
    """Variance that each slow state gains per second."""


CONSTANTS = StudyNoise(prior=0.01, slow_prior=(0.03**2, 0.015**2), slow=0.0)
"""Noise of a filter that takes the numbers for constants, of their own size before.

Over 80 flights with different noise `slow_nees` is in the end 0.95 for the cruise and
1.37 for the perch: a little too sure, and once in 80 wrong by five deviations. With
the article's prior (0.3 m, twenty times the elevator) an extended Kalman filter may
settle on a wrong glider and be sure of it: 9 of 80 cruises and 16 of 80 perches are
then off by more than four deviations, and of the article's own filter, which lets the
numbers drift, 4 of 80 cruises and no perch.
"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ParameterTrack:
    """A flight, what the filter made of it, and what it could have made."""

    flight: WatchedFlights
    """One flight; x̄ ends with the true slow states."""

    estimates: Estimates
    """Estimates of the filter."""

    bound: np.ndarray
    """(K + 1, 2) least standard deviations of SLOW by Fisher information."""

    @property
    def slow(self) -> np.ndarray:
        """(K + 1, 2) estimates of SLOW."""
        return self.estimates.means[0, :, -len(SLOW) :]

    @property
    def std(self) -> np.ndarray:
        """(K + 1, 2) their standard deviations, as the filter has them."""
        diagonal = np.diagonal(self.estimates.covariances[0], axis1=1, axis2=2)
        return np.sqrt(diagonal[:, -len(SLOW) :])

    def numbers(self, sample: int = -1) -> dict[str, list[float]]:
        """Returns [estimate, deviation, truth] of SLOW behind a sample, by symbol."""
        rows = np.column_stack([self.slow[sample], self.std[sample], self.truth])
        return dict(zip(SYMBOLS, rows.tolist(), strict=True))

    @property
    def truth(self) -> np.ndarray:
        """(2,) of SLOW."""
        return self.flight.states[0, 0, -len(SLOW) :]


def study_ekf(
    parameters: GliderParameters,
    noise: StudyNoise,
    guess: tuple[float, float] = (0.0, 0.0),
) -> Ekf:
    """Makes the study's filter: full state, wind and thrust known, SLOW guessed."""
    slow = zip(SLOW, noise.slow_prior, guess, strict=True)
    return make_ekf(
        GliderModel(parameters=parameters, effects=(THRUST(),)),
        rate=RATE,
        process=[noise.state] * 7,
        noise=[noise.measurement] * 7,
        slow=tuple(
            SlowState(name=name, std=prior**0.5, walk=noise.slow, mean=mean)
            for name, prior, mean in slow
        ),
        known=(*WIND_NAMES, "thrust.force"),
    )


def draw_wind(
    samples: int, rng: np.random.Generator, start: tuple[float, float]
) -> np.ndarray:
    """Draws the article's wind, (samples, 2) [m/s]: w ← 0.999 w + 0.01 N(0, I)."""
    wind = np.empty((samples, 2))
    wind[0] = start
    for k in range(1, samples):
        wind[k] = 0.999 * wind[k - 1] + 0.01 * rng.normal(size=2)
    return wind


def watch_cruise(
    parameters: GliderParameters,
    rng: np.random.Generator,
    noise: StudyNoise | None = None,
) -> ParameterTrack:
    """Flies the article's cruise and filters it.

    Its launch, 0.5 m too high and 2 m/s too slow, is a violent manoeuvre, with the
    elevator at its rate limit.

    Args:
        parameters: the true glider.
        rng: draws the wind and the measurements' noise.
        noise: of the filter; None for the article's.
    """
    noise = StudyNoise() if noise is None else noise
    ekf = study_ekf(parameters, noise)
    flight = _fly_cruise(ekf, np.array(CRUISE_START), CRUISE_WIND, rng)
    return _watch(ekf, flight, noise)


def settled_bound(
    parameters: GliderParameters,
    rng: np.random.Generator,
    noise: StudyNoise | None = None,
) -> np.ndarray:
    """Returns the least deviations of SLOW in a cruise from trim, (K + 1, 2).

    The wind drifts from still air. What a filter of CONSTANTS says of this flight
    is not to be trusted: over 20 of them it leaves S_e near zero, where it began,
    off by a median of 63 of its own deviations, which are 0.06 of the least
    possible. So only the Fisher information is returned, which needs no estimate.

    Args:
        parameters: the true glider.
        rng: draws the wind.
        noise: of the measurements and the prior; None for the article's.
    """
    noise = StudyNoise() if noise is None else noise
    ekf = study_ekf(parameters, noise)
    trim = level_flight(parameters, CRUISE_SPEED)
    return _least_std(ekf, _fly_cruise(ekf, trim[:7], STILL, rng), noise)


def watch_perch(
    parameters: GliderParameters,
    policy: TrackingPolicy,
    rng: np.random.Generator,
    noise: StudyNoise | None = None,
) -> ParameterTrack:
    """Flies a perch and filters it in the same way, from PERCH_GUESS.

    The wind drifts by the same law, but from still air: the plan knows no wind, and
    the article's carries the glider 0.5 m off the wire.

    Args:
        parameters: the true glider.
        policy: what tracks the plan; it is given the true state.
        rng: draws the wind and the measurements' noise.
        noise: of the filter; None for the article's.
    """
    noise = StudyNoise() if noise is None else noise
    ekf = study_ekf(parameters, noise, PERCH_GUESS)
    samples = round(policy.plan.duration * RATE)
    offset, gain = policy.sample(np.arange(samples) / RATE)
    inputs = np.zeros((samples, 4))
    inputs[:, 0] = offset
    inputs[:, 1:3] = draw_wind(samples, rng, STILL)
    start = policy.plan.states[0]
    return _watch(ekf, _fly(ekf, start, inputs, gain[:, None, :], rng), noise)


def slow_nees(flights: Sequence[ParameterTrack], sample: int = -1) -> float:
    """Returns the squared error of SLOW over what the filter expects, a mean.

    1 is right, more is too sure, less is too modest.

    Args:
        flights: the same flight with different noise.
        sample: of each flight.
    """
    squares = []
    for watched in flights:
        error = watched.slow[sample] - watched.truth
        covariance = watched.estimates.covariances[0, sample]
        block = covariance[-len(SLOW) :, -len(SLOW) :]
        squares.append(error @ np.linalg.solve(block, error))
    return float(np.mean(squares)) / len(SLOW)


def _fly_cruise(
    ekf: Ekf, start: np.ndarray, wind: tuple[float, float], rng: np.random.Generator
) -> WatchedFlights:
    parameters, samples = ekf.model.parameters, round(CRUISE_DURATION * RATE)
    trim = level_flight(parameters, CRUISE_SPEED)
    inputs = np.zeros((samples, 4))
    inputs[:, 1:3] = draw_wind(samples, rng, wind)
    # Inputs in the filter's order: elevator rate, wind, thrust.
    full = np.zeros((4, 7))
    full[[0, 3]] = cruise_gain(parameters, trim)
    inputs += full @ trim[:7]
    inputs[:, 3] += trim[7]
    return _fly(ekf, start, inputs, np.tile(full, (samples, 1, 1)), rng)


def _fly(
    ekf: Ekf,
    start: np.ndarray,
    inputs: np.ndarray,
    gain: np.ndarray,
    rng: np.random.Generator,
) -> WatchedFlights:
    truth = [getattr(ekf.model.parameters, name) for name in SLOW]
    x = np.append(start, truth)
    return fly_watched(ekf, x, inputs, rng, gain=gain, is_shaken=False)


def _watch(ekf: Ekf, flight: WatchedFlights, noise: StudyNoise) -> ParameterTrack:
    prior = _prior(ekf, flight, noise)
    return ParameterTrack(
        flight=flight,
        estimates=run_ekf(ekf, prior, flight.inputs, flight.measured),
        bound=_least_std(ekf, flight, noise),
    )


def _prior(ekf: Ekf, flight: WatchedFlights, noise: StudyNoise) -> Belief:
    """Returns the filter's prior at launch: its mean is the true one's."""
    return make_prior(ekf, flight.states[0, 0, :7], [noise.prior**0.5] * 7)


def _least_std(ekf: Ekf, flight: WatchedFlights, noise: StudyNoise) -> np.ndarray:
    covariance = _prior(ekf, flight, noise).covariance
    about_truth = Belief(mean=flight.states[0, 0], covariance=covariance)
    bound = information_bound(ekf, about_truth, flight.inputs[0])
    return np.sqrt(np.diagonal(bound, axis1=1, axis2=2)[:, -len(SLOW) :])
