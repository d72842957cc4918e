"""Limits of proposed throws: of the launch, of the flight, of the elevator."""

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from glider.errors import expect
from glider.files import schema
from glider.physics.state import PITCH, POSITION, VELOCITY
from glider.sysid.replay.record import Record

_X, _Z = POSITION


@dataclasses.dataclass(kw_only=True)
class ThrowLimits:
    """Limits of a throw: [least, largest], or the largest alone.

    An empty pair, or a NaN, is as flown flights kept it; a file gives only the others.
    """

    #: Z at release [m].
    launch_height: list[float] = dataclasses.field(default_factory=list)
    #: Speed at release [m/s].
    launch_speed: list[float] = dataclasses.field(default_factory=list)
    #: Angle of the velocity above the horizon at release [rad].
    launch_climb: list[float] = dataclasses.field(default_factory=list)
    #: Pitch at release, nose down positive [rad].
    launch_pitch: list[float] = dataclasses.field(default_factory=list)
    x: list[float] = dataclasses.field(default_factory=list)  #: Over the flight [m].
    #: Over the flight, the least is the floor [m].
    z: list[float] = dataclasses.field(default_factory=list)
    #: Over the flight [rad].
    pitch: list[float] = dataclasses.field(default_factory=list)
    speed: float = math.nan  #: Largest speed over the flight [m/s].
    #: Angle of the elevator [rad].
    elevator: list[float] = dataclasses.field(default_factory=list)
    elevator_rate: float = math.nan  #: Largest commanded rate of the elevator [rad/s].
    #: Launch error of the height [m]: twice its standard deviation.
    missed_height: float = 0.03
    missed_speed: float = 0.2  #: The same of the speed [m/s].
    missed_pitch: float = 0.05  #: The same of the pitch [rad].

    def __post_init__(self) -> None:
        """Raises InputError where a limit cannot be."""
        needed = "[lower, upper] with lower < upper, or nothing for what was flown"
        for name in _PAIRS:
            pair = getattr(self, name)
            good = len(pair) == 2 and np.all(np.isfinite(pair)) and pair[0] < pair[1]
            expect(good or not len(pair), f"field '{name}'", pair, needed)
        for name in (*_NUMBERS, *_ERRORS):
            value = getattr(self, name)
            good = (math.isfinite(value) and value >= 0.0) or (
                name in _NUMBERS and math.isnan(value)
            )
            expect(good, f"field '{name}'", value, "a finite number of 0 or more")

    def allows(self, states: np.ndarray) -> bool:
        """Checks that a flight (n, 7 or more) keeps within the limits; none open."""
        if not np.all(np.isfinite(states)):
            return False
        inside = all(
            low <= float(np.min(states[:, i])) and float(np.max(states[:, i])) <= high
            for i, (low, high) in ((_X, self.x), (_Z, self.z), (PITCH, self.pitch))
        )
        fastest = float(np.max(np.linalg.norm(states[:, VELOCITY], axis=1)))
        return inside and fastest <= self.speed


LAUNCH = ("launch_height", "launch_speed", "launch_climb", "launch_pitch")
"""Limits of the launch, in the order that throws have them."""

_PAIRS = (*LAUNCH, "x", "z", "pitch", "elevator")
_NUMBERS = ("speed", "elevator_rate")
_ERRORS = ("missed_height", "missed_speed", "missed_pitch")

_FASTER = 1.1
"""Largest speed over the largest that was flown."""


def load_limits(path: Path | str) -> ThrowLimits:
    """Loads limits from a YAML file; InputError names a field that cannot be."""
    return schema.load_yaml(ThrowLimits, path, "a file of a throw's limits")


def limits_flown(
    records: Sequence[Record],
    travel: tuple[float, float] | None,
    rate: float | None,
    given: ThrowLimits | None = None,
) -> ThrowLimits:
    """Limits that flown flights kept, with the given ones in their place.

    `travel` [rad] and `rate` [rad/s] are the elevator's, if they are known.
    """
    starts = np.array([r.nodes[0] for r in records])
    nodes = np.vstack([r.nodes for r in records])
    velocity = starts[:, VELOCITY]
    angles = np.concatenate([r.elevator[r.seen[:, 3]] for r in records])
    commands = np.abs(np.concatenate([r.commands for r in records]))
    pitch = _range(nodes[:, PITCH])
    flown = ThrowLimits(
        launch_height=_range(starts[:, _Z]),
        launch_speed=_range(np.linalg.norm(velocity, axis=1)),
        launch_climb=_range(np.arctan2(velocity[:, 1], velocity[:, 0])),
        launch_pitch=_range(starts[:, PITCH]),
        x=_range(nodes[:, _X]),
        z=_range(nodes[:, _Z]),
        pitch=[min(pitch[0], -_STEEP), max(pitch[1], _STEEP)],
        speed=_FASTER * float(np.max(np.linalg.norm(nodes[:, VELOCITY], axis=1))),
        elevator=_range(angles) if travel is None else list(travel),
        elevator_rate=float(commands.max()) if rate is None else rate,
    )
    if given is None:
        return flown
    open_ones = [n for n in _PAIRS if not getattr(given, n)]
    open_ones += [n for n in _NUMBERS if math.isnan(getattr(given, n))]
    return dataclasses.replace(given, **{n: getattr(flown, n) for n in open_ones})


_STEEP = math.radians(60.0)
"""Pitch that a flight may have either way, though none had [rad]."""


def _range(values: np.ndarray) -> list[float]:
    low = float(np.min(values))
    high = float(np.max(values))
    return [low, max(high, low + 1e-6)]
