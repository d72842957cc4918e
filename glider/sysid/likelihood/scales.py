"""Standard deviations of sensors, moving air and flight-to-flight variation."""

import dataclasses
from typing import Any

import numpy as np

from glider.sysid.constants import MOMENT_TIME, NOISE, SERVO_TIME
from glider.sysid.replay.record import Noise

_AT_FLOOR = 2.0  # Over the least scale, which a fit only comes near.
_LEAST_ELEVATOR = 1e-4  # Least noise of an elevator, where there is none [rad].


def _scale(name: str) -> Any:
    """A scale where it starts, and its range."""
    usual, least, most = NOISE[name]
    return dataclasses.field(default=usual, metadata={"range": (least, most)})


@dataclasses.dataclass(frozen=True, kw_only=True)
class Scales:
    """Standard deviations of all noise."""

    position: float = _scale("position")  #: Of measured x and z [m].
    pitch: float = _scale("pitch")  #: Of measured pitch [rad].
    elevator: float = _scale("elevator")  #: Of the measured elevator [rad].
    air: float = _scale("air")  #: Of the moving air, in x and in z [m/s].
    air_time: float = _scale("air_time")  #: Its correlation time [s].
    moment: float = _scale("moment")  #: Of unmodelled accelerations [rad/s²].
    servo: float = _scale("servo")  #: Of the elevator off its path [rad].
    wind: float = _scale("wind")  #: Of flights' steady winds, x and z [m/s].
    trim: float = _scale("trim")  #: Of their elevator trims [rad].
    pitch_zero: float = _scale("pitch_zero")  #: Of their pitch readings [rad].
    rate: float = _scale("rate")  #: Of the pitch rate of a gyro [rad/s].

    @property
    def logs(self) -> np.ndarray:
        """Natural logarithms, in the order of the fields."""
        return np.log(np.array(dataclasses.astuple(self)))

    @property
    def is_still(self) -> bool:
        """Whether the air is."""
        return self.air < _AT_FLOOR * FLOOR.air

    @property
    def of_flights(self) -> np.ndarray:
        """Of flights' constants: wind in x and z, trim and pitch zero."""
        return np.array([self.wind, self.wind, self.trim, self.pitch_zero])

    @property
    def sensors(self) -> tuple[float, float, float, float, float]:
        """Of measured x, z, pitch, elevator and pitch rate."""
        return self.position, self.position, self.pitch, self.elevator, self.rate

    @property
    def times(self) -> tuple[float, float, float, float]:
        """Correlation times of the processes [s], in the filter's order."""
        return self.air_time, self.air_time, MOMENT_TIME, SERVO_TIME

    @classmethod
    def from_logs(cls, logs: np.ndarray) -> "Scales":
        """Returns the scales of such logarithms."""
        return cls(**dict(zip(NAMES, map(float, np.exp(logs)), strict=True)))


NAMES = tuple(field.name for field in dataclasses.fields(Scales))
FLOOR, CEILING = (
    Scales(**{f.name: f.metadata["range"][end] for f in dataclasses.fields(Scales)})
    for end in (0, 1)
)
# Prior of the logarithms. Flights in nearly still air do not determine the gusts' time:
# its range is two standard deviations either way. The others have none.
USUAL = Scales().logs
PRECISION = np.where(
    np.array(NAMES) == "air_time", (0.25 * (CEILING.logs - FLOOR.logs)) ** -2.0, 0.0
)


def lifted(scales: Scales) -> Scales:
    """Returns scales at least halfway to their usual ones, in logarithms.

    A fit that begins with little noise keeps to the errors of the model before it.
    """
    least = np.where(PRECISION == 0.0, 0.5 * (FLOOR.logs + USUAL), -np.inf)
    return Scales.from_logs(np.maximum(scales.logs, least))


def start_scales(noise: Noise) -> Scales:
    """Start of a fit of the scales: little more than sensor noise."""
    return Scales(
        position=noise.position,
        pitch=noise.pitch,
        elevator=max(noise.elevator, _LEAST_ELEVATOR),
    )
