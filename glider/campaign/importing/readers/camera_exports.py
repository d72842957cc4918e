"""Text exports of camera systems: Motive, Vicon's Nexus and Tracker, QTM, and TRC.

A column is named BODY.Position.X, BODY.Rotation.X (quaternions have a W), or
MARKER.Position.X; names in the header of a TSV or TRC file are known, too. Rows of
zeros are rows in which the body was not seen.
"""

import itertools
import math
import re
from pathlib import Path

import numpy as np

from glider.campaign.flight_table import split_rows, to_float
from glider.campaign.importing.matrices import to_quaternions
from glider.campaign.importing.readers.delimited import make_column, number_rows
from glider.campaign.importing.recording import Column, Group, Recording, spell
from glider.errors import InputError, show

_TIME = "Time"
_SECTIONS = ("Trajectories", "Objects", "Segments", "Model Outputs", "Joints")
_PARTS = {"R": "Rotation", "T": "Position"}  # Nexus writes TX for Position.X.
_QTM_KEY = re.compile(r"[A-Z][A-Z_]+")
_QTM_ANGLES = ["Roll", "Pitch", "Yaw"]
_MATRIX = tuple(f"Rot[{k}]" for k in range(9))  # Column by column.

_Rows = list[list[str]]


def parse_export(path: Path, text: str) -> Recording | None:
    """Parses an export of one of them; None for a text that is none."""
    if text.startswith("Format Version"):
        return _parse_motive(path, text)
    if text.startswith("PathFileType"):
        return _parse_trc(path, text)
    if re.match(r"(FILE_VERSION|NO_OF_FRAMES)\t", text):
        return _parse_qtm(path, text)
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
    axes = rows[last]
    trimmed = [""] * len(rows[last])
    names = rows[heads["Name"]] + trimmed
    parts = rows[last - 1] + trimmed
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


def _parse_section(path: Path, rows: _Rows, start: int, end: int) -> Group:
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


def _parse_qtm(path: Path, text: str) -> Recording:
    """A TSV of QTM: rows of a key and values, perhaps a row of names, numbers in mm.

    Of bodies, the matrix becomes a quaternion: the meaning of the three angles is a
    setting of QTM. A residual of -1 marks a row in which a body was not seen.
    """
    rows = split_rows(text.splitlines(), "\t")
    if all(not row or row[-1] == "" for row in rows[-2:]):  # A tab ends each row.
        rows = [row[:-1] if row and row[-1] == "" else row for row in rows]
    heads = itertools.takewhile(lambda r: not r or _QTM_KEY.fullmatch(r[0]), rows)
    facts = {row[0]: [c for c in row[1:] if c] for row in heads if row}
    first = next((i for i, r in enumerate(rows) if r and r[0] not in facts), None)
    bodies = facts.get("BODY_NAMES", [])
    markers = facts.get("MARKER_NAMES", [])
    if first is None or not (bodies or markers):
        kind = ", ".join(facts.get("DATA_INCLUDED", [])) or "no data"
        raise InputError(
            f"{path}: is a TSV of QTM with {kind}; expected an export of 6D or 3D data "
            "with its header and rows."
        )
    names = rows[first]
    angles = facts.get("BODY_EULER_NAMES", _QTM_ANGLES)
    if math.isfinite(to_float(names[0])):  # The names are omitted.
        parts = ("X", "Y", "Z", *angles, "Residual", *_MATRIX)
        each = [f"{body} {part}" for body in bodies for part in parts]
        each += [f"{marker} {axis}" for marker in markers for axis in "XYZ"]
        names = ["Frame", _TIME][: max(len(names) - len(each), 0)] + each
    else:
        first += 1
    data = number_rows(rows, first)
    owner = ""
    units = dict.fromkeys("XYZ", "mm") | dict.fromkeys(angles, "deg") | {_TIME: "s"}
    columns: dict[str, Column] = {}
    for j, cell in enumerate(names):
        before, _, part = cell.rpartition(" ")
        owner = before or owner
        name = f"{owner} {part}" if owner else part
        if cell:
            columns[name] = make_column(name, data, j, units.get(part))
    if _TIME not in columns:
        columns[_TIME] = _times(path, "FREQUENCY", facts.get("FREQUENCY"), len(data))
    for body in (*bodies, *markers):
        own = {n: c for n, c in columns.items() if n.startswith(f"{body} ")}
        residual = own.get(f"{body} Residual", Column(np.zeros(len(data))))
        for column in own.values():
            column.values[residual.values < 0.0] = np.nan
        columns |= {
            f"{body}.Position.{axis}": own[f"{body} {axis}"]
            for axis in "XYZ"
            if f"{body} {axis}" in own
        }
        if all(f"{body} {entry}" in own for entry in _MATRIX):
            entries = [columns.pop(f"{body} {entry}") for entry in _MATRIX]
            by_column = np.stack([c.values for c in entries], axis=1).reshape(-1, 3, 3)
            quaternions = to_quaternions(by_column.swapaxes(1, 2))
            fault = next((c.fault for c in entries if c.fault), None)
            for axis, values in zip("XYZW", quaternions.T, strict=True):
                columns[f"{body}.Rotation.{axis}"] = Column(values, fault=fault)
    _forget_unseen(columns)
    return Recording(path, (Group("", columns, _TIME),), up="z")


def _parse_trc(path: Path, text: str) -> Recording:
    """OpenSim's markers: three rows of facts, one of names, one of X1, Y1, Z1, ..."""
    lines = text.splitlines()
    rows = split_rows(lines, "\t" if "\t" in "".join(lines[3:4]) else " ")
    if len(rows) < 5 or rows[3][:1] != ["Frame#"]:
        raise InputError(
            f"{path}: starts as a TRC file does, but its row 4 has no 'Frame#'; "
            "expected its five header rows."
        )
    facts = dict(zip(rows[1], rows[2], strict=False))
    length = spell(facts.get("Units", ""))
    data = number_rows(rows, 5)
    columns = {_TIME: make_column(_TIME, data, 1, "s")}
    spelled = [cell for cell in rows[4] if cell]
    for k, marker in enumerate(filter(None, rows[3][2:])):
        for j, axis in enumerate("XYZ", 3 * k):
            name = f"{marker}.Position.{axis}"
            columns[name] = make_column(name, data, j + 2, length)
            if j < len(spelled):
                columns[spelled[j]] = columns[name]
    _forget_unseen(columns)
    return Recording(path, (Group("", columns, _TIME),), up="y")


def _times(path: Path, key: str, value: list[str] | None, rows: int) -> Column:
    """Times of rows at the rate of a header [s]."""
    rate = to_float((value or [""])[0])
    if not (rate > 0.0 and math.isfinite(rate)):
        found = show(" ".join(value or ["missing"]))
        raise InputError(
            f"{path}: {key} is {found} and there is no column of times; "
            "expected one, or a rate in Hz."
        )
    return Column(np.arange(rows) / rate, "s")


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
