"""Reads, checks, splits and writes campaign folders of flight logs.

A campaign is `campaign.yaml` and `flight_*.csv`, in SI units and the frame of
glider/state.py. Whatever cannot be right is refused with one sentence
(InputError) that names the file, the column or field, the row (a line of the
file; the header is line 1), what was found and what is needed. Irregular times
and missing rows are fine. What campaign.yaml leaves out stays unknown.
"""

import csv
import dataclasses
import difflib
import math
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import yaml

from glider.errors import InputError
from glider.parameters import PARAMETER_NAMES, check_parameters

POSE_COLUMNS: tuple[str, ...] = ("time", "x", "z", "pitch")
SERVO_COLUMNS: tuple[str, ...] = ("elevator", "elevator_rate_command")

_LIMIT_FIELDS = ("elevator_limits", "elevator_rate_limit")
_VEHICLE_FIELDS = (*PARAMETER_NAMES, *_LIMIT_FIELDS, "elevator")
_TOP_FIELDS = ("vehicle", "pose_rate", "command_rate")

_MIN_ROWS = 20
_MIN_SPAN = 0.15  # [s]
_MAX_STEP = 1.0  # Of a pose log [s].
_MAX_SPEED = 60.0  # Median over a flight [m/s].
_MAX_POSITION = 1000.0  # [m]
_MAX_ANGLE = 2 * math.pi  # [rad]
_MAX_ELEVATOR_RATE = 100.0  # Where the limit is not known [rad/s].


@dataclasses.dataclass(frozen=True, kw_only=True)
class Flight:
    """One flight as it was logged, n rows."""

    name: str  # Of the file, e.g. "flight_003.csv".
    time: np.ndarray  # (n,) as logged, strictly increasing [s].
    pose: np.ndarray  # (n, 3) x [m], z [m], pitch [rad].
    elevator: np.ndarray | None  # (n,) [rad]; None without a servo.
    command: np.ndarray | None  # (n,) elevator_rate_command, held [rad/s].


@dataclasses.dataclass(frozen=True, kw_only=True)
class Campaign:
    """The flights of one glider and what is known of it."""

    name: str  # Of the folder.
    path: Path
    vehicle: dict[str, float]  # Those of PARAMETER_NAMES that are known.
    elevator: str  # "servo", "fixed" (one unknown angle) or "fixed_per_flight".
    elevator_limits: tuple[float, float] | None  # Trailing edge down, up [rad].
    elevator_rate_limit: float | None  # [rad/s]
    pose_rate: float  # [Hz]; 1 / the median step of all flights if not given.
    command_rate: float | None  # [Hz]; None: commands change at rows.
    flights: tuple[Flight, ...]  # Sorted by name.


def load_campaign(
    path: Path | str,
    *,
    flights: Sequence[str] | None = None,
    grades: Sequence[str] | None = None,
) -> Campaign:
    """Loads a campaign folder; only the chosen flights are read and checked.

    Pitch is unwrapped where it jumps by more than π between two rows.

    Args:
        path: the folder.
        flights: file names, with or without ".csv"; None for all.
        grades: those of the folder's index.csv (columns file, grade) to keep;
            None for all.

    Raises:
        InputError: the campaign cannot be used.
    """
    path = Path(path)
    if not path.is_dir():
        found = "is not a folder" if path.exists() else "does not exist"
        raise InputError(f"{path}: {found}; a campaign folder is needed.")
    campaign = _read_settings(path)
    tables = [_read_table(path / name) for name in _choose(path, flights, grades)]
    for table in tables[1:]:
        _check_same_columns(tables[0], table)
    loaded = tuple(_make_flight(table, campaign) for table in tables)
    rate = campaign.pose_rate
    if math.isnan(rate):
        steps = np.concatenate([np.diff(flight.time) for flight in loaded])
        rate = float(1 / np.median(steps))
    for flight in loaded:
        _check_step(path / flight.name, flight.time, rate)
    return dataclasses.replace(campaign, pose_rate=rate, flights=loaded)


