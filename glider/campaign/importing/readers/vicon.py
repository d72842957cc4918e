"""CSV exports of Vicon's Nexus and Tracker: sections with a rate, names and units.

A column is named OBJECT.Rotation.X, OBJECT.Position.X (RX and TX in the file), or
MARKER.Position.X. Time is the number of the frame over the rate. What three angles of
a rotation mean depends on the settings of the export: a mapping must tell it.
"""

import csv
import io
from pathlib import Path

import numpy as np

from glider.campaign.importing import units
from glider.campaign.importing.raw import Column, Group, RawTable
from glider.campaign.importing.readers.delimited import make_column
from glider.errors import InputError

_SECTIONS = ("Trajectories", "Objects", "Segments", "Model Outputs", "Joints")
_TIME = "Time"
_PARTS = {"R": "Rotation", "T": "Position"}


def recognizes(text: str) -> bool:
    """Whether a text is such an export."""
    return text.lstrip().split("\n", 1)[0].strip(" \r,;\t") in _SECTIONS


def parse(path: Path, text: str) -> RawTable:
    """Returns the sections of an export as groups.

    Raises:
        InputError: a section has no rate or no names.
    """
    lines = text.splitlines()
    delimiter = max(",;\t", key=lambda d: lines[-1].count(d) + lines[5].count(d))
    rows = [
        [cell.strip() for cell in row]
        for row in csv.reader(io.StringIO("\n".join(lines)), delimiter=delimiter)
    ]
    starts = [i for i, row in enumerate(rows) if row and row[0] in _SECTIONS]
    ends = [*starts[1:], len(rows)]
    groups = tuple(
        _section(path, rows, start, end)
        for start, end in zip(starts, ends, strict=True)
    )
    return RawTable(path=path, groups=groups)


def _section(path: Path, rows: list[list[str]], start: int, end: int) -> Group:
    kind = rows[start][0]
    try:
        rate = float(rows[start + 1][0])
        names, parts, told = rows[start + 2 : start + 5]
    except (ValueError, IndexError):
        raise InputError(
            f"{path}: section '{kind}' in row {start + 1} lacks its rate, names or "
            "units; an export of Vicon with its five header rows is needed."
        ) from None
    data = [
        (i, row) for i, row in enumerate(rows[start + 5 : end], start + 6) if any(row)
    ]
    frames = make_column("Frame", [(i, row[0]) for i, row in data], None).values
    columns = {_TIME: Column(values=(frames - frames[:1].sum()) / rate, unit="s")}
    owner = ""
    for j in range(2, len(parts)):
        owner = (names[j] if j < len(names) else "") or owner
        owner = owner.removeprefix("Global Angle ").strip()
        part = parts[j].upper()
        what = _PARTS.get(part[:1], "Position") if len(part) == 2 else "Position"
        if not part or part[-1] not in "XYZW" or len(part) > 2:
            continue
        name = f"{owner}.{what}.{part[-1]}"
        cells = [(i, row[j] if j < len(row) else "") for i, row in data]
        unit = units.spell(told[j]) if j < len(told) else None
        columns[name] = make_column(name, cells, unit)
    for name in list(columns):  # Tracker writes zeros where it sees nothing.
        if name.endswith(".Position.X"):
            body = name.removesuffix("X")
            place = [columns[body + axis].values for axis in "XYZ"]
            np.putmask(place[0], np.all(np.stack(place) == 0.0, axis=0), np.nan)
    return Group(name="" if start == 0 else kind, columns=columns, time=_TIME)
