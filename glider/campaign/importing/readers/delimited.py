"""Text files of numbers in any dialect: separators, decimal commas, several headers."""

import contextlib
import csv
import datetime
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from glider.campaign.importing.formats import FORMAT_NAMES, SUFFIXES
from glider.campaign.importing.recording import (
    Column,
    Group,
    Recording,
    spell,
    split_suffix,
)
from glider.errors import InputError, show

_BLANK = re.compile(
    r"-*|<?na>?|n/a|nat|[+-]?nan(\(\w+\))?|[+-]?inf(inity)?|[+-]?1[.,]#\w+|null|none|"
    r"missing|#(n/a|num!|value!|div/0!)",
    re.IGNORECASE,
)
"""Cells without a value; 1.#QNAN and -nan(ind) are those of Microsoft's C."""
_MARK = re.compile(r"^[#%]+[ \t]*")  # Before a comment, or before names.
_UNIT_IN_NAME = re.compile(r"^(.*\S)\s*[\[(]\s*((?!\d)[^\[\]()]*?)\s*[\])]$")
_CLOCK = re.compile(r"(-?)(?:(\d+):)?(\d\d?):(\d\d?)(?:[.,](\d+)|:(\d{3}))?")
"""h:mm:ss.fff, mm:ss.fff or h:mm:ss:ms, as of videos."""
_FRAMES = re.compile(r"\d:\d\d:\d\d:\d")  # hh:mm:ss:ff, the last counts frames.
_MIN_ROWS = 3
_SNIFFED = 30  # Last rows that show the separator.

_Row = Sequence[str]
NumberedRows = Sequence[tuple[int, _Row]]
"""Cells of rows, with their lines in the file."""


def decode(path: Path) -> str:
    """Text of a file in UTF-8, UTF-16 or Windows' Western code page."""
    try:
        data = path.read_bytes()
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(f"{path}: cannot be read: {reason}.") from None
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return data.decode("utf-16", errors="replace")
    if b"\0" in data[:4096]:
        raise InputError(
            f"{path}: not a text file, and its name ends in no known format; "
            f"expected {', '.join(SUFFIXES)} (convert any other to CSV)."
        )
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("cp1252", errors="replace")


def parse(path: Path, text: str) -> Recording:
    """Parses the one table of a text, its header included.

    The header is what stands before the first of the rows of numbers: its last row
    has the names, unless that is a row of units. A unit may also stand in a name:
    "pitch [deg]", "x (mm)", "pitch_deg". Names that repeat get that of their group, in
    the row above, before them: "Position.x". A header may stand again between rows.
    A # or % before the first name is none of it. A header may have its own separator.
    """
    lines = [_MARK.sub("", line) for line in text.splitlines()]
    while lines and not re.search(r"\d", lines[-1]):  # Empty cells, or a last word.
        lines.pop()
    rows = split_rows(lines, _find_delimiter(lines))
    if all(not row or row[-1] == "" for row in rows):  # A separator ends each line.
        rows = [row[:-1] for row in rows]
    first = _first_data_row(rows)
    if first is None:
        raise InputError(
            f"{path}: no rows of numbers were found; expected columns with their names "
            f"above them, or another of the formats {FORMAT_NAMES}."
        )
    width = len(rows[first])
    header = [row for row in rows[:first] if len(row) == width and any(row)]
    if not header:  # It may not have the separator of the rows.
        apart = (re.split(r"[\s,;|]+(?![\[(\s])", line) for line in lines[:first])
        header = [row for row in apart if len(row) == width]
    of_row: list[str | None] = [None] * width
    if len(header) > 1 and _are_units(header[-1], header[-2]):
        of_row = [spell(cell) for cell in header.pop()]
    if not header:
        raise InputError(
            f"{path}: row {first + 1} is {show(', '.join(rows[first]))}, the first of "
            "numbers; expected a row with the names of the columns above it."
        )
    repeated = [row for row in rows[:first] if any(row)]
    data = [(i, row) for i, row in number_rows(rows, first) if row not in repeated]
    for i, row in data:
        if len(row) != width:
            raise InputError(
                f"{path}: row {i} has {len(row)} cells; expected {width}, "
                "as in the rows before."
            )
    columns: dict[str, Column] = {}
    owner = ""
    above = header[-2] if len(header) > 1 else [""] * width
    for j, own in enumerate(header[-1]):
        name = own or above[j]
        bare, unit = _split_unit(name)
        owner = above[j] or owner
        if owner and header[-1].count(name) > 1:
            bare = f"{owner}.{bare}"
        if name and bare in columns:
            fault = f"two columns are named '{bare}'; expected different names."
            columns[bare] = Column(columns[bare].values, fault=fault)
        elif name:
            columns[bare] = make_column(bare, data, j, of_row[j] or unit)
    table = Group("", columns, lines=[i for i, _ in data])
    return Recording(path, (table,))


def split_rows(lines: Sequence[str], delimiter: str) -> list[list[str]]:
    """Cells of lines, each by itself: a lone quote must not swallow the rest."""
    if delimiter == " ":
        return [line.split() for line in lines]
    rows = []
    for line in lines:
        row = line.split(delimiter) if line else []
        if '"' in line:
            cells = csv.reader(
                [line], delimiter=delimiter, strict=True, skipinitialspace=True
            )
            with contextlib.suppress(csv.Error):
                row = next(cells)
        rows.append([cell.strip() for cell in row])
    return rows


