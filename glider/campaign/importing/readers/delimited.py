"""Text files of numbers in any dialect: separators, decimal commas, several headers."""

import csv
import io
import re
from pathlib import Path

import numpy as np

from glider.campaign.importing import units
from glider.campaign.importing.raw import Column, Group, RawTable
from glider.errors import InputError, show

_BLANK = frozenset({"", "-", "--", "na", "n/a", "nan", "null", "none", "inf", "-inf"})
_DECIMAL_COMMA = re.compile(r"[-+]?\d*,\d+([eE][-+]?\d+)?$")
_UNIT_IN_NAME = re.compile(r"^(.*\S)\s*[\[(]\s*([^\[\]()]+?)\s*[\])]$")
_UNIT_SUFFIXES = ("mm", "cm", "m", "deg", "rad", "ms", "us", "ns", "s")
_MIN_ROWS = 3


def decode(path: Path) -> str:
    """Returns the text of a file in UTF-8, UTF-16 or Windows' Western code page."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}.") from None
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return data.decode("utf-16", errors="replace")
    if b"\0" in data[:4096]:
        raise InputError(
            f"{path}: not a text file, and its name ends in no known format; "
            ".csv, .ulg, .mat, .mcap, .bag, .db3 or .parquet is needed."
        )
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("cp1252", errors="replace")


def parse(path: Path, text: str) -> RawTable:
    """Returns the one table of a text.

    The header is what stands before the first of the rows of numbers: its last row
    has the names, unless that is a row of units. A unit may also stand in a name:
    "pitch [deg]", "x (mm)", "pitch_deg".

    Raises:
        InputError: there are no rows of numbers, or no names above them.
    """
    lines = text.splitlines()
    delimiter = _find_delimiter(lines)
    rows = _split(lines, delimiter)
    comma = delimiter != "," and any(
        _DECIMAL_COMMA.match(cell) for row in rows[-50:] for cell in row
    )
    first = _first_data_row(rows, comma)
    if first is None:
        raise InputError(
            f"{path}: no rows of numbers were found; "
            "columns with their names above them are needed."
        )
    width = len(rows[first])
    header = [row for row in rows[:first] if len(row) == width and any(row)]
    header = [[row[0].lstrip("#% "), *row[1:]] for row in header]
    told: list[str | None] = [None] * width
    if len(header) > 1 and _are_units(header[-1]):
        told = [units.spell(cell) for cell in header.pop()]
    if not header:
        raise InputError(
            f"{path}: row {first + 1} is {show(lines[first])}, the first of numbers; "
            "a row with the names of the columns is needed above it."
        )
    columns: dict[str, Column] = {}
    data = [(i, row) for i, row in enumerate(rows[first:], first + 1) if any(row)]
    for i, row in data:
        if len(row) != width:
            raise InputError(
                f"{path}: row {i} has {len(row)} cells; {width} are needed, "
                "as in the rows before."
            )
    for j, name in enumerate(header[-1]):
        bare, unit = split_unit(name)
        if name and bare in columns:
            raise InputError(
                f"{path}: two columns are named '{bare}'; different names are needed."
            )
        if name:
            cells = [(i, row[j]) for i, row in data]
            columns[bare] = make_column(bare, cells, told[j] or unit, comma)
    return RawTable(path=path, groups=(Group(name="", columns=columns),))


def make_column(
    name: str, cells: list[tuple[int, str]], unit: str | None, comma: bool = False
) -> Column:
    """Returns a column of cells with the numbers of their lines.

    Args:
        name: of the column.
        cells: line and text of each.
        unit: of the column, if it is told.
        comma: whether decimals have a comma.
    """
    values = np.empty(len(cells))
    fault = None
    for k, (line, cell) in enumerate(cells):
        values[k] = _number(cell, comma)
        if np.isnan(values[k]) and cell.lower() not in _BLANK and fault is None:
            fault = (
                f"column '{name}', row {line}: found {show(cell)}; a number is needed."
            )
    return Column(values=values, unit=unit, fault=fault)


def _split(lines: list[str], delimiter: str) -> list[list[str]]:
    if delimiter == " ":
        return [line.split() for line in lines]
    reader = csv.reader(io.StringIO("\n".join(lines)), delimiter=delimiter)
    rows = [[cell.strip() for cell in row] for row in reader]
    if all(not row or row[-1] == "" for row in rows):  # A separator ends each line.
        rows = [row[:-1] for row in rows]
    return rows


def _find_delimiter(lines: list[str]) -> str:
    """Returns what separates the numbers of the last rows."""
    tail = [line for line in lines[-200:] if line.strip()][-50:]

    def count(delimiter: str) -> float:
        rows = _split(tail, delimiter)
        comma = delimiter != ","
        numeric = [sum(_is_number(c, comma) for c in row) for row in rows]
        same = len({len(row) for row in rows}) == 1
        return (float(np.median(numeric)) if numeric else 0.0) + 0.5 * same

    return max(";\t,| ", key=count)


def _first_data_row(rows: list[list[str]], comma: bool) -> int | None:
    """Returns the first row of numbers that has some more like it after it."""
    for i in range(len(rows) - _MIN_ROWS + 1):
        few = rows[i : i + _MIN_ROWS]
        if all(_are_numbers(row, comma) and len(row) == len(few[0]) for row in few):
            return i
    return None


def _are_numbers(row: list[str], comma: bool) -> bool:
    filled = [cell for cell in row if cell]
    numbers = sum(_is_number(cell, comma) for cell in filled)
    return numbers > 0 and 2 * numbers >= len(filled)


def _are_units(row: list[str]) -> bool:
    known = [
        units.spell(cell) is not None or cell.strip(" []()") in "-1" for cell in row
    ]
    return all(known) and any(units.spell(cell) for cell in row)


def split_unit(name: str) -> tuple[str, str | None]:
    """Returns a name without the unit in brackets, and the unit that it tells."""
    match = _UNIT_IN_NAME.match(name)
    if match and units.spell(match[2]):
        return match[1], units.spell(match[2])
    stem, _, suffix = name.rpartition("_")
    return name, suffix if stem and suffix in _UNIT_SUFFIXES else None


def _is_number(cell: str, comma: bool) -> bool:
    return not np.isnan(_number(cell, comma))


def _number(cell: str, comma: bool) -> float:
    text = cell.replace(",", ".") if comma else cell
    try:
        value = float(text) if "_" not in text else np.nan
    except ValueError:
        return np.nan
    return value if np.isfinite(value) else np.nan
