"""Limits of proposed throws: of the launch, of the flight, of the elevator."""

import dataclasses
import math
from pathlib import Path

import numpy as np

from glider.errors import expect
from glider.files import schema
from glider.files.schema import Finite, NotNegative
from glider.physics.state import PITCH, POSITION, VELOCITY

_Pair = tuple[Finite, ...]


@dataclasses.dataclass(kw_only=True)
class ThrowLimits:
    """Limits of a throw: (least, largest), or the largest alone.

    An empty pair, or a NaN, is as flown flights kept it; a file gives only the others.
    """

    launch_height: _Pair = ()  #: Z at release [m].
    launch_speed: _Pair = ()  #: Speed at release [m/s].
    launch_climb: _Pair = ()  #: Angle of the velocity above the horizon then [rad].
    launch_pitch: _Pair = ()  #: Pitch at release, nose down positive [rad].
    x: _Pair = ()  #: Over the flight [m].
    z: _Pair = ()  #: Over the flight, the least is the floor [m].
    pitch: _Pair = ()  #: Over the flight [rad].
    speed: NotNegative = math.nan  #: Largest speed over the flight [m/s].
    elevator: _Pair = ()  #: Angle of the elevator [rad].
    #: Largest commanded rate of the elevator [rad/s].
    elevator_rate: NotNegative = math.nan
    #: Launch error of the height [m]: twice its standard deviation.
    missed_height: NotNegative = 0.03
    missed_speed: NotNegative = 0.2  #: The same of the speed [m/s].
    missed_pitch: NotNegative = 0.05  #: The same of the pitch [rad].

    def __post_init__(self) -> None:
        """Raises InputError where a pair is none."""
        needed = "[lower, upper] with lower < upper, or nothing for what was flown"
        for name, value in vars(self).items():
            if np.ndim(value):
                good = len(value) == 2 and -math.inf < value[0] < value[1] < math.inf
                expect(good or not len(value), f"field '{name}'", value, needed)

    def allows(self, states: np.ndarray) -> bool:
        """Checks that a flight (n, 7 or more) keeps within the limits; none open."""
        limits = np.array([self.x, self.z, self.pitch])
        places = states[:, [*POSITION, PITCH]]
        inside = (limits[:, 0] <= places) & (places <= limits[:, 1])
        speeds = np.linalg.norm(states[:, VELOCITY], axis=1)
        is_finite = np.all(np.isfinite(states))
        return bool(is_finite and np.all(inside) and np.all(speeds <= self.speed))


LAUNCH = ("launch_height", "launch_speed", "launch_climb", "launch_pitch")
"""Limits of the launch, in the order that throws have them."""


def load_limits(path: Path | str) -> ThrowLimits:
    """Loads limits from a YAML file; InputError names a field that cannot be."""
    return schema.load_yaml(ThrowLimits, path, "a file of a throw's limits")