def split_flights(
    campaign: Campaign, held_out_fraction: float, seed: int
) -> tuple[tuple[Flight, ...], tuple[Flight, ...]]:
    """Splits by whole flights; the same seed gives the same split.

    Args:
        campaign: of at least 3 flights.
        held_out_fraction: in (0, 1); rounded to at least 1 flight held out and
            at least 2 to fit.
        seed: of the random choice.

    Returns:
        The flights to fit and the flights held out, each sorted by name.
    """
    count = len(campaign.flights)
    if count < 3:
        raise InputError(
            f"{campaign.path}: a split into fitted and held-out flights "
            f"needs at least 3 flights, found {count}."
        )
    if not 0 < held_out_fraction < 1:
        raise InputError(
            f"The held-out fraction is {held_out_fraction}; "
            "a number between 0 and 1 is needed."
        )
    num_held_out = min(max(round(held_out_fraction * count), 1), count - 2)
    order = np.random.default_rng(seed).permutation(count)
    held_out, fit = order[:num_held_out], order[num_held_out:]
    flights = sorted(campaign.flights, key=lambda flight: flight.name)
    return (
        tuple(flights[i] for i in sorted(fit)),
        tuple(flights[i] for i in sorted(held_out)),
    )


def save_campaign(path: Path | str, campaign: Campaign) -> None:
    """Writes a folder that load_campaign reads; campaign.path is not used."""
    path = Path(path)
    path.mkdir(parents=True, exist_ok=True)
    names = {flight.name for flight in campaign.flights}
    if others := {file.name for file in path.glob("flight_*.csv")} - names:
        raise InputError(
            f"{path}: holds {min(others)}, which is not of this campaign; "
            "an empty folder is needed."
        )
    vehicle: dict = {name: float(value) for name, value in campaign.vehicle.items()}
    if campaign.elevator_limits is not None:
        vehicle["elevator_limits"] = [float(v) for v in campaign.elevator_limits]
    if campaign.elevator_rate_limit is not None:
        vehicle["elevator_rate_limit"] = float(campaign.elevator_rate_limit)
    if campaign.elevator != "servo":
        vehicle["elevator"] = campaign.elevator
    settings = {"vehicle": vehicle, "pose_rate": float(campaign.pose_rate)}
    if campaign.command_rate is not None:
        settings["command_rate"] = float(campaign.command_rate)
    text = yaml.safe_dump(settings, sort_keys=False)
    (path / "campaign.yaml").write_text(text, encoding="utf-8")
    for flight in campaign.flights:
        save_flight(path / flight.name, flight)


def save_flight(path: Path | str, flight: Flight) -> None:
    """Writes one flight_*.csv, nine digits (time: fifteen, for epoch times).

    A pitch that has tumbled beyond a full turn is wrapped into ±π, as motion
    capture logs it.
    """
    x, z, pitch = flight.pose.T
    if np.any(np.abs(pitch) > _MAX_ANGLE):
        pitch = np.angle(np.exp(1j * pitch))
    names, columns = POSE_COLUMNS, [flight.time, x, z, pitch]
    if flight.elevator is not None and flight.command is not None:
        names += SERVO_COLUMNS
        columns += [flight.elevator, flight.command]
    np.savetxt(
        path,
        np.column_stack(columns),
        fmt=["%.15g"] + ["%.9g"] * (len(names) - 1),
        delimiter=",",
        header=",".join(names),
        comments="",
    )


# campaign.yaml


class _Loader(yaml.SafeLoader):
    """Takes 1e-3 for a number, as YAML 1.2 does; PyYAML alone reads text."""


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$"),
    list("-+.0123456789"),
)


def _read_settings(folder: Path) -> Campaign:
    """Returns the campaign without flights, pose_rate nan where not given."""
    file = folder / "campaign.yaml"
    if not file.is_file():
        raise InputError(
            f"{folder}: no campaign.yaml in it; "
            "a campaign folder holds campaign.yaml and flight_*.csv."
        )
    text = _read_text(file)
    try:
        settings = yaml.load(text, Loader=_Loader)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        reason = " ".join(str(error).split())
        raise InputError(f"{file}: not readable as YAML: {reason}.") from None
    _check_fields(settings, _TOP_FIELDS, str(file))
    vehicle = settings.get("vehicle", {})
    _check_fields(vehicle, _VEHICLE_FIELDS, f"{file}: vehicle")
    elevator = vehicle.get("elevator", "servo")
    if "elevator" in vehicle and elevator not in ("fixed", "fixed_per_flight"):
        raise InputError(
            f"{file}: field 'elevator' of vehicle is {_show(elevator)}; 'fixed' or "
            "'fixed_per_flight' is needed, or no such field where there is a servo."
        )
    numbers = {name: vehicle[name] for name in vehicle if name != "elevator"}
    check_parameters(numbers, source=str(file))
    limits = vehicle.get("elevator_limits")
    if limits and max(map(abs, limits)) > _MAX_ANGLE:
        raise InputError(
            f"{file}: field 'elevator_limits' is {limits}; "
            "radians are needed (this looks like degrees)."
        )
    for name in ("pose_rate", "command_rate"):
        rate = settings.get(name, 1.0)
        number = isinstance(rate, (int, float)) and not isinstance(rate, bool)
        if not (number and 0 < rate < math.inf):
            raise InputError(
                f"{file}: field '{name}' is {_show(rate)}; "
                "a positive number of Hz is needed."
            )
    return Campaign(
        name=folder.resolve().name,
        path=folder,
        vehicle={n: float(v) for n, v in numbers.items() if n not in _LIMIT_FIELDS},
        elevator=elevator,
        elevator_limits=(float(limits[0]), float(limits[1])) if limits else None,
        elevator_rate_limit=numbers.get("elevator_rate_limit"),
        pose_rate=settings.get("pose_rate", math.nan),
        command_rate=settings.get("command_rate"),
        flights=(),
    )


