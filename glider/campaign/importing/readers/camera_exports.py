"""Text exports of camera systems: Motive, Vicon's Nexus and Tracker, QTM.

A column is named BODY.Position.X, BODY.Rotation.X (quaternions have a W, matrices are
BODY.Rotation[0] to [8], row by row), or MARKER.Position.X; names in the header of a TSV
file are known, too.
"""

import itertools
import math
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from glider.campaign.flight_table import split_rows, to_float
from glider.campaign.importing.readers.delimited import (
    NumberedRows,
    make_column,
    number_rows,
)
from glider.campaign.importing.recording import Column, Group, Recording, spell
from glider.errors import InputError, show

_TIME = "Time"
_SECTIONS = ("Trajectories", "Objects", "Segments", "Model Outputs", "Joints")
_PARTS = {"R": "Rotation", "T": "Position"}  # Nexus writes TX for Position.X.
_VICON_AXIS = re.compile(r"([A-Z]?)([XYZW])")
_QTM_KEY = re.compile(r"[A-Z][A-Z_]+")
_QTM_ANGLES = ["Roll", "Pitch", "Yaw"]
_QTM_MATRIX = {f"Rot[{k}]": f"Rotation[{3 * (k % 3) + k // 3}]" for k in range(9)}
_QTM_VECTORS = {axis: f"Position.{axis}" for axis in "XYZ"} | _QTM_MATRIX
"""Our names; QTM writes matrices column by column."""

_Rows = list[list[str]]
_Columns = dict[str, Column]


def parse_export(path: Path, text: str) -> Recording | None:
    """Parses an export of one of them; None for a text that is none."""
    if text.startswith("Format Version"):
        return _parse_motive(path, text)
    if re.match(r"(FILE_VERSION|NO_OF_FRAMES)\t", text):
        return _parse_qtm(path, text)
    if text.lstrip().split("\n", 1)[0].strip(" \r,;\t") in _SECTIONS:
        return _parse_vicon(path, text)
    return None


def _make_columns(
    data: NumberedRows, names: Sequence[str], units: Sequence[str | None]
) -> _Columns:
    """The first column of each name; "" is the name of none that is wanted."""
    columns: _Columns = {}
    for j, (name, unit) in enumerate(zip(names, units, strict=False)):
        if name and name not in columns:
            columns[name] = make_column(name, data, j, unit)
    return columns


def _parse_motive(path: Path, text: str) -> Recording:
    """Bodies and markers under six rows; lengths in the first's unit, angles in deg."""
    rows = split_rows(text.splitlines(), ",")
    facts = dict(zip(rows[0][::2], rows[0][1::2], strict=False))
    heads = {row[1]: row for row in rows[1:8] if len(row) > 2}
    last = next((i for i, row in enumerate(rows) if row[:1] == ["Frame"]), None)
    if last is None or "Name" not in heads:
        raise InputError(
            f"{path}: starts as an export of Motive does, but its rows 'Name' and "
            "'Frame' are missing; expected an export with its header."
        )
    axes = rows[last]
    if len(axes) < 2:
        raise InputError(f"{path}: row {last + 1} has no column of times.")
    rotation = facts.get("Rotation Type", "")
    unit_of = {"Position": spell(facts.get("Length Units", ""))}
    angle = None if rotation == "Quaternion" else "deg"
    names = ["", _TIME]
    units = [None, "s"]
    heading = itertools.zip_longest(heads["Name"], rows[last - 1], axes, fillvalue="")
    for body, part, axis in itertools.islice(heading, 2, len(axes)):
        is_vector = axis in ("X", "Y", "Z", "W")
        names.append(f"{body}.{part}.{axis}" if is_vector else "")
        units.append(unit_of.get(part, angle))
    columns = _make_columns(number_rows(rows, last + 1), names, units)
    order = rotation.upper()
    is_euler = sorted(order) == ["X", "Y", "Z"]
    group = Group("", columns, _TIME)
    return Recording(path, (group,), order if is_euler else None, up="y")


def _parse_vicon(path: Path, text: str) -> Recording:
    """Sections; a rotation's meaning, a setting of the export, is up to the mapping."""
    lines = text.splitlines()
    head = "".join(lines[:10])
    rows = split_rows(lines, max(",;\t", key=head.count))
    starts = [i for i, row in enumerate(rows) if row and row[0] in _SECTIONS]
    bounds = itertools.pairwise([*starts, len(rows)])
    sections = [_parse_section(path, rows, *bound) for bound in bounds]
    return Recording(path, tuple(sections), up="z")


