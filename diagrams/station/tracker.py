"""The state of the glider in flight, from poses that come late and not all."""

import dataclasses
import itertools
import math
from collections import deque

import numpy as np

from diagrams.station.scenario import Filter, Release, Sensors
from glider.campaign.motion_capture import MotionCapture
from glider.estimation.ekf import Ekf
from glider.estimation.perching import perching_filter
from glider.estimation.running import Belief, Estimates, make_prior, run_ekf
from glider.physics.model import GliderModel
from glider.physics.state import ELEVATOR, NUM_STATES, POSITION, STATE_NAMES, VELOCITY

RELEASE_STD = (0.002, 0.002, 0.01, 0.02, 0.3, 0.3, 0.5)
"""Standard deviations of the state at release, from the last poses before it: a slope
over three frames, 1/60 s old, of a glider that still accelerates or not."""

_PITCH = STATE_NAMES.index("pitch")


class CommandTape:
    """What the servo was asked, by the time at which it acts."""

    def __init__(self) -> None:
        # Time [s], angle so far [rad], and rate from then on [rad/s].
        self._steps: deque[tuple[float, float, float]] = deque(maxlen=64)

    def add(self, time: float, rate: float) -> None:
        """Appends a rate [rad/s] that begins at a time [s]."""
        self._steps.append((time, self._integral(time), rate))

    def mean_rate(self, begin: float, end: float) -> float:
        """Mean rate between two times [rad/s]."""
        if end <= begin:
            return 0.0
        return (self._integral(end) - self._integral(begin)) / (end - begin)

    def _integral(self, time: float) -> float:
        for since, angle, rate in reversed(self._steps):
            if since <= time:
                return angle + rate * (time - since)
        return self._steps[0][1] if self._steps else 0.0


class Tracker:
    """An extended Kalman filter for poses at any times, and its prediction.

    Args:
        model: the glider.
        sensors: what is measured, and how often.
        noise: of what is measured.
    """

    def __init__(self, model: GliderModel, sensors: Sensors, noise: Filter) -> None:
        start = model.initial_state(np.zeros(NUM_STATES))
        capture = MotionCapture(rate=sensors.rate, **vars(noise))
        # Of poses with and without an elevator.
        self._filters: dict[bool, Ekf] = {}
        for seen in (False, True):
            self._filters[seen], self.belief = perching_filter(
                model, start, elevator=seen, capture=capture
            )
        self._measures_elevator = sensors.elevator
        self.tape = CommandTape()
        self._frame = 1.0 / sensors.rate
        self.time = -math.inf  #: Of the belief [s].
        self.nis = 0.0  #: Normalized innovation squared of the last pose.
        self.distance = 0.0  #: From the last prediction to the pose [m].
        self.turned = 0.0  #: The same of the pitch [rad].

    @property
    def mean(self) -> np.ndarray:
        """Estimate (n,) at the last pose."""
        return self.belief.mean

    def start(self, time: float, state: np.ndarray) -> None:
        """Begins with a state (7,) that poses showed [s]."""
        self.belief = make_prior(self._filters[False], state, RELEASE_STD)
        self.time = time

    def update(self, time: float, measured: np.ndarray) -> None:
        """Takes a pose (4,), x, z, pitch and elevator, of a later time [s].

        An elevator that is NaN was not seen.
        """
        seen = self._measures_elevator and math.isfinite(measured[ELEVATOR])
        found = self._advance(time, measured[: 4 if seen else 3])
        self.belief = Belief(
            mean=found.means[0, -1], covariance=found.covariances[0, -1]
        )
        self.time = time
        innovation = found.innovations[0, -1]
        self.nis = float(found.nis[0, -1])
        self.distance = math.hypot(*innovation[POSITION])
        self.turned = abs(float(innovation[_PITCH]))

    def predict(self, time: float) -> np.ndarray:
        """The state (n,) at a time to come [s], under what was commanded."""
        if time <= self.time:
            return self.mean
        nothing = np.full(3, np.nan)
        return self._advance(time, nothing).means[0, -1]

    def _advance(self, time: float, measured: np.ndarray) -> Estimates:
        """Runs the filter to a time, in steps of about a frame."""
        span = time - self.time
        count = max(round(span / self._frame), 1)
        times = np.linspace(self.time, time, count + 1)
        mean_rate = self.tape.mean_rate
        inputs = [mean_rate(a, b) for a, b in itertools.pairwise(times)]
        chosen = self._filters[len(measured) == 4]
        shown = np.full((1, count, len(measured)), np.nan)
        shown[0, -1] = measured
        ekf = dataclasses.replace(
            chosen, period=span / count, step=span / count / chosen.steps
        )
        return run_ekf(ekf, self.belief, np.reshape(inputs, (1, count, 1)), shown)