def _check_fields(fields: object, known: Sequence[str], source: str) -> None:
    if not isinstance(fields, dict):
        raise InputError(
            f"{source}: found {_show(fields)}; "
            f"a mapping of fields is needed, out of {', '.join(known)}."
        )
    for name in fields:
        if name not in known:
            near = difflib.get_close_matches(str(name), known, n=1, cutoff=0.7)
            hint = f"; did you mean '{near[0]}'?" if near else "."
            raise InputError(
                f"{source}: unknown field {_show(name)}, one of "
                f"{', '.join(known)} is needed{hint}"
            )


# flight_*.csv and index.csv


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Table:
    """The cells of a CSV file as text."""

    path: Path
    columns: dict[str, list[str]]
    lines: list[int]  # Of each row in the file; the header is line 1.

    def texts(self, name: str) -> list[str]:
        if name not in self.columns:
            raise InputError(
                f"{self.path}: column '{name}' is missing; "
                f"found {_show(', '.join(self.columns))}."
            )
        return self.columns[name]

    def numbers(self, name: str) -> np.ndarray:
        values = np.array([_to_float(text) for text in self.texts(name)])
        self.refuse(~np.isfinite(values), name, "a finite number is needed.")
        return values

    def refuse(self, bad: np.ndarray, name: str, need: str) -> None:
        """Raises InputError about the first bad cell of a column, if any."""
        for i in np.flatnonzero(bad)[:1]:
            raise InputError(
                f"{self.path}: column '{name}', row {self.lines[i]}: "
                f"found {_show(self.columns[name][i])}; {need}"
            )


def _read_text(file: Path) -> str:
    try:
        return file.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"{file}: not a text file; UTF-8 is needed.") from None
    except OSError as error:
        raise InputError(f"{file}: cannot be read: {error.strerror}.") from None


def _read_table(file: Path) -> _Table:
    lines = _read_text(file).split("\n")
    cells: list[list[str]] = []
    for line in lines:  # One by one, lest a lone quote swallow the rest.
        try:
            row = next(csv.reader([line], strict=True, skipinitialspace=True), [])
        except csv.Error as error:
            raise InputError(f"{file}: row {len(cells) + 1}: {error}.") from None
        cells.append([cell.strip() for cell in row])
    names = cells[0]
    if all(math.isfinite(_to_float(name)) for name in names):
        raise InputError(
            f"{file}: row 1 is {_show(lines[0])}; "
            "a header with the names of the columns is needed."
        )
    for name in names:
        if name and names.count(name) > 1:
            raise InputError(
                f"{file}: column '{name}' appears {names.count(name)} times; "
                "each name may appear once."
            )
    rows = [i for i in range(1, len(lines)) if lines[i].strip()]
    for i in rows:
        if len(cells[i]) != len(names):
            raise InputError(
                f"{file}: row {i + 1} has {len(cells[i])} cells; "
                f"{len(names)} are needed, as in the header."
            )
    columns = {name: [cells[i][j] for i in rows] for j, name in enumerate(names)}
    return _Table(path=file, columns=columns, lines=[i + 1 for i in rows])


def _choose(
    folder: Path, flights: Sequence[str] | None, grades: Sequence[str] | None
) -> list[str]:
    """Returns the names of the chosen files, sorted."""
    chosen = found = {file.name for file in folder.glob("flight_*.csv")}
    if not found:
        raise InputError(f"{folder}: no flight_*.csv in it; at least one is needed.")
    if flights is not None:
        chosen = _with_suffix(flights)
        if unknown := chosen - found:
            raise InputError(
                f"{folder}: flight {_show(min(unknown))} is not in this folder; "
                f"the name of one of its {len(found)} flights is needed."
            )
    if grades is not None:
        index = _read_table(folder / "index.csv")
        of_grade = dict.fromkeys(index.texts("grade"), frozenset[str]())
        for file, grade in zip(index.texts("file"), index.texts("grade"), strict=True):
            of_grade[grade] |= _with_suffix([file]) & found
        for grade in grades:
            if not of_grade.get(grade):
                raise InputError(
                    f"{index.path}: column 'grade': no flight has {_show(grade)}; "
                    f"one of {sorted(of_grade)} is needed."
                )
        chosen = chosen & frozenset[str]().union(*(of_grade[g] for g in grades))
    if not chosen:
        raise InputError(f"{folder}: no flight is chosen; at least one is needed.")
    return sorted(chosen)


