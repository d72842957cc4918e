"""CSV exports of OptiTrack's Motive: bodies and markers under a header of six rows.

A column is named BODY.Rotation.X, BODY.Position.X; quaternions have a W. Rows of zeros
are rows in which the body was not seen. Lengths are in the unit that the first row
tells, Euler angles in degrees.
"""

import csv
import io
from pathlib import Path

import numpy as np

from glider.campaign.importing import units
from glider.campaign.importing.raw import Column, Group, RawTable
from glider.campaign.importing.readers.delimited import make_column
from glider.errors import InputError

_TIME = "Time"


def recognizes(text: str) -> bool:
    """Whether a text is such an export."""
    return text.startswith("Format Version")


def parse(path: Path, text: str) -> RawTable:
    """Returns the bodies and markers of an export.

    Raises:
        InputError: its header is none of Motive's.
    """
    rows = list(csv.reader(io.StringIO(text)))
    facts = dict(zip(rows[0][::2], rows[0][1::2], strict=False))
    heads = {row[1]: row for row in rows[1:8] if len(row) > 2 and row[1]}
    last = next((i for i, row in enumerate(rows) if row[:1] == ["Frame"]), None)
    if last is None or "Name" not in heads:
        raise InputError(
            f"{path}: starts as an export of Motive does, but its rows 'Name' and "
            "'Frame' are missing; an export with its header is needed."
        )
    names, what, axes = heads["Name"], rows[last - 1], rows[last]
    length = units.spell(facts.get("Length Units", ""))
    euler = facts.get("Rotation Type", "")
    data = [(i, row) for i, row in enumerate(rows[last + 1 :], last + 2) if any(row)]
    columns: dict[str, Column] = {}
    for j in range(1, len(axes)):
        cells = [(i, row[j] if j < len(row) else "") for i, row in data]
        if j == 1:
            columns[_TIME] = make_column(_TIME, cells, "s")
        elif axes[j] in ("X", "Y", "Z", "W"):
            name = f"{names[j]}.{what[j]}.{axes[j]}"
            angle = None if euler == "Quaternion" else "deg"
            unit = length if what[j] == "Position" else angle
            columns.setdefault(name, make_column(name, cells, unit))
    _forget_unseen(columns)
    return RawTable(
        path=path,
        groups=(Group(name="", columns=columns, time=_TIME),),
        rotation=None if euler == "Quaternion" else euler or None,
    )


def _forget_unseen(columns: dict[str, Column]) -> None:
    """Writes nan where a position is zero in all three axes: nothing was seen."""
    for body in {n.rpartition(".Position.")[0] for n in columns if ".Position." in n}:
        places = [columns[f"{body}.Position.{axis}"].values for axis in "XYZ"]
        unseen = np.all(np.stack(places) == 0.0, axis=0)
        for name, column in columns.items():
            if name.startswith(f"{body}."):
                column.values[unseen] = np.nan
