"""CSV exports of camera systems: OptiTrack's Motive, Vicon's Nexus and Tracker.

A column is named BODY.Position.X, BODY.Rotation.X (quaternions have a W), or
MARKER.Position.X. Rows of zeros are rows in which the body was not seen.
"""

import itertools
import math
from pathlib import Path

import numpy as np

from glider.campaign.flight_table import split_rows
from glider.campaign.importing.readers.delimited import make_column, number_rows
from glider.campaign.importing.recording import Column, Group, Recording, spell
from glider.errors import InputError

_TIME = "Time"
_SECTIONS = ("Trajectories", "Objects", "Segments", "Model Outputs", "Joints")
_PARTS = {"R": "Rotation", "T": "Position"}  # Nexus writes TX for Position.X.

Rows = list[list[str]]


def parse_export(path: Path, text: str) -> Recording | None:
    """Parses an export of either; None for a text that is none."""
    if text.startswith("Format Version"):
        return _parse_motive(path, text)
    if text.lstrip().split("\n", 1)[0].strip(" \r,;\t") in _SECTIONS:
        return _parse_vicon(path, text)
    return None


def _parse_motive(path: Path, text: str) -> Recording:
    """Bodies and markers under six rows; lengths in the first's unit, angles in deg."""
    rows = split_rows(text.splitlines(), ",")
    facts = dict(zip(rows[0][::2], rows[0][1::2], strict=False))
    heads = {r[1]: i for i, r in enumerate(rows[1:8], 1) if len(r) > 2 and r[1]}
    last = next((i for i, row in enumerate(rows) if row[:1] == ["Frame"]), None)
    if last is None or "Name" not in heads:
        raise InputError(
            f"{path}: starts as an export of Motive does, but its rows 'Name' and "
            "'Frame' are missing; expected an export with its header."
        )
    axes, trimmed = rows[last], [""] * len(rows[last])
    names, parts = rows[heads["Name"]] + trimmed, rows[last - 1] + trimmed
    length = spell(facts.get("Length Units", ""))
    euler = facts.get("Rotation Type", "")
    data = number_rows(rows, last + 1)
    if len(axes) < 2:
        raise InputError(f"{path}: row {last + 1} has no column of times.")
    columns = {_TIME: make_column(_TIME, data, 1, "s")}
    for j in range(2, len(axes)):
        if axes[j] in ("X", "Y", "Z", "W"):
            name = f"{names[j]}.{parts[j]}.{axes[j]}"
            angle = None if euler == "Quaternion" else "deg"
            unit = length if parts[j] == "Position" else angle
            columns.setdefault(name, make_column(name, data, j, unit))
    _forget_unseen(columns)
    order = euler.upper() if sorted(euler.upper()) == ["X", "Y", "Z"] else None
    return Recording(path, (Group("", columns, _TIME),), order, up="y")


def _parse_vicon(path: Path, text: str) -> Recording:
    """Sections; a rotation's meaning, a setting of the export, is up to the mapping."""
    lines = text.splitlines()
    delimiter = max(",;\t", key=lambda d: sum(line.count(d) for line in lines[:10]))
    rows = split_rows(lines, delimiter)
    starts = [i for i, row in enumerate(rows) if row and row[0] in _SECTIONS]
    bounds = itertools.pairwise([*starts, len(rows)])
    sections = tuple(_parse_section(path, rows, *b) for b in bounds)
    return Recording(path, sections, up="z")


def _parse_section(path: Path, rows: Rows, start: int, end: int) -> Group:
    kind = rows[start][0]
    try:
        rate = float(rows[start + 1][0])
        names, parts, spelled = rows[start + 2 : min(start + 5, end)]
        if not (rate > 0 and math.isfinite(rate)):
            raise ValueError
    except (ValueError, IndexError):
        raise InputError(
            f"{path}: section '{kind}' in row {start + 1} lacks its rate, names or "
            "units; expected an export of Vicon with its five header rows."
        ) from None
    data = number_rows(rows, start + 5, end)
    frames = make_column("Frame", data, 0, None)
    times = (frames.values - frames.values[:1].sum()) / rate
    columns = {_TIME: Column(times, "s", frames.fault)}
    owner = ""
    for j in range(2, len(parts)):
        owner = (names[j] if j < len(names) else "") or owner
        owner = owner.removeprefix("Global Angle ").strip()
        part = parts[j].upper()
        what = _PARTS.get(part[:1], "Position") if len(part) == 2 else "Position"
        if not part or part[-1] not in "XYZW" or len(part) > 2:
            continue
        name = f"{owner}.{what}.{part[-1]}"
        unit = spell(spelled[j]) if j < len(spelled) else None
        columns[name] = make_column(name, data, j, unit)
    _forget_unseen(columns)
    return Group("" if start == 0 else kind, columns, _TIME)


def _forget_unseen(columns: dict[str, Column]) -> None:
    """Writes nan where a position is zero in all three axes: nothing was seen."""
    bodies = [n.rpartition(".Position.")[0] for n in columns if ".Position." in n]
    for body in dict.fromkeys(bodies):
        names = [f"{body}.Position.{axis}" for axis in "XYZ"]
        places = [columns[name].values for name in names if name in columns]
        unseen = np.all(np.stack(places) == 0.0, axis=0)
        for name, column in columns.items():
            if name.startswith(f"{body}."):
                column.values[unseen] = np.nan
