"""Flights and campaigns of them in memory, and their split by whole flights.

A campaign is a folder with `campaign.yaml` and `flight_*.csv`, in SI units and the
frame of `glider.physics.state`; `reader` reads it, `writer` writes it.
"""

import dataclasses
import functools
import importlib
import math
from collections.abc import Collection, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any, Literal, NamedTuple, NoReturn

import numpy as np

from glider.errors import InputError, expect, show
from glider.physics.parameters import PARAMETER_NAMES, GliderParameters
from glider.physics.servo import NO_LIMITS, Servo

POSE_COLUMNS: tuple[str, ...] = ("time", "x", "z", "pitch")
SERVO_COLUMNS: tuple[str, ...] = ("elevator", "elevator_rate_command")
ATTITUDE_COLUMNS: tuple[str, ...] = ("y", "roll", "yaw")
COMMAND_TIME = "command_time"  # A column that each flight may have or not.
_NOT_IN_NAMES = frozenset("<>&\"'`")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Flight:
    """One flight as it was logged, n rows.

    Attributes:
        name: of the file, e.g. "flight_003.csv".
        time: (n,) as logged, strictly increasing [s].
        pose: (n, 3) x [m], z [m], pitch [rad].
        elevator: (n,) angle [rad]; None without a servo.
        command: (n,) elevator_rate_command, held until the next [rad/s]; None without a
            servo.
        attitude: (n, 3) y [m], roll, yaw [rad]; None where they were not logged.
        command_time: (n,) when the command of each row began [s]; None: not logged.
        departure: of the elevator from what a servo does; it is not logged.
    """

    name: str
    time: np.ndarray
    pose: np.ndarray
    elevator: np.ndarray | None
    command: np.ndarray | None
    attitude: np.ndarray | None = None
    command_time: np.ndarray | None = None
    departure: "Departure | None" = None

    def __post_init__(self):
        """Raises InputError for a name that a page or a terminal could interpret."""
        if not self.name.isprintable() or set(self.name) & _NOT_IN_NAMES:
            raise InputError(
                f"{show(self.name)} is not the name of a flight; expected printable "
                "characters without quotes and < > &."
            )

    def __repr__(self) -> str:
        """Returns one line, as a notebook shows it."""
        return f"Flight('{self.name}', {self.time.size} rows)"


class Departure(NamedTuple):
    """What an elevator does beside what a servo makes of its commands."""

    angle: np.ndarray  #: (n,) at the rows of a flight [rad].
    rest: float  #: Where the elevator stood before the first command [rad].
    std: float  #: Standard error of `rest` [rad].
    is_named: bool = False  #: Whether a form of the servo is known that explains it.


