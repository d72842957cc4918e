"""Columns of one flight by name: cells of a CSV file, or numbers in memory."""

import csv
import dataclasses
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from glider.errors import InputError, show
from glider.files import schema


@dataclasses.dataclass(frozen=True, kw_only=True)
class Table:
    """Columns of equal length."""

    path: Path  # The file that they come from.
    name: str = ""  # Of the flight; "": that of the file.
    columns: Mapping[str, Any]  # Cells as text, or numbers (n,).
    lines: Sequence[int] | None = None
    """Each row's line in the file; None: from line 2 on, as line 1 is the header."""

    def texts(self, name: str) -> Sequence[str]:
        """Cells of a column; InputError where it is missing."""
        if name not in self.columns:
            raise InputError(
                f"{self.path}: column '{name}' is missing; "
                f"found {show(', '.join(self.columns))}."
            )
        return self.columns[name]

    def numbers(self, name: str) -> np.ndarray:
        """Numbers of a column (n,); InputError where a cell is no finite number."""
        cells = self.texts(name)
        values = np.array([_to_float(cell) for cell in cells])
        self.refuse(~np.isfinite(values), name, "expected a finite number.")
        return values

    def refuse(self, bad: np.ndarray, name: str, expected: str) -> None:
        """Raises InputError about the first bad cell of a column, if any."""
        for i in np.flatnonzero(bad)[:1]:
            line = i + 2 if self.lines is None else self.lines[i]
            raise InputError(
                f"{self.path}: column '{name}', row {line}: "
                f"found {show(self.columns[name][i])}; {expected}"
            )


def read_table(file: Path) -> Table:
    """Reads a CSV file with a header; blank lines are skipped."""
    lines = schema.read_text(file, "a CSV file").split("\n")
    cells: list[list[str]] = []
    for line in lines:  # One by one, so that a lone quote does not swallow the rest.
        try:
            row = next(csv.reader([line], strict=True, skipinitialspace=True), [])
        except csv.Error as error:
            raise InputError(f"{file}: row {len(cells) + 1}: {error}.") from None
        cells.append([cell.strip() for cell in row])
    names = cells[0]
    if all(math.isfinite(_to_float(name)) for name in names):
        raise InputError(
            f"{file}: row 1 is {show(lines[0])}; "
            "expected a header with the names of the columns."
        )
    for name in names:
        if name and names.count(name) > 1:
            raise InputError(
                f"{file}: column '{name}' appears {names.count(name)} times; "
                "expected each name once."
            )
    rows = [i for i in range(1, len(lines)) if lines[i].strip()]
    for i in rows:
        if len(cells[i]) != len(names):
            raise InputError(
                f"{file}: row {i + 1} has {len(cells[i])} cells; "
                f"expected {len(names)}, as in the header."
            )
    columns = {name: [cells[i][j] for i in rows] for j, name in enumerate(names)}
    return Table(path=file, columns=columns, lines=[i + 1 for i in rows])


def _to_float(cell: str | float) -> float:
    """Number of a cell; NaN for what is none."""
    try:
        return math.nan if isinstance(cell, str) and "_" in cell else float(cell)
    except ValueError:
        return math.nan
