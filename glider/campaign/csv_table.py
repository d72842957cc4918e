"""CSV files of numbers with a header; what is wrong with a cell, in one sentence."""

import csv
import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from glider.errors import InputError, show


@dataclasses.dataclass(frozen=True, kw_only=True)
class Table:
    """The cells of a CSV file as text."""

    path: Path
    columns: dict[str, list[str]]
    lines: list[int]  # Number of each row's line in the file; the header is line 1.

    def texts(self, name: str) -> list[str]:
        """Returns the cells of a column; raises InputError where it is missing."""
        if name not in self.columns:
            raise InputError(
                f"{self.path}: column '{name}' is missing; "
                f"found {show(', '.join(self.columns))}."
            )
        return self.columns[name]

    def numbers(self, name: str) -> np.ndarray:
        """Returns a column (n,); raises InputError where a cell is no finite number."""
        values = np.array([_to_float(text) for text in self.texts(name)])
        self.refuse(~np.isfinite(values), name, "a finite number is needed.")
        return values

    def refuse(self, bad: np.ndarray, name: str, need: str) -> None:
        """Raises InputError about the first bad cell of a column, if any."""
        for i in np.flatnonzero(bad)[:1]:
            raise InputError(
                f"{self.path}: column '{name}', row {self.lines[i]}: "
                f"found {show(self.columns[name][i])}; {need}"
            )


def table_of(path: Path, columns: Mapping[str, np.ndarray]) -> Table:
    """Returns columns (n,) of numbers as a table.

    Args:
        path: of the file that they will be, or come from.
        columns: by name.
    """
    rows = len(next(iter(columns.values())))
    return Table(
        path=path,
        columns={name: [repr(float(v)) for v in c] for name, c in columns.items()},
        lines=list(range(2, rows + 2)),
    )


def read_text(file: Path) -> str:
    """Returns the text of a file; raises InputError where there is none in UTF-8."""
    try:
        return file.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"{file}: not a text file; UTF-8 is needed.") from None
    except OSError as error:
        raise InputError(f"{file}: cannot be read: {error.strerror}.") from None


def read_table(file: Path) -> Table:
    """Reads a CSV file with a header; blank lines are left out.

    Raises:
        InputError: it is no such file, or its rows are not as long as the header.
    """
    lines = read_text(file).split("\n")
    cells: list[list[str]] = []
    for line in lines:  # One by one, lest a lone quote swallow the rest.
        try:
            row = next(csv.reader([line], strict=True, skipinitialspace=True), [])
        except csv.Error as error:
            raise InputError(f"{file}: row {len(cells) + 1}: {error}.") from None
        cells.append([cell.strip() for cell in row])
    names = cells[0]
    if all(math.isfinite(_to_float(name)) for name in names):
        raise InputError(
            f"{file}: row 1 is {show(lines[0])}; "
            "a header with the names of the columns is needed."
        )
    for name in names:
        if name and names.count(name) > 1:
            raise InputError(
                f"{file}: column '{name}' appears {names.count(name)} times; "
                "each name may appear once."
            )
    rows = [i for i in range(1, len(lines)) if lines[i].strip()]
    for i in rows:
        if len(cells[i]) != len(names):
            raise InputError(
                f"{file}: row {i + 1} has {len(cells[i])} cells; "
                f"{len(names)} are needed, as in the header."
            )
    columns = {name: [cells[i][j] for i in rows] for j, name in enumerate(names)}
    return Table(path=file, columns=columns, lines=[i + 1 for i in rows])


def _to_float(text: str) -> float:
    """Returns nan for what is not a number."""
    try:
        return float(text) if "_" not in text else math.nan
    except ValueError:
        return math.nan
