"""Throws: a launch and a tape of elevator rates, drawn within limits, and flown."""

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from glider.campaign.logs import Campaign, Flight
from glider.campaign.motion_capture import MotionCapture
from glider.compiled.flight import fly_tapes
from glider.experiments.throw_limits import LAUNCH, ThrowLimits
from glider.physics.effects import Gaussians
from glider.physics.flown_range import describe_departures
from glider.physics.model import GliderModel
from glider.physics.parameter_space import ParameterSpace
from glider.physics.servo import Servo
from glider.physics.state import ELEVATOR, NUM_STATES, PITCH, POSITION, VELOCITY
from glider.simulation.campaigns import fly_commands, fly_path, measured
from glider.sysid.constants import Z
from glider.sysid.replay.log_space import log_space_of, vector_of
from glider.sysid.replay.record import Record
from glider.sysid.replay.replayed import signals

_MOVES = 9
"""Moves of the elevator in a throw, each to a target and beginning at a time."""

GENES = 4 + 2 * _MOVES + 1
"""Numbers that a throw is made of: launch, targets, times, how fast it moves."""

_USED, _MARGIN = 0.95, 0.03
"""Largest commanded rate, as a share of the servo's, and distance of the elevator's
targets from its stops [rad]."""

_USUAL_COMMAND_RATE = 50.0
"""Rate of commands where a campaign does not report it [Hz]."""

_FINE = 4
"""Integration steps between two rows of a predicted flight."""

_Z = POSITION[1]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Throw:
    """A launch and its elevator commands."""

    launch: np.ndarray  #: (7,) state at release, of STATE_NAMES [m, rad, m/s, rad/s].
    times: np.ndarray  #: (k,) when each command begins, from 0 [s].
    commands: np.ndarray  #: (k,) elevator rates, each held until the next [rad/s].
    duration: float  #: [s].

    @property
    def end(self) -> float:
        """When the last command ends [s]."""
        return float(self.times[-1] + self.times[1] - self.times[0])

    @property
    def speed(self) -> float:
        """At release [m/s]."""
        return float(np.linalg.norm(self.launch[VELOCITY]))

    @property
    def climb(self) -> float:
        """Angle of the velocity above the horizon at release [rad]."""
        xdot, zdot = self.launch[VELOCITY]
        return float(np.arctan2(zdot, xdot))


@dataclasses.dataclass(frozen=True, kw_only=True)
class Range:
    """Where throws are flown and how they are logged."""

    limits: ThrowLimits  #: Of launch, flight and elevator; none open.
    x: float  #: Of the release [m].
    rest: float  #: Angle of the elevator before the first command [rad].
    servo: Servo  #: Its limits, as flown flights show them.
    duration: float  #: Of a flight [s].
    pose_rate: float  #: Of the log [Hz].
    command_rate: float  #: Of the commands [Hz].


def range_of(
    campaign: Campaign, records: Sequence[Record], given: ThrowLimits | None = None
) -> Range:
    """Returns the range of a campaign's throws: what was flown, or `given` limits."""
    rests = np.array(
        [r.rest for r in records if not r.is_cut] or [records[0].usual_rest]
    )
    rest = float(np.median(rests))
    usual = records[0].usual_rest
    if abs(rest - usual) < Z * np.std(rests) / np.sqrt(len(rests)):  # By noise alone.
        rest = usual
    return Range(
        limits=_limits_of(campaign, records, given or ThrowLimits()),
        x=float(np.median([r.nodes[0, 0] for r in records])),
        rest=rest,
        servo=records[0].servo,
        duration=float(np.median([r.time[-1] for r in records])),
        pose_rate=campaign.row_rate,
        command_rate=campaign.command_rate or _USUAL_COMMAND_RATE,
    )


def _limits_of(
    campaign: Campaign, records: Sequence[Record], given: ThrowLimits
) -> ThrowLimits:
    """Limits that flown flights kept, with the given ones in their place."""
    starts = np.array([r.nodes[0] for r in records])
    nodes = np.vstack([r.nodes for r in records])
    xdot, zdot = starts[:, VELOCITY].T
    speeds = np.linalg.norm(nodes[:, VELOCITY], axis=1)
    x, z = nodes[:, POSITION].T
    angles = np.concatenate([r.elevator[r.seen[:, 3]] for r in records])
    commands = np.abs(np.concatenate([r.commands for r in records]))
    flown = {
        "launch_height": starts[:, _Z],
        "launch_speed": np.hypot(xdot, zdot),
        "launch_climb": np.arctan2(zdot, xdot),
        "launch_pitch": starts[:, PITCH],
        "x": x,
        "z": z,
        "pitch": np.append(nodes[:, PITCH], (-_STEEP, _STEEP)),
        "elevator": campaign.elevator_limits or angles,
    }
    limits: dict[str, Any] = {}
    for name, values in flown.items():
        low = float(np.min(values))
        limits[name] = low, max(float(np.max(values)), low + 1e-6)
    limits["speed"] = _FASTER * float(speeds.max())
    limits["elevator_rate"] = campaign.elevator_rate_limit or float(commands.max())
    for name, value in vars(given).items():
        if np.size(value) and np.all(np.isfinite(value)):
            limits[name] = value
    return ThrowLimits(**limits)


_FASTER = 1.1
"""Largest speed over the largest that was flown."""

