"""Campaigns of arrays and data frames, with the checks that files have.

A table is a mapping, a frame of pandas or polars, a pyarrow table, a structured array:
anything with named columns.
"""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from glider.campaign.importing.readers.tables import to_columns
from glider.campaign.importing.recording import Column, Group, Recording
from glider.campaign.importing.splitting import split_flights
from glider.campaign.logs import Campaign
from glider.campaign.reader import make_campaign
from glider.campaign.settings import QUANTITIES, Settings
from glider.errors import InputError, expect
from glider.files import schema


def from_tables(
    tables: Any, vehicle: Any, name: str, fields: dict[str, Any]
) -> Campaign:
    """Makes a campaign; see `Campaign.from_arrays`."""
    several = np.iterable(tables) and not isinstance(tables, str)
    expected = "a list of tables of one flight each, or a dict of them by name"
    expect(several, "flights", tables, expected)
    named = tables if isinstance(tables, Mapping) else dict(enumerate(tables))
    recordings = [_recording(_file_name(key), table) for key, table in named.items()]
    return _campaign(recordings, vehicle, name, fields)


def from_frame(
    frame: Any, vehicle: Any, flight: str | None, name: str, fields: dict[str, Any]
) -> Campaign:
    """Makes a campaign; see `Campaign.from_frame`."""
    columns = (fields.get("columns") or {}) | ({"flight": flight} if flight else {})
    recordings = []
    for k, part in enumerate(split_flights(_recording(name, frame), columns)):
        what, _, label = part.path.name.partition(" ")
        path = Path(_file_name(label if what == "flight" else k))
        recordings.append(Recording(path, part.groups))
    return _campaign(recordings, vehicle, name, fields)


def _campaign(
    recordings: list[Recording], vehicle: Any, name: str, fields: dict[str, Any]
) -> Campaign:
    """A campaign of recordings of one flight each."""
    if not recordings:
        raise InputError(f"{name}: holds no flight; expected at least one.")
    data = _known(vehicle) | fields
    if not data.get("columns") and data.keys() & {"units", "frame", "clock"}:
        own = recordings[0].names()
        data["columns"] = {name: name for name in QUANTITIES if name in own}
    settings = schema.convert(schema.to_builtins(data), Settings, name)
    logs = sorted(recordings, key=lambda recording: recording.path)
    return make_campaign(settings.campaign(Path(name)), settings.mapping(name), logs)


def _known(vehicle: Any) -> dict[str, Any]:
    """Fields of campaign.yaml that a vehicle gives."""
    if isinstance(vehicle, (str, Path)):
        text = schema.read_text(vehicle, "a campaign.yaml, MAP or model.yaml")
        data = schema.parse_yaml(text, str(vehicle))
        if not isinstance(data, dict) or "parameters" not in data:
            return data if isinstance(data, dict) else {"vehicle": data}
        vehicle = data["parameters"]
    vehicle = getattr(vehicle, "parameters", vehicle)  # Of a GliderModel.
    is_known = dataclasses.is_dataclass(vehicle) and not isinstance(vehicle, type)
    return {"vehicle": dataclasses.asdict(vehicle) if is_known else vehicle or {}}


def _file_name(key: object) -> str:
    """Name of a flight as of a file: flight_007.csv of 7."""
    text = str(key).removeprefix("flight_").removesuffix(".csv")
    return f"flight_{text.zfill(3) if text.isdigit() else text}.csv"


def _recording(name: str, table: Any) -> Recording:
    """A table's columns; matrices become name[0], name[1]."""
    names = _names_of(table)
    expected = "a table of a flight with named columns, as a dict or a data frame"
    expect(names is not None, name, table, expected)
    columns: dict[str, Column] = {}
    for own in names:
        columns |= to_columns(str(own), table[own])
    first = next(iter(columns), "")
    for own, column in columns.items():
        rows = len(columns[first].values)
        if len(column.values) != rows:
            raise InputError(
                f"{name}: column '{own}' has {len(column.values)} values; expected "
                f"{rows}, as in '{first}'."
            )
    return Recording(Path(name), (Group("", columns),))


def _names_of(table: Any) -> Any:
    """Names of a table's columns; None of what is no table."""
    if isinstance(table, Mapping):
        return table.keys()
    names = getattr(getattr(table, "dtype", None), "names", None)
    names = names or getattr(table, "column_names", None)
    return getattr(table, "columns", None) if names is None else names
