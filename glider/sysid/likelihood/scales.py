"""Standard deviations of sensors, moving air and flight-to-flight variation.

They are positive, and fitted by their logarithms between `FLOOR` and `CEILING`.
"""

import dataclasses

import numpy as np

from glider.sysid.constants import MOMENT_TIME
from glider.sysid.replay.record import Noise

_AT_FLOOR = 2.0  # Over the least scale, which a fit only comes near.
_MAY_BE_NOTHING = "air", "moment", "servo", "wind", "trim", "pitch_zero", "memory"
_NOTHING = 1e-9  # Of a scale in its unit.
_LEAST_ELEVATOR = 1e-4  # Least noise of an elevator, where there is none [rad].


@dataclasses.dataclass(frozen=True, kw_only=True)
class Scales:
    """Standard deviations of all noise, by default where a fit of them starts (c)."""

    position: float = 0.001  #: Of measured x and z [m].
    pitch: float = 0.005  #: Of measured pitch [rad].
    elevator: float = 0.01  #: Of the measured elevator [rad].
    air: float = 0.05  #: Of the moving air, in x and in z [m/s].
    air_time: float = 0.25  #: Its correlation time [s].
    moment: float = 1.0  #: Of unmodelled accelerations [rad/s²].
    servo: float = 0.005  #: Of the elevator off its path [rad].
    wind: float = 0.05  #: Of flights' steady winds, x and z [m/s].
    trim: float = 0.005  #: Of their elevator trims [rad].
    pitch_zero: float = 0.005  #: Of their pitch readings [rad].
    rest: float = 0.01  #: Of elevators at rest, about zero [rad].
    memory: float = 0.1  #: Of effects' states at launch, in theirs.

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
        """Of flights' constants: wind in x and z, trim and pitch zero, (4,)."""
        return np.array([self.wind, self.wind, self.trim, self.pitch_zero])

    @property
    def sensors(self) -> tuple[float, ...]:
        """Of measured x, z, pitch and elevator, (4,)."""
        return self.position, self.position, self.pitch, self.elevator

    @property
    def times(self) -> tuple[float, ...]:
        """Correlation times of the processes, (4,) [s], in the filter's order."""
        return self.air_time, self.air_time, MOMENT_TIME, MOMENT_TIME

    def without(self, *names: str) -> "Scales":
        """Returns the scales with some of them at their floors."""
        least = {name: getattr(FLOOR, name) for name in names}
        return dataclasses.replace(self, **least)

    @property
    def without_floors(self) -> "Scales":
        """The scales with what is at its floor, and so not shown, next to nothing."""
        least = {n: _AT_FLOOR * getattr(FLOOR, n) for n in _MAY_BE_NOTHING}
        none = {n: _NOTHING for n, own in least.items() if getattr(self, n) < own}
        return dataclasses.replace(self, **none)

    @classmethod
    def from_logs(cls, logs: np.ndarray) -> "Scales":
        """Returns the scales of such logarithms."""
        return cls(**dict(zip(NAMES, map(float, np.exp(logs)), strict=True)))


NAMES = tuple(field.name for field in dataclasses.fields(Scales))
FLOOR = Scales(  # The least that a log shows (c).
    position=1e-06,
    pitch=1e-05,
    elevator=1e-05,
    air=0.001,
    air_time=0.04,
    moment=0.01,
    servo=0.0001,
    wind=0.001,
    trim=0.0001,
    pitch_zero=0.0001,
    rest=0.0001,
    memory=0.001,
)
CEILING = Scales(  # The most that a flight of a glider has (c).
    position=0.2,
    pitch=0.3,
    elevator=0.3,
    air=0.6,
    air_time=1.0,
    moment=200.0,
    servo=0.3,
    wind=0.5,
    trim=0.1,
    pitch_zero=0.03,
    rest=0.5,
    memory=1.0,
)


def start_scales(noise: Noise) -> Scales:
    """Start of a fit of the scales: little more than sensor noise."""
    return Scales(
        position=noise.position,
        pitch=noise.pitch,
        elevator=max(noise.elevator, _LEAST_ELEVATOR),
    )
