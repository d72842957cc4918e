"""What the servo was asked, and what poses before free flight show."""

import math
from collections import deque

import numpy as np

from diagrams.programs.station.scenario import Release
from glider.physics.held_commands import latest_command
from glider.physics.servo import Servo, held_angle
from glider.physics.state import ELEVATOR, NUM_STATES, PITCH, POSITION, VELOCITY

NO_COMMANDS = np.full((32, 3), (-1e12, 0.0, 0.0))
"""Rows of a tape before there were any: time [s], angle [rad] and rate [rad/s]. As many
as commands of 200 Hz in 160 ms: poses that old are not flown on."""


class CommandTape:
    """What the servo was asked, by the time at which it acts."""

    def __init__(self) -> None:
        #: Time [s], demanded angle then [rad], and command from then on [rad/s].
        self.rows = NO_COMMANDS

    def rest_at(self, angle: float) -> None:
        """Takes the elevator to rest at an angle [rad]."""
        self.rows = np.add(NO_COMMANDS, (0.0, angle, 0.0))

    def add(self, time: float, angle: float, rate: float) -> None:
        """Appends a rate [rad/s] that begins at a time [s] and an angle [rad]."""
        self.rows = np.vstack([self.rows[1:], (time, angle, rate)])

    def since(self, begin: float) -> np.ndarray:
        """The rows, one behind the other, with times counted from one [s]."""
        return (self.rows - (begin, 0.0, 0.0)).ravel()


def mean_rates(rows: np.ndarray, times: np.ndarray, servo: Servo) -> np.ndarray:
    """Returns mean demanded rates (k,) between times (k + 1,), by the rows of a tape.

    Each row has the demanded angle where its command begins: after a silence, in which
    the servo turns to neutral, that is another than the last command led to. No time
    has the rate 0.
    """
    latest = np.maximum(latest_command(rows[:, 0], times), 0)
    path = np.array(
        [
            held_angle(command, angle, servo, time - begin)
            for time, (begin, angle, command) in zip(
                times.tolist(), rows[latest].tolist(), strict=True
            )
        ]
    )
    spans = np.diff(times)
    rates = np.zeros(len(spans))
    return np.divide(np.diff(path), spans, out=rates, where=spans > 0.0)


_COUNT = 6
"""Frames of a parabola: at 120 Hz and 0.4 mm it shows accelerations to 2 m/s²."""

_REST = 0.3
"""Speed of a glider that is held still [m/s]."""


class ReleaseDetector:
    """Sees from the last poses when the glider leaves the hand or the catapult.

    While it is pushed it accelerates along its path; free, it does not. It counts
    only near the planned launch, and after a rest.

    Args:
        limits: speed, acceleration and place of a release.
        launch: planned place (2,) [m].
    """

    def __init__(self, limits: Release, launch: np.ndarray) -> None:
        self._limits = limits
        self._launch = launch
        self._rows: deque[np.ndarray] = deque(maxlen=_COUNT)
        self.pushed = False

    def add(self, time: float, pose: np.ndarray) -> bool:
        """Takes a pose (4,) of a time [s]; returns whether the glider is free now."""
        self._rows.append(np.array([time, *pose]))
        if len(self._rows) < _COUNT:
            return False
        limits = self._limits
        speed, acceleration = self._motion()
        self.pushed = self.pushed or acceleration > limits.acceleration
        near = math.hypot(*(pose[POSITION] - self._launch)) < limits.radius
        free = self.pushed and acceleration < limits.acceleration
        return free and near and speed > limits.speed

    def _motion(self) -> tuple[float, float]:
        """Speed [m/s], and acceleration along the path [m/s²], of all poses."""
        rows = np.array(self._rows)
        times = rows[:, 0] - rows[-1, 0]
        powers = np.stack([np.ones_like(times), times, 0.5 * times**2], axis=1)
        _, velocity, acceleration = np.linalg.lstsq(powers, rows[:, 1:3], rcond=None)[0]
        speed = math.hypot(*velocity)
        return speed, float(acceleration @ velocity) / max(speed, 1e-6)

    @property
    def shows_elevator(self) -> bool:
        """Whether the elevator was seen in most of the poses."""
        seen = [math.isfinite(row[1 + ELEVATOR]) for row in self._rows]
        return 2 * sum(seen) > len(seen)

    @property
    def state(self) -> np.ndarray:
        """(7,) at the last pose; its velocities are those of the last three.

        An elevator that was not seen is NaN.
        """
        rows = np.array(self._rows)
        last = rows[-1]
        moved = last - rows[-3:][0]
        slopes = moved[1:4] / max(moved[0], 1e-6)
        return np.concatenate([last[1:], slopes])

    @property
    def rests(self) -> bool:
        """Whether the last poses show no motion."""
        return len(self._rows) == _COUNT and self._motion()[0] < _REST

    def find_fault(self, state: np.ndarray, planned: np.ndarray) -> str:
        """Why a release at a state (7,) is no start of a plan, "" if it is one."""
        limits = self._limits
        away = state[:NUM_STATES] - planned[:NUM_STATES]
        speed = math.hypot(*away[VELOCITY])
        pitch = float(away[PITCH])
        if speed > limits.off_speed:
            return f"released with a velocity {speed:.1f} m/s off the plan"
        if abs(pitch) > limits.off_pitch:
            return f"released with a pitch {pitch:.2f} rad off the plan"
        return ""

    def reset(self) -> None:
        """Waits for the next throw."""
        self._rows.clear()
        self.pushed = False