def _with_suffix(names: Sequence[str]) -> set[str]:
    return {name.removesuffix(".csv") + ".csv" for name in names}


def _check_same_columns(first: _Table, other: _Table) -> None:
    for name in sorted(first.columns.keys() ^ other.columns.keys()):
        has, lacks = (first, other) if name in first.columns else (other, first)
        raise InputError(
            f"{lacks.path}: column '{name}' is missing, which {has.path.name} has; "
            "all flights of a campaign need the same columns."
        )


def _make_flight(table: _Table, campaign: Campaign) -> Flight:
    wanted = POSE_COLUMNS
    if campaign.elevator == "servo":
        wanted += SERVO_COLUMNS
    columns = {name: table.numbers(name) for name in wanted}
    time = columns["time"]
    late = np.diff(time, prepend=-math.inf) <= 0
    table.refuse(late, "time", "it must be greater than in the row before.")
    span = time[-1] - time[0] if len(time) else 0.0
    if len(time) < _MIN_ROWS or span < _MIN_SPAN:
        raise InputError(
            f"{table.path}: too short, {len(time)} rows over {span:.3g} s of 'time'; "
            f"at least {_MIN_ROWS} rows and {_MIN_SPAN} s are needed."
        )
    _check_units(table, columns, campaign)
    pitch = np.unwrap(columns["pitch"])
    return Flight(
        name=table.path.name,
        time=time,
        pose=np.column_stack([columns["x"], columns["z"], pitch]),
        elevator=columns.get("elevator"),
        command=columns.get("elevator_rate_command"),
    )


def _check_units(
    table: _Table, columns: dict[str, np.ndarray], campaign: Campaign
) -> None:
    """Refuses what cannot be SI; a fault that an effect can model must pass."""
    elevator_bound, rate_bound = _MAX_ANGLE, _MAX_ELEVATOR_RATE
    if campaign.elevator_limits is not None:  # Room for an elevator of turned sign.
        lower, upper = campaign.elevator_limits
        far = max(abs(lower), abs(upper)) + (upper - lower)
        elevator_bound = min(far, _MAX_ANGLE)
    if campaign.elevator_rate_limit is not None:
        rate_bound = 10 * campaign.elevator_rate_limit
    for name, bound, unit, likely in (
        ("x", _MAX_POSITION, "m", "millimeters"),
        ("z", _MAX_POSITION, "m", "millimeters"),
        ("pitch", _MAX_ANGLE, "rad", "degrees; a tumble must be wrapped into ±pi"),
        ("elevator", elevator_bound, "rad", "degrees"),
        ("elevator_rate_command", rate_bound, "rad/s", "degrees per second"),
    ):
        need = f"within ±{bound:.4g} {unit} is needed (this looks like {likely})."
        if name in columns:
            table.refuse(np.abs(columns[name]) > bound, name, need)
    step_length = np.hypot(np.diff(columns["x"]), np.diff(columns["z"]))
    speed = np.median(step_length / np.diff(columns["time"]))
    if speed > _MAX_SPEED:
        raise InputError(
            f"{table.path}: columns 'x' and 'z' move at {speed:.4g} m/s (median); "
            f"at most {_MAX_SPEED:g} is needed (this looks like millimeters)."
        )


def _check_step(file: Path, time: np.ndarray, rate: float) -> None:
    step = np.median(np.diff(time))
    if step >= _MAX_STEP or not 1 / 3 < step * rate < 3:
        slow = step >= _MAX_STEP or step * rate > 20
        hint = " (this looks like milliseconds or a count of rows)" if slow else ""
        raise InputError(
            f"{file}: column 'time' has a median step of {step:.4g}{hint}; seconds "
            f"are needed, about {1 / rate:.4g} for a pose_rate of {rate:.4g} Hz."
        )


def _to_float(text: str) -> float:
    """Returns nan for what is not a number."""
    try:
        return float(text) if "_" not in text else math.nan
    except ValueError:
        return math.nan


def _show(value: object, width: int = 80) -> str:
    text = repr(value)
    return text if len(text) <= width else text[:width] + "..."
