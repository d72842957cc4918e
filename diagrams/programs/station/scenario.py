"""What a session on the station consists of, read from YAML."""

import dataclasses
import math
from pathlib import Path
from typing import Literal

from diagrams.programs.station.proposed import load_launch
from glider.errors import InputError, expect
from glider.estimation.perching import CAPTURE
from glider.files import schema
from glider.physics.model import GliderModel
from glider.planning.problem import PerchingProblem

CONTROLLERS = ("tvlqr", "mpc", "mppi")
BUS = "udpm://239.255.76.67:7667?ttl=0"
"""Address of the bus that real gliders are flown on, if no other is given."""


def _check(part: object, signed: tuple[str, ...] = (), **most: float) -> None:
    """Raises InputError where a number of a part of the scenario cannot be.

    Args:
        part: a dataclass.
        signed: names of fields that may be negative; lists may be, too.
        most: largest sizes by name.
    """
    for name, value in vars(part).items():
        if not isinstance(value, int | float):
            continue
        limit = most.get(name, math.inf)
        expected = "finite"
        if name not in signed:
            expected += " and not negative"
        if name in most:
            expected += f", at most {limit:g}"
        good = math.isfinite(value) and (name in signed or value >= 0.0)
        expect(good and abs(value) <= limit, f"field '{name}'", value, expected)


