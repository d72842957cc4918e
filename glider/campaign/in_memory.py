"""Campaigns of arrays and data frames, with the checks that files have.

A table is a mapping, a frame of pandas or polars, a pyarrow table, a structured array:
anything with named columns. Each becomes a recording, as files do, and the fields that
campaign.yaml would have make the campaign of them.
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
    """Makes a campaign of tables of one flight each; see `Campaign.from_arrays`."""
    expect(
        np.iterable(tables) and not isinstance(tables, str),
        "flights",
        tables,
        "a list of tables of one flight each, or a dict of them by name",
    )
    named = tables if isinstance(tables, Mapping) else dict(enumerate(tables))
    recordings = [_recording(_file_name(key), table) for key, table in named.items()]
    return _campaign(recordings, vehicle, name, fields)


def from_frame(
    frame: Any, vehicle: Any, flight: str | None, name: str, fields: dict[str, Any]
) -> Campaign:
    """Makes a campaign of a table of several flights; see `Campaign.from_frame`."""
    columns = fields.get("columns") or {}
    if flight:
        columns = columns | {"flight": flight}
    recordings = []
    for k, part in enumerate(split_flights(_recording(name, frame), columns)):
        # Parts are named "flight LABEL" by a column of flights, otherwise they count.
        what, _, label = part.path.name.partition(" ")
        path = Path(_file_name(label if what == "flight" else k))
        recordings.append(Recording(path, part.groups))
    return _campaign(recordings, vehicle, name, fields)


def _campaign(
    recordings: list[Recording], vehicle: Any, name: str, fields: dict[str, Any]
) -> Campaign:
    """A campaign of recordings of one flight each.

    Args:
        recordings: in any order.
        vehicle: as `Campaign.from_arrays` takes it.
        name: of the campaign, also in messages.
        fields: of campaign.yaml, which count before those of the vehicle's file.
    """
    if not recordings:
        raise InputError(f"{name}: holds no flight; expected at least one.")
    data = _known(vehicle) | fields
    if not data.get("columns") and data.keys() & {"units", "frame", "clock"}:
        # Other units or axes, in columns that have the quantities' own names.
        own = recordings[0].names()
        data["columns"] = {name: name for name in QUANTITIES if name in own}
    settings = schema.convert(schema.to_builtins(data), Settings, name)
    logs = sorted(recordings, key=lambda recording: recording.path)
    return make_campaign(settings.campaign(Path(name)), settings.mapping(name), logs)


def _known(vehicle: Any) -> dict[str, Any]:
    """Fields of campaign.yaml that a vehicle gives: its file, or its parameters."""
    if isinstance(vehicle, (str, Path)):
        text = schema.read_text(vehicle, "a campaign.yaml, MAP or model.yaml")
        data = schema.parse_yaml(text, str(vehicle))
        if not isinstance(data, dict):
            return {"vehicle": data}  # The schema refuses it.
        if "parameters" not in data:
            return data
        vehicle = data["parameters"]
    vehicle = getattr(vehicle, "parameters", vehicle)  # Of a GliderModel.
    if dataclasses.is_dataclass(vehicle) and not isinstance(vehicle, type):
        vehicle = dataclasses.asdict(vehicle)
    return {"vehicle": vehicle or {}}


def _file_name(key: object) -> str:
    """Name of a flight as of a file: flight_007.csv of 7."""
    text = str(key).removeprefix("flight_").removesuffix(".csv")
    if text.isdigit():
        text = text.zfill(3)
    return f"flight_{text}.csv"


def _recording(name: str, table: Any) -> Recording:
    """A recording of a table; matrices become the columns name[0], name[1]."""
    names = _names_of(table)
    expect(
        names is not None,
        name,
        table,
        "a table of a flight with named columns, as a dict or a data frame",
    )
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
    dtype = getattr(table, "dtype", None)  # Of a structured array.
    names = getattr(dtype, "names", None) or getattr(table, "column_names", None)
    if names is None:
        names = getattr(table, "columns", None)
    return names
