"""Reads and checks campaign folders of flight logs.

Whatever cannot be right is refused with one sentence (InputError) that names the
file, the column or field, the row (a line of the file; the header is line 1),
what was found and what is needed. Irregular times and missing rows are fine.
What campaign.yaml leaves out stays unknown.
"""

import dataclasses
import difflib
import math
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import yaml

from glider.campaign.csv_table import (
    Table,
    read_table,
    read_text,
    show,
)
from glider.campaign.flight_reader import (
    check_step,
    make_flight,
)
from glider.campaign.logs import (
    MAX_ANGLE,
    Campaign,
)
from glider.errors import InputError
from glider.physics.parameters import (
    PARAMETER_NAMES,
    check_parameters,
)

_LIMIT_FIELDS = ("elevator_limits", "elevator_rate_limit")
_VEHICLE_FIELDS = (*PARAMETER_NAMES, *_LIMIT_FIELDS, "elevator")
_TOP_FIELDS = ("vehicle", "pose_rate", "command_rate")


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
    tables = [read_table(path / name) for name in _choose(path, flights, grades)]
    for table in tables[1:]:
        _check_same_columns(tables[0], table)
    loaded = tuple(make_flight(table, campaign) for table in tables)
    rate = campaign.pose_rate
    if math.isnan(rate):
        steps = np.concatenate([np.diff(flight.time) for flight in loaded])
        rate = float(1 / np.median(steps))
    for flight in loaded:
        check_step(path / flight.name, flight.time, rate)
    return dataclasses.replace(campaign, pose_rate=rate, flights=loaded)


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
    text = read_text(file)
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
            f"{file}: field 'elevator' of vehicle is {show(elevator)}; 'fixed' or "
            "'fixed_per_flight' is needed, or no such field where there is a servo."
        )
    numbers = {name: vehicle[name] for name in vehicle if name != "elevator"}
    check_parameters(numbers, source=str(file))
    limits = vehicle.get("elevator_limits")
    if limits and max(map(abs, limits)) > MAX_ANGLE:
        raise InputError(
            f"{file}: field 'elevator_limits' is {limits}; "
            "radians are needed (this looks like degrees)."
        )
    for name in ("pose_rate", "command_rate"):
        rate = settings.get(name, 1.0)
        number = isinstance(rate, (int, float)) and not isinstance(rate, bool)
        if not (number and 0 < rate < math.inf):
            raise InputError(
                f"{file}: field '{name}' is {show(rate)}; "
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
            f"{source}: found {show(fields)}; "
            f"a mapping of fields is needed, out of {', '.join(known)}."
        )
    for name in fields:
        if name not in known:
            near = difflib.get_close_matches(str(name), known, n=1, cutoff=0.7)
            hint = f"; did you mean '{near[0]}'?" if near else "."
            raise InputError(
                f"{source}: unknown field {show(name)}, one of "
                f"{', '.join(known)} is needed{hint}"
            )


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
                f"{folder}: flight {show(min(unknown))} is not in this folder; "
                f"the name of one of its {len(found)} flights is needed."
            )
    if grades is not None:
        index = read_table(folder / "index.csv")
        of_grade = dict.fromkeys(index.texts("grade"), frozenset[str]())
        for file, grade in zip(index.texts("file"), index.texts("grade"), strict=True):
            of_grade[grade] |= _with_suffix([file]) & found
        for grade in grades:
            if not of_grade.get(grade):
                raise InputError(
                    f"{index.path}: column 'grade': no flight has {show(grade)}; "
                    f"one of {sorted(of_grade)} is needed."
                )
        chosen = chosen & frozenset[str]().union(*(of_grade[g] for g in grades))
    if not chosen:
        raise InputError(f"{folder}: no flight is chosen; at least one is needed.")
    return sorted(chosen)


def _with_suffix(names: Sequence[str]) -> set[str]:
    return {name.removesuffix(".csv") + ".csv" for name in names}


def _check_same_columns(first: Table, other: Table) -> None:
    for name in sorted(first.columns.keys() ^ other.columns.keys()):
        has, lacks = (first, other) if name in first.columns else (other, first)
        raise InputError(
            f"{lacks.path}: column '{name}' is missing, which {has.path.name} has; "
            "all flights of a campaign need the same columns."
        )
