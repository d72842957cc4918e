"""Text exports of camera systems: Motive, Vicon's Nexus and Tracker, QTM.

A column is named BODY.Position.X, BODY.Rotation.X (quaternions have a W, matrices are
BODY.Rotation[0] to [8], row by row), or MARKER.Position.X.

Each system has a parser that finds the name and unit of every column in the header;
`_make_columns` then reads the rows of numbers. Many cells of the headers are blank: a
body is named in the first of its columns only, except by Motive.
"""

import itertools
import math
import re
from pathlib import Path

import numpy as np

from glider.campaign.importing.readers.delimited import (
    make_column,
    number_rows,
    split_rows,
    to_number,
)
from glider.campaign.importing.recording import Column, Group, Recording, spell
from glider.errors import InputError

_TIME = "Time"

# Vicon: titles of sections, and names of axes. Nexus writes TX, Tracker X.
_SECTIONS = ("Trajectories", "Objects", "Segments", "Model Outputs", "Joints")
_PARTS = {"R": "Rotation", "T": "Position", "": "Position"}
_VICON_AXIS = re.compile(r"([RT]?)([XYZW])")

# QTM: what a row of the header begins with; units and our names of a body's columns.
_QTM_KEY = re.compile(r"[A-Z][A-Z_]+")
_QTM_UNITS = dict.fromkeys("XYZ", "mm") | dict.fromkeys(("Roll", "Pitch", "Yaw"), "deg")
_QTM_PARTS = {axis: f"Position.{axis}" for axis in "XYZ"}
_QTM_PARTS |= {f"Rot[{k}]": f"Rotation[{3 * (k % 3) + k // 3}]" for k in range(9)}
"""QTM writes matrices column by column."""

_Rows = list[list[str]]
_Columns = dict[str, Column]


def parse_export(path: Path, text: str) -> Recording | None:
    """Parses the text of an export, which its first line identifies.

    Returns:
        The recording; None if the text is no export of one of these systems.

    Raises:
        InputError: it is one, but a part of its header is missing.
    """
    lines = text.splitlines()
    first = lines[0] if lines else ""
    if first.startswith("Format Version"):
        return _parse_motive(path, split_rows(lines, ","))
    if first.startswith(("FILE_VERSION\t", "NO_OF_FRAMES\t")):
        return _parse_qtm(path, split_rows(lines, "\t"))
    if first.strip(" ,;\t") in _SECTIONS:
        head = "".join(lines[:10])
        delimiter = max(",;\t", key=head.count)
        return _parse_vicon(path, split_rows(lines, delimiter))
    return None


def _refuse(path: Path, what: str, lacks: str) -> InputError:
    """Makes the error of an export of a system that lacks something."""
    return InputError(
        f"{path}: is an export of {what} without {lacks}; expected an export with its "
        "whole header."
    )


def _make_columns(
    rows: _Rows, first: int, heads: list[tuple[str, str | None]]
) -> _Columns:
    """Makes the columns below the header, of each name the first.

    Args:
        rows: of the file.
        first: index of the first row of numbers.
        heads: name and unit of each column; the name is "" where it is not wanted.
    """
    data = number_rows(rows, first)
    columns: _Columns = {}
    for j, (name, unit) in enumerate(heads):
        if name and name not in columns:
            columns[name] = make_column(name, data, j, unit)
    return columns


def _parse_motive(path: Path, rows: _Rows) -> Recording:
    """Parses an export of Motive: facts in pairs, then a header of several rows.

        Format Version,1.24,Rotation Type,Quaternion,Length Units,Millimeters,...
        ,Type,Rigid Body,...
        ,Name,Glider,Glider,Glider,Glider,Glider,...
        ,ID,1,1,1,1,1,...
        ,,Rotation,Rotation,Rotation,Rotation,Position,...
        Frame,Time (Seconds),X,Y,Z,W,X,...

    Euler angles are in degrees.

    Raises:
        InputError: there is no row of names or axes, or no column of times.
    """
    facts = dict(zip(rows[0][::2], rows[0][1::2], strict=False))
    order = facts.get("Rotation Type", "").upper()
    length_unit = spell(facts.get("Length Units", ""))
    angle_unit = None if order == "QUATERNION" else "deg"

    # The row of axes, the last of the header; and that of the bodies, above it.
    last = next((i for i, row in enumerate(rows) if row[:1] == ["Frame"]), 0)
    bodies = next((row for row in rows[:last] if row[1:2] == ["Name"]), None)
    if bodies is None or len(rows[last]) < 2:
        raise _refuse(path, "Motive", "its rows 'Name' and 'Frame', or times")

    heads = []
    for body, part, axis in zip(bodies, rows[last - 1], rows[last], strict=False):
        name = f"{body}.{part}.{axis}" if axis in ("X", "Y", "Z", "W") else ""
        heads.append((name, length_unit if part == "Position" else angle_unit))
    heads[:2] = [("", None), (_TIME, "s")]  # Numbers of frames, and times.

    table = Group("", _make_columns(rows, last + 1, heads), _TIME)
    is_euler = sorted(order) == ["X", "Y", "Z"]
    return Recording(path, (table,), order if is_euler else "", up="y")