CLOCK_STD = 1e-3
"""Standard error of an offset between two clocks of which nothing is known [s]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ServoLog:
    """Where the columns of a servo come from, and how well their times are known.

    Attributes:
        angle: "measured", or "reconstructed": that of an ideal servo.
        command: "logged" as rates; "converted": rates of an ideal servo that follows
            commanded angles; "reconstructed": the rates of the measured angle.
        clock_std: standard error of their times against those of the poses [s].
        command_std: standard error of the commands' times against those of the measured
            angle [s].
    """

    angle: Literal["measured", "reconstructed"] = "measured"
    command: Literal["logged", "converted", "reconstructed"] = "logged"
    clock_std: float = CLOCK_STD
    command_std: float = CLOCK_STD

    def __post_init__(self):
        """Raises InputError where a value cannot be."""
        errors = [self.clock_std, self.command_std]
        expect(
            all(0.0 <= error < math.inf for error in errors),
            "servo: [clock_std, command_std]",
            errors,
            "standard errors in s",
        )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Campaign:
    """The flights of one glider and what is known of it.

    Attributes:
        name: of the folder.
        path: of the folder; of flights in memory, their name.
        vehicle: those of PARAMETER_NAMES that are known, in SI units.
        elevator: "servo", "fixed" (one unknown angle) or "fixed_per_flight".
        elevator_limits: trailing edge down and up [rad]; None: unknown.
        elevator_rate_limit: [rad/s]; None: unknown.
        pose_rate: of the cameras [Hz]; None: not specified.
        command_rate: at which commands change [Hz]; None: they change at rows.
        flights: sorted by name.
        notes: what an import found in the logs and did about it.
        servo: where the columns of the servo come from.
    """

    name: str
    path: Path
    vehicle: dict[str, float]
    elevator: str
    elevator_limits: tuple[float, float] | None
    elevator_rate_limit: float | None
    pose_rate: float | None
    command_rate: float | None
    flights: tuple[Flight, ...]
    notes: tuple[str, ...] = ()
    servo: ServoLog = ServoLog()

    def __repr__(self) -> str:
        """Returns one line, as a notebook shows it."""
        return f"Campaign('{self.name}', {len(self.flights)} flights)"

    def refuse(self, words: str) -> NoReturn:
        """Raises InputError that says which campaign cannot be used, and why."""
        raise InputError(f"{self.path}: {words}")

    def only(self, names: Collection[str]) -> "Campaign":
        """Returns the campaign with some of its flights, named as their files.

        Raises:
            InputError: there is no flight of such a name.
        """
        chosen = {name.removesuffix(".csv") for name in names}
        by_name = {flight.name.removesuffix(".csv"): flight for flight in self.flights}
        for name in sorted(chosen - by_name.keys()):
            self.refuse(
                f"there is no flight '{name}'; expected the name of one of its "
                f"{len(by_name)} flights."
            )
        flights = tuple(by_name[name] for name in by_name if name in chosen)
        return dataclasses.replace(self, flights=flights)

    @classmethod
    def from_arrays(
        cls,
        flights: Any,
        vehicle: Any = None,
        *,
        name: str = "flights",
        **settings: Any,
    ) -> "Campaign":
        """Makes a campaign of flights in memory, with the checks that files have.

        Args:
            flights: a list, or a dict by name, of tables of one flight each: dicts of
                arrays, data frames, structured arrays, columns as in `flight_*.csv`.
            vehicle: a dict as in campaign.yaml, a `GliderModel` or its parameters, or
                the path of a campaign.yaml, MAP or model.yaml.
            name: of the campaign.
            settings: other fields of these files: `command_rate`, `columns`, ...

        Raises:
            InputError: a flight cannot be used; it is named, and the column.
        """
        return _in_memory().from_tables(flights, vehicle, name, settings)

    @classmethod
    def from_frame(
        cls,
        frame: Any,
        vehicle: Any = None,
        *,
        flight: str | None = None,
        name: str = "flights",
        **settings: Any,
    ) -> "Campaign":
        """Makes a campaign of one table of several flights, as of pandas or polars.

        Args:
            frame: the table, with the columns of `flight_*.csv`.
            vehicle: see `from_arrays`, and for `name` and `settings` too.
            flight: the column that separates the flights; None: `flight` where it is
                there, otherwise a time that starts again.
        """
        return _in_memory().from_frame(frame, vehicle, flight, name, settings)

    @functools.cached_property
    def row_rate(self) -> float:
        """Rate of rows [Hz]: the cameras', or that of the usual step of the flights."""
        if self.pose_rate is not None:
            return self.pose_rate
        steps = np.concatenate([np.diff(flight.time) for flight in self.flights])
        return 1.0 / float(np.median(steps))

    @property
    def switch_rate(self) -> float | None:
        """Rate at which commands switch, as `command_steps` takes it [Hz]."""
        return self.command_rate if self.servo.command == "logged" else math.inf

    @property
    def limits(self) -> Servo:
        """Limits of the servo; infinite where they are not known.

        The rates of a measured angle are what a servo has made of its commands.
        """
        if self.servo.command == "reconstructed":
            return NO_LIMITS
        low, high = self.elevator_limits or (-math.inf, math.inf)
        return Servo(low, high, self.elevator_rate_limit or math.inf)

    @property
    def has_moving_elevator(self) -> bool:
        """Whether a servo turns the elevator in any flight."""
        return any(f.elevator is not None and np.ptp(f.elevator) for f in self.flights)

    @property
    def gravity(self) -> float:
        """Acceleration of gravity, the usual one if it is not given [m/s²]."""
        return self.vehicle.get("gravity", GliderParameters().gravity)


def _in_memory() -> ModuleType:
    """The module that makes campaigns; it imports this one."""
    return importlib.import_module("glider.campaign.in_memory")


def campaign_of(
    name: str,
    parameters: GliderParameters,
    flights: Sequence[Flight],
    pose_rate: float,
    command_rate: float,
) -> Campaign:
    """A campaign of a glider with a servo, all its parameters known; rates in Hz."""
    limits = parameters.elevator_limits
    return Campaign(
        name=name,
        path=Path(name),
        vehicle={field: getattr(parameters, field) for field in PARAMETER_NAMES},
        elevator="servo",
        elevator_limits=None if limits is None else (limits[0], limits[1]),
        elevator_rate_limit=parameters.elevator_rate_limit,
        pose_rate=pose_rate,
        command_rate=command_rate,
        flights=tuple(flights),
    )


def split_flights(
    campaign: Campaign, held_out_fraction: float, seed: int
) -> tuple[tuple[Flight, ...], tuple[Flight, ...]]:
    """Flights to fit and flights held out, each sorted by name.

    Args:
        campaign: of at least 3 flights.
        held_out_fraction: in (0, 1); rounded to at least 1 flight held out and
            at least 2 to fit.
        seed: of the random choice: the same gives the same split.
    """
    count = len(campaign.flights)
    if count < 3:
        campaign.refuse(
            f"found {count} flight{'s' * (count != 1)}; expected at "
            "least 3, to fit and to hold out."
        )
    expect(
        0 < held_out_fraction < 1,
        "The held-out fraction",
        held_out_fraction,
        "more than 0 and less than 1",
    )
    num_held_out = min(max(round(held_out_fraction * count), 1), count - 2)
    order = np.random.default_rng(seed).permutation(count)
    flights = sorted(campaign.flights, key=lambda flight: flight.name)
    held_out = tuple(flights[i] for i in sorted(order[:num_held_out]))
    return tuple(flights[i] for i in sorted(order[num_held_out:])), held_out