class PoseHistory:
    """The last poses in the hand, and the motion that they show."""

    COUNT = 6
    """Frames of a parabola: at 120 Hz and 0.4 mm it shows accelerations to 2 m/s²."""

    def __init__(self) -> None:
        self._rows: deque[np.ndarray] = deque(maxlen=self.COUNT)

    def __len__(self) -> int:
        """Number of poses."""
        return len(self._rows)

    def add(self, time: float, pose: np.ndarray) -> None:
        """Appends a pose (4,) of a time [s]."""
        self._rows.append(np.array([time, *pose]))

    def clear(self) -> None:
        """Forgets all."""
        self._rows.clear()

    @property
    def shows_elevator(self) -> bool:
        """Whether the elevator was seen in most of them."""
        seen = [math.isfinite(row[1 + ELEVATOR]) for row in self._rows]
        return 2 * sum(seen) > len(seen)

    @property
    def state(self) -> np.ndarray:
        """(7,) at the last pose; its velocities are those of the last three.

        An elevator that was not seen is NaN.
        """
        rows = np.array(self._rows)[-3:]
        span = max(rows[-1, 0] - rows[0, 0], 1e-6)
        slopes = (rows[-1, 1:] - rows[0, 1:]) / span
        return np.concatenate([rows[-1, 1:], slopes[:3]])

    def motion(self) -> tuple[float, float]:
        """Speed [m/s], and acceleration along the path [m/s²], of all poses."""
        rows = np.array(self._rows)
        times = rows[:, 0] - rows[-1, 0]
        powers = np.stack([np.ones_like(times), times, 0.5 * times**2], axis=1)
        _, velocity, acceleration = np.linalg.lstsq(powers, rows[:, 1:3], rcond=None)[0]
        speed = math.hypot(*velocity)
        return speed, float(acceleration @ velocity) / max(speed, 1e-6)


class ReleaseDetector:
    """Sees from poses when the glider leaves the hand or the catapult.

    While it is pushed it accelerates along its path; free, it does not. It counts
    only near the planned launch, and after a rest.

    Args:
        limits: speed, acceleration and place of a release.
        launch: planned place (2,) [m].
    """

    def __init__(self, limits: Release, launch: np.ndarray) -> None:
        self._limits, self._launch = limits, launch
        self.poses = PoseHistory()
        self.pushed = False

    def add(self, time: float, pose: np.ndarray) -> bool:
        """Takes a pose (4,); returns whether the glider is free now."""
        self.poses.add(time, pose)
        if len(self.poses) < PoseHistory.COUNT:
            return False
        limits, (speed, acceleration) = self._limits, self.poses.motion()
        self.pushed = self.pushed or acceleration > limits.acceleration
        near = math.hypot(*(pose[POSITION] - self._launch)) < limits.radius
        free = self.pushed and acceleration < limits.acceleration
        return free and near and speed > limits.speed

    def find_fault(self, state: np.ndarray, planned: np.ndarray) -> str:
        """Why a release at a state (7,) is no start of a plan, "" if it is one."""
        limits, away = self._limits, state[:NUM_STATES] - planned[:NUM_STATES]
        speed, pitch = math.hypot(*away[VELOCITY]), float(away[_PITCH])
        if speed > limits.off_speed:
            return f"released with a velocity {speed:.1f} m/s off the plan"
        if abs(pitch) > limits.off_pitch:
            return f"released with a pitch {pitch:.2f} rad off the plan"
        return ""

    @property
    def rests(self) -> bool:
        """Whether the last poses show no motion."""
        if len(self.poses) < PoseHistory.COUNT:
            return False
        return self.poses.motion()[0] < REST

    def reset(self) -> None:
        """Waits for the next throw."""
        self.poses.clear()
        self.pushed = False


REST = 0.3
"""Speed of a glider that is held still [m/s]."""