def _parse_vicon(path: Path, rows: _Rows) -> Recording:
    """Parses an export of Nexus or Tracker, each section a group.

    What a rotation means is a setting of the export, which the file does not hold: it
    is up to the mapping.
    """
    starts = [i for i, row in enumerate(rows) if row and row[0] in _SECTIONS]
    groups = []
    for start, end in itertools.pairwise([*starts, len(rows)]):
        columns = _parse_section(path, rows[:end], start)
        name = rows[start][0] if start else ""
        groups.append(Group(name, columns, _TIME))
    return Recording(path, tuple(groups), up="z")


def _parse_section(path: Path, rows: _Rows, start: int) -> _Columns:
    """Parses the section that begins at a row and goes on to the last row.

        Objects
        200
        ,,Global Angle Glider,,,,,,Global Angle Wand,...
        Frame,Sub Frame,RX,RY,RZ,TX,TY,TZ,RX,...
        ,,deg,deg,deg,mm,mm,mm,deg,...

    The second row is the rate of frames [Hz], from which the times follow.

    Raises:
        InputError: there is no rate, or the header is not complete.
    """
    header = rows[start + 1 : start + 5]
    rate = 0.0
    if len(header) == 4 and header[0]:
        rate = to_number(header[0][0])
    if not rate > 0.0:  # It may be NaN.
        raise _refuse(path, "Vicon", f"rate, names or units of its '{rows[start][0]}'")

    owner = ""
    heads = []
    for body, part, unit in itertools.zip_longest(*header[1:], fillvalue=""):
        owner = (body or owner).removeprefix("Global Angle ").strip()
        name = ""
        match = _VICON_AXIS.fullmatch(part.upper())
        if match:
            letter, axis = match.groups()
            name = f"{owner}.{_PARTS[letter]}.{axis}"
        heads.append((name, spell(unit)))
    heads[:2] = [("Frame", None), ("", None)]  # The second counts parts of a frame.

    columns = _make_columns(rows, start + 5, heads)
    frames = columns.pop("Frame")
    times = (frames.values - frames.values[:1]) / rate
    columns[_TIME] = Column(times, "s", frames.fault)
    return columns


def _parse_qtm(path: Path, rows: _Rows) -> Recording:
    """Parses a TSV of QTM: rows of a key and values, a row of names, numbers in mm.

        NO_OF_FRAMES  103
        FREQUENCY  120
        BODY_NAMES  Glider  Wand
        Frame  Time  Glider X  Y  Z  Roll  Pitch  Yaw  Residual  Rot[0]  ...

    The attitude of bodies is their matrix: the meaning of BODY.Roll, Pitch and Yaw is a
    setting of QTM.

    Raises:
        InputError: there are no bodies or markers, no names of columns, or neither
            times nor a rate.
    """
    first = next(
        (i for i, row in enumerate(rows) if row and not _QTM_KEY.fullmatch(row[0])),
        None,
    )
    facts = {row[0]: row[1:] for row in rows[:first] if row}
    has_bodies = "BODY_NAMES" in facts or "MARKER_NAMES" in facts
    if first is None or not has_bodies or not math.isnan(to_number(rows[first][0])):
        raise _refuse(path, "QTM", "6D or 3D data, or the row of their names")

    owner = ""
    owners = {}
    heads = []
    for cell in rows[first]:
        before, _, part = cell.rpartition(" ")
        owner = before or owner
        name = f"{owner}.{_QTM_PARTS.get(part, part)}" if owner else cell
        owners[name] = owner
        heads.append((name, _QTM_UNITS.get(part)))

    columns = _make_columns(rows, first + 1, heads)
    table = Group("", columns, _TIME)
    if _TIME not in columns:
        rate = to_number("".join(facts.get("FREQUENCY", [])[:1]))
        if not rate > 0.0:  # It may be NaN.
            raise _refuse(path, "QTM", "times, or a FREQUENCY in Hz")
        columns[_TIME] = Column(np.arange(table.rows) / rate, "s")

    # A body was not seen in the rows in which its residual is -1.
    for name, column in columns.items():
        residual = columns.get(f"{owners.get(name)}.Residual")
        if residual is not None and column is not residual:
            column.values[residual.values < 0.0] = np.nan
    return Recording(path, (table,), up="z")
