"""Motion capture as an instrument: its rate, its noise, and what it logs."""

import dataclasses
import math

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from glider.campaign.logs import Flight
from glider.campaign.turning import signs_of
from glider.errors import InputError, expect
from glider.physics.held_commands import latest_command
from glider.physics.model import GliderModel
from glider.physics.state import ELEVATOR, NUM_STATES, POSE_NAMES

_POSE = slice(0, len(POSE_NAMES))
_POSE_RATES = slice(ELEVATOR + 1, NUM_STATES)


@dataclasses.dataclass(frozen=True, kw_only=True)
class MotionCapture:
    """Cameras that see the pose, and a sensor of the elevator's angle.

    The defaults are those of the practice campaigns.
    """

    rate: float = 120.0  #: Of the samples [Hz].
    position: float = 0.0004  #: Standard deviation of a measured x and z [m].
    pitch: float = 0.0025  #: Standard deviation of a measured pitch [rad].
    elevator: float = 0.005  #: Standard deviation of a measured elevator angle [rad].

    def __post_init__(self):
        """Raises InputError where a number cannot be."""
        for name, value in vars(self).items():
            least = "positive" if name == "rate" else "not negative"
            fits = value > 0.0 if name == "rate" else value >= 0.0
            what = f"MotionCapture: '{name}'"
            expected = f"a finite number, {least}"
            expect(fits and math.isfinite(value), what, value, expected)

    @property
    def std(self) -> np.ndarray:
        """Standard deviations of x, z, pitch and elevator, shape (4,) [m, rad]."""
        return np.array([self.position, self.position, self.pitch, self.elevator])

    def draw(self, rng: np.random.Generator, *shape: int) -> np.ndarray:
        """Draws noise of samples, (*shape, 4) [m, rad]."""
        return rng.normal(size=(*shape, 4)) * self.std

    def log(
        self,
        model: GliderModel,
        times: np.ndarray,
        states: np.ndarray,
        commands: tuple[np.ndarray, np.ndarray],
        rng: np.random.Generator,
        name: str,
    ) -> Flight:
        """Logs a flight, noise included; a new command shows in the first row after it.

        Args:
            model: whose sensors show the pose.
            times: (K,) of the states, from 0 [s].
            states: (K, n) of the glider.
            commands: when each began (H,) [s], and elevator rates (H,) [rad/s].
            rng: draws the noise.
            name: of the flight's file, flight_*.csv.

        Raises:
            InputError: the flight did not stay finite.
        """
        if not np.all(np.isfinite(states)):
            raise InputError(f"{name}: the flight diverges; it cannot be logged.")
        time = np.arange(int(times[-1] * self.rate + 1e-9) + 1) / self.rate
        seen = np.stack([np.interp(time, times, x) for x in states.T], axis=1)
        path = CubicHermiteSpline(times, states[:, _POSE], states[:, _POSE_RATES])
        seen[:, _POSE] = path(time)
        shown = model.chain.measure(seen.T, model.numbers)
        noise = self.draw(rng, len(time))
        begins, rates = commands
        signs = signs_of(model)  # The pitch has its sign already.
        return Flight(
            name=name,
            time=time,
            pose=np.stack(shown, axis=1) + noise[:, _POSE],
            elevator=signs.elevator * (seen[:, ELEVATOR] + noise[:, -1]),
            command=signs.command * rates[latest_command(begins, time)],
        )