def _parse_section(path: Path, rows: _Rows, start: int, end: int) -> Group:
    kind = rows[start][0]
    header = rows[start + 1 : min(start + 5, end)]
    rate = to_float(header[0][0]) if header and header[0] else math.nan
    if len(header) < 4 or not 0.0 < rate < math.inf:
        raise InputError(
            f"{path}: section '{kind}' in row {start + 1} lacks its rate, names or "
            "units; expected an export of Vicon with its five header rows."
        )
    _, bodies, parts, spelled = header
    owner = ""
    names: list[str] = []
    units = []
    heading = itertools.zip_longest(bodies, parts, spelled, fillvalue="")
    for body, part, unit in heading:
        owner = (body or owner).removeprefix("Global Angle ").strip()
        match = _VICON_AXIS.fullmatch(part.upper())
        what, axis = match.groups() if match and len(names) > 1 else ("", "")
        vector = _PARTS.get(what, "Position")
        names.append(f"{owner}.{vector}.{axis}" if axis else "")
        units.append(spell(unit))
    data = number_rows(rows, start + 5, end)
    columns = _make_columns(data, names, units)
    frames = make_column("Frame", data, 0, None)
    times = (frames.values - frames.values[:1].sum()) / rate
    columns[_TIME] = Column(times, "s", frames.fault)
    return Group("" if start == 0 else kind, columns, _TIME)


def _parse_qtm(path: Path, text: str) -> Recording:
    """A TSV of QTM: rows of a key and values, a row of names, and numbers in mm.

    The attitude of bodies is their matrix: the meaning of the three angles is a setting
    of QTM. A residual of -1 marks a row in which a body was not seen.
    """
    rows = split_rows(text.splitlines(), "\t")
    heads = itertools.takewhile(lambda r: not r or _QTM_KEY.fullmatch(r[0]), rows)
    facts = {row[0]: [cell for cell in row[1:] if cell] for row in heads if row}
    first = next((i for i, r in enumerate(rows) if r and r[0] not in facts), None)
    bodies = facts.get("BODY_NAMES", []) + facts.get("MARKER_NAMES", [])
    if first is None or not bodies or math.isfinite(to_float(rows[first][0])):
        raise InputError(
            f"{path}: is a TSV of QTM without 6D or 3D data, or without the row of "
            "their names; expected an export with its header, column names and rows."
        )
    angles = facts.get("BODY_EULER_NAMES", _QTM_ANGLES)
    unit_of = dict.fromkeys("XYZ", "mm") | dict.fromkeys(angles, "deg") | {_TIME: "s"}
    owner = ""
    full = []
    units = []
    for cell in rows[first]:
        before, _, part = cell.rpartition(" ")
        owner = before or owner
        full.append(f"{owner} {part}" if cell and owner else cell)
        units.append(unit_of.get(part))
    data = number_rows(rows, first + 1)
    columns = _make_columns(data, full, units)
    if _TIME not in columns:
        columns[_TIME] = _times(path, facts.get("FREQUENCY", ["missing"]), len(data))
    for body in bodies:
        _name_vectors(body, columns)
    return Recording(path, (Group("", columns, _TIME),), up="z")


def _name_vectors(body: str, columns: _Columns) -> None:
    """Names the position and matrix of a body, nan in rows in which it is not seen."""
    residual = columns.get(f"{body} Residual", Column(np.zeros(1)))
    is_unseen = residual.values < 0.0
    for name, column in list(columns.items()):
        owner, _, part = name.rpartition(" ")
        if owner != body:
            continue
        if is_unseen.any():
            column.values[is_unseen] = np.nan
        if part in _QTM_VECTORS:
            columns[f"{body}.{_QTM_VECTORS[part]}"] = column


def _times(path: Path, frequency: list[str], rows: int) -> Column:
    """Times of rows at the rate of a header [s]."""
    rate = to_float(frequency[0])
    if not 0.0 < rate < math.inf:
        raise InputError(
            f"{path}: FREQUENCY is {show(' '.join(frequency))} and there is no column "
            "of times; expected one, or a rate in Hz."
        )
    return Column(np.arange(rows) / rate, "s")