def _check_positive(part: object, *names: str) -> None:
    for name in names:
        value = getattr(part, name)
        expect(value > 0.0, f"field '{name}'", value, "positive")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Sensors:
    """Cameras, as the station knows them."""

    rate: float = 120.0  #: Of the frames [Hz].
    latency: float = 0.006  #: Least time from exposure to reception [s].
    elevator: bool = True  #: Whether the elevator's angle is measured too.
    #: Standard error of the frames' times against those of the commands [s]: that of
    #: `latency`. A delay that it explains is no effect of the glider.
    clock_std: float = 0.001

    def __post_init__(self):
        """Raises InputError where a number cannot be."""
        _check(self, rate=1000.0, latency=1.0, clock_std=1.0)
        _check_positive(self, "rate")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Filter:
    """Standard deviations of the poses, as the Kalman filter assumes them."""

    position: float = CAPTURE.position  #: [m]
    pitch: float = CAPTURE.pitch  #: [rad]
    elevator: float = CAPTURE.elevator  #: [rad]

    def __post_init__(self):
        """Raises InputError where a number cannot be."""
        _check(self)
        _check_positive(self, "position", "pitch", "elevator")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Servo:
    """The servo, as the station knows it; its limits are the glider's."""

    latency: float = 0.004  #: Time from a command sent until the servo moves [s].
    neutral: float = 0.0  #: Safe angle of the elevator [rad].
    timeout: float = 0.04  #: Silence after which the servo goes to neutral [s].

    def __post_init__(self):
        """Raises InputError where a number cannot be."""
        _check(self, ("neutral",), neutral=math.pi, timeout=1.0, latency=1.0)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Release:
    """What counts as the start of free flight, and how far it may be off the plan."""

    speed: float = 4.0  #: Least speed [m/s].
    #: Along the path; above it the glider is pushed, below it free [m/s²].
    acceleration: float = 8.0
    radius: float = 1.0  #: Largest distance from the planned launch [m].
    off_speed: float = 2.5  #: Most that the speed may be off the plan [m/s].
    off_pitch: float = 0.6  #: Most that the pitch may be off the plan [rad].

    def __post_init__(self):
        """Raises InputError where a number cannot be."""
        _check(self)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Limits:
    """When the station stops trusting what it sees or does."""

    #: Age of the last usable pose [s], since its exposure: at 120 Hz, and a latency of
    #: 6 ms, four frames may be lost in a row.
    stale: float = 0.048
    speed: float = 20.0  #: Between two poses [m/s].
    turn_rate: float = 40.0  #: Between two poses [rad/s].
    x: list[float] = dataclasses.field(default_factory=lambda: [-8.0, 4.0])  #: [m]
    z: list[float] = dataclasses.field(default_factory=lambda: [-2.5, 3.0])  #: [m]
    distance: float = 0.1  #: From the filter's prediction to the pose [m].
    angle: float = 0.4  #: The same of the pitch [rad].
    deadline: float = 0.01  #: Delay of a command [s]; two delayed in a row stop it.

    def __post_init__(self):
        """Raises InputError where a number cannot be."""
        _check(self)
        for name in ("x", "z"):
            room = getattr(self, name)
            good = len(room) == 2 and -math.inf < room[0] < room[1] < math.inf
            expect(good, f"field 'limits.{name}'", room, "[lower, upper]")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Simulation:
    """A simulated glider on the bus, its launcher and its cameras."""

    truth: str = "head_wind"  #: Model file, or one of models/truths.
    seed: int = 0  #: Of launches and noise.
    acceleration: float = 40.0  #: Of the launcher [m/s²].
    latency: float = 0.006  #: From exposure to the bus [s].
    jitter: float = 0.0005  #: Mean of what comes on top of it [s].
    lost: float = 0.01  #: Share of the frames that are lost.
    duplicated: float = 0.01  #: Share that comes twice.
    late: float = 0.01  #: Share that comes after the next one.
    clock_offset: float = 1000.0  #: Of the cameras' clock [s].
    clock_drift: float = 50e-6  #: Of the cameras' clock [s/s].
    servo_latency: float = 0.004  #: From a command sent until the servo moves [s].

    def __post_init__(self):
        """Raises InputError where a number cannot be."""
        shares = dict.fromkeys(("lost", "duplicated", "late"), 1.0)
        delays = dict.fromkeys(("latency", "jitter", "servo_latency"), 1.0)
        clock = {"clock_offset": 1e9, "clock_drift": 0.01}
        _check(self, tuple(clock), **shares, **delays, **clock)
        _check_positive(self, "acceleration")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Scenario:
    """A session: glider, problem, controller, bus, sensors, filter, servo, limits."""

    model: str | None = None  #: Model that is planned with; None: the nominal glider.
    problem: str = "perching"  #: Problem file, or one of models/problems.
    #: File of a proposed throw's commands, flown without feedback from its launch.
    commands: str | None = None
    controller: Literal["tvlqr", "mpc", "mppi"] = "tvlqr"
    #: Rate of the commands [Hz]; None: one for each pose. Poses at 120 Hz and commands
    #: at 50 Hz drift past each other, so that a log shows when each command was given.
    command_rate: float | None = 50.0
    bus: str | None = None  #: Address of LCM; None: BUS, or one of a simulation's own.
    sensors: Sensors = Sensors()
    filter: Filter = Filter()
    servo: Servo = Servo()
    release: Release = Release()
    limits: Limits = Limits()
    simulation: Simulation | None = None

    def __post_init__(self):
        """Raises InputError where a number cannot be."""
        rate = self.command_rate
        expected = "a number of Hz from 10 to 200"
        good = rate is None or 10 <= rate <= 200
        expect(good, "field 'command_rate'", rate, expected)
        least = self.command_step + self.limits.deadline
        expected = f"at least {least:.3g} s, a command's time and its deadline"
        timeout = self.servo.timeout
        stale = self.limits.stale
        expect(timeout >= least - 1e-9, "field 'servo.timeout'", timeout, expected)
        least = self.sensors.latency + 1.0 / self.sensors.rate
        expected = f"above {least:.3g} s, the age of a pose when the next one comes"
        expect(stale > least, "field 'limits.stale'", stale, expected)

    @property
    def address(self) -> str:
        """Address of the bus."""
        return self.bus or BUS

    @property
    def command_step(self) -> float:
        """Time between two commands [s]; without a rate the longest one."""
        rate = self.command_rate
        return 1.5 / self.sensors.rate if rate is None else 1.0 / rate

    @property
    def truth(self) -> GliderModel | None:
        """The simulated glider; None where a real one flies."""
        if self.simulation is None:
            return None
        try:
            return GliderModel.load(self.simulation.truth)
        except InputError as error:
            raise InputError(f"the simulated glider: {error}") from None

    def load_model(self) -> GliderModel:
        """The glider that is planned with: for a simulated one, without its effects."""
        if self.model is not None:
            return GliderModel.load(self.model)
        truth = self.truth
        return GliderModel(parameters=truth.parameters) if truth else GliderModel()

    def load_problem(self) -> PerchingProblem:
        """The perch to fly, or with commands their launch."""
        problem = PerchingProblem.load(self.problem)
        if self.commands is None:
            return problem
        launch = load_launch(Path(self.commands))
        return dataclasses.replace(problem, launch=launch)


def load_scenario(path: Path | str) -> Scenario:
    """Loads a scenario, which gives only what differs from the defaults."""
    return schema.load_yaml(Scenario, path, "a scenario")
