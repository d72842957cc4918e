"""What a session on the station consists of, read from YAML."""

import dataclasses
import math
from pathlib import Path
from typing import Annotated, Any, Literal

from msgspec import Meta

from diagrams.programs.station.bus import free_address
from diagrams.programs.station.proposed import load_launch
from glider.errors import InputError, expect
from glider.estimation.perching import CAPTURE
from glider.files import schema
from glider.files.schema import Finite, NotNegative, Positive, Share
from glider.physics.model import GliderModel
from glider.planning.problem import PerchingProblem

BUS = "udpm://239.255.76.67:7667?ttl=0"
"""Address of the bus that real gliders are flown on, if no other is given."""

_Delay = Annotated[float, Meta(ge=0.0, le=1.0)]
_Angle = Annotated[float, Meta(ge=-math.pi, le=math.pi)]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Sensors:
    """Cameras, as the station knows them."""

    rate: Annotated[float, Meta(gt=0.0, le=1000.0)] = 120.0  #: Of the frames [Hz].
    latency: _Delay = 0.006  #: Least time from exposure to reception [s].
    elevator: bool = True  #: Whether the elevator's angle is measured too.
    #: Standard error of the frames' times against those of the commands [s]: that of
    #: `latency`. A delay that it explains is no effect of the glider.
    clock_std: _Delay = 0.001


@dataclasses.dataclass(frozen=True, kw_only=True)
class Filter:
    """Standard deviations of the poses, as the Kalman filter assumes them."""

    position: Positive = CAPTURE.position  #: [m]
    pitch: Positive = CAPTURE.pitch  #: [rad]
    elevator: Positive = CAPTURE.elevator  #: [rad]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Servo:
    """The servo, as the station knows it; its limits are the glider's."""

    latency: _Delay = 0.004  #: Time from a command sent until the servo moves [s].
    neutral: _Angle = 0.0  #: Safe angle of the elevator [rad].
    timeout: _Delay = 0.04  #: Silence after which the servo goes to neutral [s].


@dataclasses.dataclass(frozen=True, kw_only=True)
class Release:
    """What counts as the start of free flight, and how far it may be off the plan."""

    speed: NotNegative = 4.0  #: Least speed [m/s].
    #: Along the path; above it the glider is pushed, below it free [m/s²].
    acceleration: NotNegative = 8.0
    radius: NotNegative = 1.0  #: Largest distance from the planned launch [m].
    off_speed: NotNegative = 2.5  #: Most that the speed may be off the plan [m/s].
    off_pitch: NotNegative = 0.6  #: Most that the pitch may be off the plan [rad].


@dataclasses.dataclass(frozen=True, kw_only=True)
class Limits:
    """When the station stops trusting what it sees or does."""

    #: Age of the last usable pose [s], since its exposure: at 120 Hz, and a latency of
    #: 6 ms, four frames may be lost in a row.
    stale: NotNegative = 0.048
    speed: NotNegative = 20.0  #: Between two poses [m/s].
    turn_rate: NotNegative = 40.0  #: Between two poses [rad/s].
    x: tuple[Finite, Finite] = (-8.0, 4.0)  #: [m]
    z: tuple[Finite, Finite] = (-2.5, 3.0)  #: [m]
    distance: NotNegative = 0.1  #: From the filter's prediction to the pose [m].
    angle: NotNegative = 0.4  #: The same of the pitch [rad].
    #: Delay of a command [s]; two delayed in a row stop it.
    deadline: NotNegative = 0.01


@dataclasses.dataclass(frozen=True, kw_only=True)
class Simulation:
    """A simulated glider on the bus, its launcher and its cameras."""

    truth: str = "head_wind"  #: Model file, or one of models/truths.
    seed: Annotated[int, Meta(ge=0)] = 0  #: Of launches and noise.
    acceleration: Positive = 40.0  #: Of the launcher [m/s²].
    latency: _Delay = 0.006  #: From exposure to the bus [s].
    jitter: _Delay = 0.0005  #: Mean of what comes on top of it [s].
    lost: Share = 0.01  #: Share of the frames that are lost.
    duplicated: Share = 0.01  #: Share that comes twice.
    late: Share = 0.01  #: Share that comes after the next one.
    clock_offset: Finite = 1000.0  #: Of the cameras' clock [s].
    #: Of the cameras' clock [s/s].
    clock_drift: Annotated[float, Meta(ge=-0.01, le=0.01)] = 50e-6
    servo_latency: _Delay = 0.004  #: From a command sent until the servo moves [s].


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
    command_rate: Annotated[float, Meta(ge=10.0, le=200.0)] | None = 50.0
    bus: str | None = None  #: Address of LCM; None: BUS, or one of a simulation's own.
    sensors: Sensors = Sensors()
    filter: Filter = Filter()
    servo: Servo = Servo()
    release: Release = Release()
    limits: Limits = Limits()
    simulation: Simulation | None = None

    def __post_init__(self):
        """Raises InputError where times, or ends of a range, do not fit together."""
        for name in ("x", "z"):
            low, high = getattr(self.limits, name)
            field = f"field 'limits.{name}'"
            expect(low < high, field, [low, high], "[least, largest]")
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


def make_scenario(
    path: Path | None, truth: str | None = None, **changes: object
) -> Scenario:
    """A scenario's file, or the defaults, with what a command line changes.

    Args:
        path: of the file; None: there is none.
        truth: of a simulated glider; None: as the file says.
        changes: texts of fields; None leaves one as it is.

    Returns:
        The scenario. A simulated glider has a bus of its own unless one is named.
    """
    scenario = load_scenario(path) if path else Scenario()
    given: dict[str, Any] = {k: str(v) for k, v in changes.items() if v is not None}
    if truth is not None:
        simulation = scenario.simulation or Simulation()
        given["simulation"] = dataclasses.replace(simulation, truth=truth)
    scenario = dataclasses.replace(scenario, **given)
    if scenario.simulation is None or scenario.bus is not None:
        return scenario
    return dataclasses.replace(scenario, bus=free_address())