def number_rows(
    rows: Sequence[_Row], first: int, last: int | None = None
) -> NumberedRows:
    """Some rows of a file that are not blank, with their lines."""
    return [(i, row) for i, row in enumerate(rows[first:last], first + 1) if any(row)]


def make_column(name: str, rows: NumberedRows, j: int, unit: str | None) -> Column:
    """The j-th cells of rows; times in ISO 8601 become seconds from the first row."""
    cells = [row[j] if j < len(row) else "" for _, row in rows]
    cells = ["" if _BLANK.fullmatch(cell) else cell for cell in cells]
    values = np.array([to_number(cell) for cell in cells])
    filled = np.array(cells, dtype=bool)
    bad = np.flatnonzero(np.isnan(values) & filled)
    if not len(bad):
        return Column(values, unit)
    instants = values.copy()  # Below a minute a clock may show seconds alone.
    instants[bad] = [_instant(cells[i]) for i in bad]
    if not np.isnan(instants[filled]).any():
        epoch = float(instants[filled][0])
        return Column(instants - epoch, "s", epoch=epoch)
    line = rows[bad[0]][0]
    cell = cells[bad[0]]
    times = "a time in ISO 8601 or as h:mm:ss.fff, or a number"
    expected = times if ":" in cell else "a number"
    fault = f"column '{name}', row {line}: found {show(cell)}; expected {expected}."
    return Column(values, unit, fault, labels=cells)


def as_text(value: Any) -> str:
    """Text of a cell; a date, or a time of a day, in ISO 8601."""
    return value.isoformat() if hasattr(value, "isoformat") else str(value).strip()


def to_number(cell: str) -> float:
    """Number of a cell; NaN for what is none, or not finite."""
    try:
        value = math.nan if "_" in cell else float(cell.replace(",", "."))
    except ValueError:
        return math.nan
    return value if math.isfinite(value) else math.nan


def _split_unit(name: str) -> tuple[str, str | None]:
    """A name without the unit in brackets, and the unit that it has."""
    match = _UNIT_IN_NAME.match(name)
    if match and (spell(match[2]) or _BLANK.fullmatch(match[2])):
        return match[1], spell(match[2])
    return name, split_suffix(name)[1]


def _find_delimiter(lines: Sequence[str]) -> str:
    """What separates the numbers of the last rows."""
    tail = [line for line in lines[-200:] if line.strip()][-_SNIFFED:]

    def count(delimiter: str) -> float:
        rows = split_rows(tail, delimiter)
        numeric = [sum(map(_is_number, row)) for row in rows]
        same = len(set(map(len, rows))) == 1
        return (float(np.median(numeric)) if numeric else 0.0) + 0.5 * same

    return max(";\t,| ", key=count)


def _first_data_row(rows: Sequence[_Row]) -> int | None:
    """The first row of numbers that is followed by some more like it."""

    def has_numbers(row: _Row) -> bool:
        filled = [cell for cell in row if cell]
        numbers = sum(map(_is_number, filled))
        return numbers > 0 and 2 * numbers >= len(filled)

    for i in range(len(rows) - _MIN_ROWS + 1):
        few = rows[i : i + _MIN_ROWS]
        if all(has_numbers(row) and len(row) == len(few[0]) for row in few):
            return i
    return None


def _are_units(row: _Row, names: _Row) -> bool:
    """Whether a row under names has their units; some may be unknown, such as V."""
    cells = [cell for cell in row if cell.strip(" []()") not in ("", "-", "1")]
    known = sum(spell(cell) is not None for cell in cells)
    return 2 * known > len(cells) and sum(map(bool, names)) >= len(cells)


def _is_number(cell: str) -> bool:
    return not (math.isnan(to_number(cell)) and math.isnan(_instant(cell)))


def _instant(cell: str) -> float:
    """Seconds since 1970 of a date and time in ISO 8601, or of a time by a clock.

    Without a zone it is taken for UTC; only differences matter. 31.12.2026 is read too.
    """
    clock = _CLOCK.fullmatch(cell)
    has_frames = _FRAMES.search(cell) and not clock
    if ":" not in cell or has_frames:  # Python takes them for hundredths of a second.
        return math.nan
    sign, hours, minutes, seconds, *fraction = clock.groups("") if clock else [""] * 6
    if hours or any(fraction):  # Else they may be hours and minutes, too.
        whole = 3600.0 * int(hours or 0) + 60.0 * int(minutes) + int(seconds)
        return float(f"{sign}1") * (whole + float(f"0.{''.join(fraction) or 0}"))
    cell = re.sub(r"^(\d\d)\.(\d\d)\.(\d{4})\b", r"\3-\2-\1", cell)
    for text in (cell, f"1970-01-01T{cell.removeprefix('T')}"):
        with contextlib.suppress(ValueError):
            time = datetime.datetime.fromisoformat(text)
            return time.replace(tzinfo=time.tzinfo or datetime.UTC).timestamp()
    return math.nan
