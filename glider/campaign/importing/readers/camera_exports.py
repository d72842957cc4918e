"""Text exports of camera systems: Motive, Vicon's Nexus and Tracker, QTM.

A column is named BODY.Position.X, BODY.Rotation.X (quaternions have a W, matrices are
BODY.Rotation[0] to [8], row by row), or MARKER.Position.X.
"""

import itertools
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from glider.campaign.importing.readers.delimited import (
    NumberedRows,
    make_column,
    number_rows,
    split_rows,
    to_number,
)
from glider.campaign.importing.recording import Column, Group, Recording, spell
from glider.errors import InputError

_TIME = "Time"
_SECTIONS = ("Trajectories", "Objects", "Segments", "Model Outputs", "Joints")
_PARTS = {"R": "Rotation", "T": "Position", "": "Position"}  # Nexus writes TX.
_VICON_AXIS = re.compile(r"([RT]?)([XYZW])")
_QTM_KEY = re.compile(r"[A-Z][A-Z_]+")
_QTM_UNITS = dict.fromkeys("XYZ", "mm") | dict.fromkeys(("Roll", "Pitch", "Yaw"), "deg")
_QTM_PARTS = {axis: f"Position.{axis}" for axis in "XYZ"}
_QTM_PARTS |= {f"Rot[{k}]": f"Rotation[{3 * (k % 3) + k // 3}]" for k in range(9)}
"""Our names; QTM writes matrices column by column."""

_Rows = list[list[str]]
_Columns = dict[str, Column]


def parse_export(path: Path, text: str) -> Recording | None:
    """Parses an export of one of them; None for a text that is none."""
    lines = text.splitlines()
    first = lines[0] if lines else ""
    if first.startswith("Format Version"):
        return _parse_motive(path, split_rows(lines, ","))
    if first.startswith(("FILE_VERSION\t", "NO_OF_FRAMES\t")):
        return _parse_qtm(path, split_rows(lines, "\t"))
    if first.strip(" ,;\t") in _SECTIONS:
        head = "".join(lines[:10])
        return _parse_vicon(path, split_rows(lines, max(",;\t", key=head.count)))
    return None


def _refuse(path: Path, what: str, lacks: str) -> InputError:
    expected = "expected an export with its whole header"
    return InputError(f"{path}: is an export of {what} without {lacks}; {expected}.")


def _make_columns(
    data: NumberedRows, heads: Sequence[tuple[str, str | None]]
) -> _Columns:
    """The first column of each name, by names and units; that of "" is not wanted."""
    columns: _Columns = {}
    for j, (name, unit) in enumerate(heads):
        if name and name not in columns:
            columns[name] = make_column(name, data, j, unit)
    return columns


def _parse_motive(path: Path, rows: _Rows) -> Recording:
    """Bodies and markers under six rows; lengths in the first's unit, angles in deg."""
    facts = dict(zip(rows[0][::2], rows[0][1::2], strict=False))
    last = next((i for i, row in enumerate(rows) if row[:1] == ["Frame"]), 0)
    bodies = next((row for row in rows[:last] if row[1:2] == ["Name"]), None)
    if bodies is None or len(rows[last]) < 2:
        raise _refuse(path, "Motive", "its rows 'Name' and 'Frame', or times")
    order = facts.get("Rotation Type", "").upper()
    unit_of = {"Position": spell(facts.get("Length Units", ""))}
    angle = None if order == "QUATERNION" else "deg"
    heads: list[tuple[str, str | None]] = []
    for body, part, axis in zip(bodies, rows[last - 1], rows[last], strict=False):
        name = f"{body}.{part}.{axis}" if axis in [*"XYZW"] else ""
        heads.append((name, unit_of.get(part, angle)))
    heads[:2] = [("", None), (_TIME, "s")]
    columns = _make_columns(number_rows(rows, last + 1), heads)
    is_euler = sorted(order) == ["X", "Y", "Z"]
    table = Group("", columns, _TIME)
    return Recording(path, (table,), order if is_euler else "", up="y")


def _parse_vicon(path: Path, rows: _Rows) -> Recording:
    """Sections; a rotation's meaning, a setting of the export, is up to the mapping."""
    starts = [i for i, row in enumerate(rows) if row and row[0] in _SECTIONS]
    groups = []
    for start, end in itertools.pairwise([*starts, len(rows)]):
        kind = rows[start][0]
        header = rows[start + 1 : min(start + 5, end)]
        rate = to_number(header[0][0]) if header and header[0] else 0.0
        if len(header) < 4 or not rate > 0.0:
            raise _refuse(path, "Vicon", f"rate, names or units of its '{kind}'")
        owner = ""
        heads: list[tuple[str, str | None]] = []
        for body, part, unit in itertools.zip_longest(*header[1:], fillvalue=""):
            owner = (body or owner).removeprefix("Global Angle ").strip()
            axis = _VICON_AXIS.fullmatch(part.upper())
            name = f"{owner}.{_PARTS[axis[1]]}.{axis[2]}" if axis else ""
            heads.append((name, spell(unit)))
        heads[:2] = [("", None)] * 2  # Numbers of frames.
        data = number_rows(rows, start + 5, end)
        columns = _make_columns(data, heads)
        frames = make_column("Frame", data, 0, None)
        times = (frames.values - frames.values[:1].sum()) / rate
        columns[_TIME] = Column(times, "s", frames.fault)
        groups.append(Group("" if start == 0 else kind, columns, _TIME))
    return Recording(path, tuple(groups), up="z")


def _parse_qtm(path: Path, rows: _Rows) -> Recording:
    """A TSV of QTM: rows of a key and values, a row of names, numbers in mm.

    The attitude of bodies is their matrix: the meaning of BODY.Roll, Pitch and Yaw is a
    setting of QTM. A residual of -1 marks a row in which a body was not seen.
    """
    first_rows = itertools.takewhile(lambda r: not r or _QTM_KEY.fullmatch(r[0]), rows)
    facts = {row[0]: row[1:] for row in first_rows if row}
    first = next((i for i, r in enumerate(rows) if r and r[0] not in facts), -1)
    has_bodies = {"BODY_NAMES", "MARKER_NAMES"} & facts.keys()
    if first < 0 or not has_bodies or np.isfinite(to_number(rows[first][0])):
        raise _refuse(path, "QTM", "6D or 3D data, or the row of their names")
    owner = ""
    heads: list[tuple[str, str | None]] = []
    for cell in rows[first]:
        before, _, part = cell.rpartition(" ")
        owner = before or owner
        name = f"{owner}.{_QTM_PARTS.get(part, part)}" if owner else cell
        heads.append((name, _QTM_UNITS.get(part)))
    data = number_rows(rows, first + 1)
    columns = _make_columns(data, heads)
    rate = to_number(facts.get("FREQUENCY", [""])[0])
    if _TIME not in columns:
        if not rate > 0.0:
            raise _refuse(path, "QTM", "times, or a FREQUENCY in Hz")
        columns[_TIME] = Column(np.arange(len(data)) / rate, "s")
    for name, column in columns.items():
        residual = columns.get(f"{name.partition('.')[0]}.Residual")
        if residual is not None and column is not residual:
            column.values[residual.values < 0.0] = np.nan
    return Recording(path, (Group("", columns, _TIME),), up="z")