_STEEP = math.radians(60.0)
"""Pitch that a flight may have either way, though none had [rad]."""


def throw_of(genes: np.ndarray, place: Range) -> Throw:
    """The throw that genes encode.

    Args:
        genes: (GENES,) in 0 .. 1: height, speed, climb, pitch; targets; times; rate.
        place: whose limits it keeps.
    """
    limits = place.limits
    least, largest = np.array([getattr(limits, name) for name in LAUNCH]).T
    low, high = np.add(limits.elevator, [_MARGIN, -_MARGIN])
    targets = low + genes[4 : 4 + _MOVES] * (high - low)
    begins = np.sort(genes[4 + _MOVES : 4 + 2 * _MOVES]) * place.duration
    fastest = _USED * limits.elevator_rate * (0.3 + 0.7 * genes[-1])
    times = np.arange(int(place.duration * place.command_rate) + 1) / place.command_rate
    moves = np.searchsorted(begins, times, side="right") - 1
    wanted = np.where(moves < 0, place.rest, targets[moves])
    return Throw(
        launch=_launch_state(least + genes[:4] * (largest - least), place),
        times=times,
        commands=_tape_towards(wanted, fastest, place),
        duration=place.duration,
    )


def _launch_state(launch: np.ndarray, place: Range) -> np.ndarray:
    """The state (7,) at release by height [m], speed [m/s], climb, pitch [rad]."""
    height, speed, climb, pitch = launch
    state = np.zeros(NUM_STATES)
    state[:3] = place.x, height, pitch
    state[VELOCITY] = speed * np.cos(climb), speed * np.sin(climb)
    state[ELEVATOR] = place.rest
    return state


def _tape_towards(wanted: np.ndarray, fastest: float, place: Range) -> np.ndarray:
    """Rates (k,) that take the elevator from rest to an angle at each end [rad/s]."""
    commands = np.zeros(len(wanted))
    angle = place.rest
    for k, target in enumerate(wanted):
        rate = (target - angle) * place.command_rate
        commands[k] = np.clip(rate, -fastest, fastest)
        angle += commands[k] / place.command_rate
    # A flight computer reads them from a file: what is flown is what the file holds.
    return np.round(commands, 4)


def log_of(
    throw: Throw,
    place: Range,
    space: ParameterSpace,
    theta: np.ndarray,
    gaussians: Gaussians,
) -> Flight:
    """The log that a model predicts of a throw, without noise."""
    rows = round(throw.duration * place.pose_rate) + 1
    return fly_commands(
        space,
        theta,
        throw.launch,
        throw.times,
        throw.commands,
        np.arange(rows) / place.pose_rate,
        servo=place.servo,
        rest=float(throw.launch[ELEVATOR]),
        gaussians=gaussians,
        fine=_FINE,
    )


def _perturbed(
    throw: Throw, limits: ThrowLimits, height: float, speed: float, pitch: float
) -> Throw:
    """A throw whose launch is off by multiples of the launch errors of the limits."""
    launch = throw.launch.copy()
    launch[_Z] += limits.missed_height * height
    launch[PITCH] += limits.missed_pitch * pitch
    launch[VELOCITY] *= 1.0 + limits.missed_speed * speed / throw.speed
    return dataclasses.replace(throw, launch=launch)


def fly_throw(
    model: GliderModel, throw: Throw, place: Range, rng: np.random.Generator
) -> Flight:
    """Simulates a throw by a glider and logs it.

    `place` is that of the proposal; `rng` draws the launch error and the noise of
    motion capture.
    """
    # The launch errors of the limits are two σ.
    thrown = _perturbed(throw, place.limits, *(0.5 * rng.normal(size=3)))
    flight = log_of(
        thrown, place, log_space_of(model), vector_of(model), model.gaussians
    )
    return measured(flight, MotionCapture(rate=place.pose_rate), rng)


def departures_of(model: GliderModel, throw: Throw, place: Range) -> str:
    """Describes how far a throw is beyond what a model was traced on; empty if not."""
    if not model.flown:
        return ""
    step = (throw.end - throw.times[-1]) / _FINE
    tape = np.repeat(throw.commands, _FINE)[: round(throw.duration / step)]
    start = model.initial_state(throw.launch)
    states = fly_tapes(model, start[None], tape[None], step, servo=place.servo)[0]
    rates = np.gradient(states[:, ELEVATOR], step)
    return describe_departures(model, step * np.arange(len(states)), states, rates)


def is_safe(
    throw: Throw,
    record: Record,
    theta: np.ndarray,
    gaussians: Gaussians,
    limits: ThrowLimits,
) -> bool:
    """Checks that a throw keeps within limits, perturbed launches too.

    `record` is the throw as the model (theta, gaussians) predicts it.
    """
    elevator, rate, *_ = signals(record, theta)
    for errors in _LAUNCH_ERRORS:
        launch = _perturbed(throw, limits, *errors).launch
        states = fly_path(
            record.space, theta, launch, record.time, elevator, rate, gaussians
        )
        # The place of release is given: it may lie on the edge of what was flown.
        if not limits.allows(states[1:]):
            return False
    return True


_LAUNCH_ERRORS = np.vstack([np.zeros(3), -np.eye(3), np.eye(3)])
"""Launch errors of height, speed and pitch that a throw must be safe with."""
