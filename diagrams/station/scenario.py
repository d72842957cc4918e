"""What a session on the station is made of, as a YAML file has it."""

import dataclasses
import math
from pathlib import Path
from typing import Literal

from glider.errors import expect
from glider.files import schema
from glider.paths import models_path
from glider.physics.model import GliderModel
from glider.planning.problem import PerchingProblem

CONTROLLERS = ("tvlqr", "mpc", "mppi")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Sensors:
    """Cameras, as the station knows them."""

    rate: float = 120.0  #: Of the frames [Hz].
    latency: float = 0.006  #: Least time from exposure to reception [s].
    elevator: bool = True  #: Whether the elevator's angle is measured too.


@dataclasses.dataclass(frozen=True, kw_only=True)
class Servo:
    """The servo, as the station knows it; its limits are the glider's."""

    latency: float = 0.004  #: Time from a command sent until the servo moves [s].
    neutral: float = 0.0  #: Safe angle of the elevator [rad].
    timeout: float = 0.04  #: Silence after which the servo goes to neutral [s].


@dataclasses.dataclass(frozen=True, kw_only=True)
class Release:
    """What is taken for the start of free flight."""

    speed: float = 4.0  #: Least speed [m/s].
    #: Along the path; above it the glider is pushed, below it free [m/s²].
    acceleration: float = 8.0
    radius: float = 1.0  #: Largest distance from the planned launch [m].


@dataclasses.dataclass(frozen=True, kw_only=True)
class Limits:
    """When the station stops trusting what it sees or does."""

    #: Time between the receptions of two usable poses [s]: at 120 Hz four frames may be
    #: lost in a row. With a latency of 6 ms, neutral is sent 50 ms after the last pose.
    stale: float = 0.042
    speed: float = 20.0  #: Between two poses [m/s].
    turn_rate: float = 40.0  #: Between two poses [rad/s].
    x: list[float] = dataclasses.field(default_factory=lambda: [-8.0, 4.0])  #: [m]
    z: list[float] = dataclasses.field(default_factory=lambda: [-2.5, 3.0])  #: [m]
    distance: float = 0.1  #: From the filter's prediction to the pose [m].
    angle: float = 0.4  #: The same of the pitch [rad].
    deadline: float = 0.01  #: Delay of a command [s]; two delayed in a row stop it.


@dataclasses.dataclass(frozen=True, kw_only=True)
class Fault:
    """A fault of the simulated cameras, planned for each throw."""

    kind: Literal["lost", "nan", "swapped", "frozen"] = "lost"
    at: float = 0.3  #: Since release [s].
    duration: float = 0.1  #: [s]


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
    servo_latency: float = 0.004  #: From a command on the bus to the servo [s].
    faults: list[Fault] = dataclasses.field(default_factory=list)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Scenario:
    """A session: glider, plan, controller, filter, sensors, servo and bus."""

    model: str | None = None  #: Model that is planned with; None: the nominal glider.
    problem: str = "perching"  #: Problem file, or one of models/problems.
    controller: Literal["tvlqr", "mpc", "mppi"] = "tvlqr"
    #: Rate of the commands [Hz]; None: one for each pose. At 50 Hz the poses' clock and
    #: the commands' beat, so that a log shows when each command was given.
    command_rate: float | None = 50.0
    bus: str = "udpm://239.255.76.67:7667?ttl=0"  #: Address of LCM.
    sensors: Sensors = Sensors()
    servo: Servo = Servo()
    release: Release = Release()
    limits: Limits = Limits()
    simulation: Simulation | None = None

    def __post_init__(self):
        """Raises InputError where a number cannot be."""
        for part in (self.sensors, self.servo, self.release, self.limits):
            for name, value in vars(part).items():
                numbers = value if isinstance(value, list) else [value]
                signed = isinstance(value, list) or name == "neutral"
                good = all(map(math.isfinite, numbers))
                good = good and (signed or min(numbers) >= 0.0)
                expect(good, f"field '{name}'", value, "finite and not negative")
        for name in ("x", "z"):
            low_high = getattr(self.limits, name)
            good = len(low_high) == 2 and low_high[0] < low_high[1]
            expect(good, f"field 'limits.{name}'", low_high, "[lower, upper]")
        expect(self.sensors.rate > 0, "field 'rate'", self.sensors.rate, "positive")
        rate, expected = self.command_rate, "a number of Hz from 10 to 200"
        expect(
            rate is None or 10 <= rate <= 200, "field 'command_rate'", rate, expected
        )

    @property
    def truth(self) -> GliderModel | None:
        """The simulated glider; None where a real one flies."""
        if self.simulation is None:
            return None
        name = self.simulation.truth
        path = Path(name)
        return GliderModel.load(path if path.suffix else _truth_file(name))

    def load_model(self) -> GliderModel:
        """The glider that is planned with: for a simulated one, without its effects."""
        if self.model is not None:
            return GliderModel.load(self.model)
        truth = self.truth
        return GliderModel(parameters=truth.parameters) if truth else GliderModel()

    def load_problem(self) -> PerchingProblem:
        """The perch to fly."""
        return PerchingProblem.load(self.problem)


def _truth_file(name: str) -> Path:
    known = sorted(path.stem for path in models_path("truths").glob("*.yaml"))
    expected = f"a model file or one of {', '.join(known)}"
    expect(name in known, "the simulated glider", name, expected)
    return models_path("truths", f"{name}.yaml")


def load_scenario(path: Path | str) -> Scenario:
    """Loads a scenario, which gives only what differs from the defaults."""
    return schema.load_yaml(Scenario, path, "a scenario")
