"""Text files of numbers in any dialect: separators, decimal commas, several headers.

`parse` reads a whole table. Its steps `split_rows`, `number_rows` and `make_column` are
public, as `camera_exports` has headers of its own, and `tables` arrays of texts.
"""

import contextlib
import csv
import datetime
import math
import re
from collections.abc import Sequence
from pathlib import Path

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
_Rows = Sequence[_Row]
NumberedRows = Sequence[tuple[int, _Row]]
"""Cells of rows, with their lines in the file."""


def decode(path: Path) -> str:
    """Text of a file in UTF-8, UTF-16 or Windows' Western code page.

    Raises:
        InputError: the file cannot be read, or is no text.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(f"{path}: cannot be read: {reason}.") from None
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return data.decode("utf-16", errors="replace")
    if b"\0" in data[:4096]:
        raise InputError(
            f"{path}: not a text file, and no other format has names that end in "
            f"'{path.suffix}'; expected text, or one of {', '.join(SUFFIXES)} (convert "
            "any other to CSV)."
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
    the row above, before them. So the columns of

        ,Position,,Rate,
        t,x,z,x,z
        s,m,m,deg/s,deg/s
        0.00,1.5,2.0,0.1,0.2

    are t, Position.x, Position.z, Rate.x and Rate.z. A header may stand again between
    rows. A # or % before the first name is none of it. A header may have its own
    separator.

    Raises:
        InputError: there are no rows of numbers, no names above them, or rows of
            different widths.
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
        apart = [re.split(r"[\s,;|]+(?![\[(\s])", line) for line in lines[:first]]
        header = [row for row in apart if len(row) == width]
    if not header:
        raise InputError(
            f"{path}: row {first + 1} is {show(', '.join(rows[first]))}, the first of "
            "numbers; expected a row with the names of the columns above it."
        )

    # Above a header of one row all cells are blank, as are units that it does not have.
    header.insert(0, [""] * width)
    units = header[0]
    if _are_units(header[-1], header[-2]):
        units = header.pop()

    # Rows of numbers, without headers that stand again between them.
    repeated = [row for row in rows[:first] if any(row)]
    data = [(i, row) for i, row in number_rows(rows, first) if row not in repeated]
    for i, row in data:
        if len(row) != width:
            raise InputError(
                f"{path}: row {i} has {len(row)} cells; expected {width}, "
                "as in the rows before."
            )
    columns = _make_columns(header[-1], header[-2], units, data)
    lines_of_rows = [i for i, _ in data]
    return Recording(path, (Group("", columns, lines=lines_of_rows),))


def _make_columns(
    names: _Row, above: _Row, units: _Row, data: NumberedRows
) -> dict[str, Column]:
    """Makes the columns that have names.

    Args:
        names: of the columns.
        above: the cells above the names; those of groups are above their first columns.
        units: cells of the row of units, of which those that are none are ignored.
        data: the rows of numbers.
    """
    columns: dict[str, Column] = {}
    owner = ""
    for j, own in enumerate(names):
        owner = above[j] or owner
        name = own or above[j]
        if not name:
            continue
        bare, unit = _split_unit(name)
        if owner and names.count(name) > 1:
            bare = f"{owner}.{bare}"
        if bare in columns:
            fault = f"two columns are named '{bare}'; expected different names."
            columns[bare] = Column(columns[bare].values, fault=fault)
        else:
            columns[bare] = make_column(bare, data, j, spell(units[j]) or unit)
    return columns


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


def number_rows(rows: _Rows, first: int) -> NumberedRows:
    """The rows from the first on that are not blank, with their lines in the file."""
    return [(i, row) for i, row in enumerate(rows[first:], first + 1) if any(row)]


def make_column(name: str, rows: NumberedRows, j: int, unit: str | None) -> Column:
    """Makes a column of the j-th cells of rows.

    Args:
        name: of the column, for the message of a fault.
        rows: those of numbers; a short one lacks the cell.
        j: index of the column in them.
        unit: of the numbers, where it is known.

    Returns:
        Numbers in the unit, NaN where a cell is missing or says so. If there are dates
        or times of a clock instead, seconds since the first of them. If a cell is
        neither, the column has a fault, and the cells as labels.
    """
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

    line, _ = rows[bad[0]]
    cell = cells[bad[0]]
    expected = "a number"
    if ":" in cell:
        expected = "a time in ISO 8601 or as h:mm:ss.fff, or a number"
    fault = f"column '{name}', row {line}: found {show(cell)}; expected {expected}."
    return Column(values, unit, fault, labels=cells)


def to_number(cell: str) -> float:
    """Number of a cell, with a decimal point or comma; NaN if it has no finite one."""
    try:
        value = float(cell.replace(",", "."))
    except ValueError:
        return math.nan
    is_number = math.isfinite(value) and "_" not in cell  # Python reads 1_000.
    return value if is_number else math.nan


def _split_unit(name: str) -> tuple[str, str | None]:
    """A name without the unit in brackets, and the unit that it has.

    Brackets may also say that there is no unit: "x [-]". Other words in brackets are a
    part of the name.
    """
    match = _UNIT_IN_NAME.match(name)
    if match:
        bare, word = match.groups()
        unit = spell(word)
        if unit or _BLANK.fullmatch(word):
            return bare, unit
    return name, split_suffix(name)[1]


def _find_delimiter(lines: Sequence[str]) -> str:
    """What separates the numbers of the last rows.

    The separator that makes the most numbers of a row counts; of equal ones that which
    makes all rows equally long, and then the first.
    """
    tail = [line for line in lines[-200:] if line.strip()][-_SNIFFED:]

    def rate(delimiter: str) -> float:
        """Numbers in the usual row, and a half where all rows are equally long."""
        rows = split_rows(tail, delimiter)
        widths = {len(row) for row in rows}
        counts = [_count_numbers(row) for row in rows]
        return float(np.median(counts or [0])) + 0.5 * (len(widths) == 1)

    return max(";\t,| ", key=rate)


def _first_data_row(rows: _Rows) -> int | None:
    """Index of the first of `_MIN_ROWS` rows of numbers that are equally long.

    None where there are no such rows. A single row of numbers may belong to a header.
    """
    for i in range(len(rows) - _MIN_ROWS + 1):
        few = rows[i : i + _MIN_ROWS]
        width = len(few[0])
        if all(_has_numbers(row) and len(row) == width for row in few):
            return i
    return None


def _has_numbers(row: _Row) -> bool:
    """Whether at least half of the filled cells of a row are numbers."""
    filled = [cell for cell in row if cell]
    return 0 < len(filled) <= 2 * _count_numbers(row)


def _are_units(row: _Row, names: _Row) -> bool:
    """Whether a row under names has their units.

    Most of its cells must be known units; others may be unknown, such as V. Cells that
    are blank, or say that there is no unit, do not count.
    """
    cells = [cell for cell in row if cell.strip(" []()") not in ("", "-", "1")]
    known = [cell for cell in cells if spell(cell)]
    named = [name for name in names if name]
    return 2 * len(known) > len(cells) and len(named) >= len(cells)


def _count_numbers(row: _Row) -> int:
    """How many cells of a row are numbers or times."""
    return sum(
        not math.isnan(to_number(cell)) or not math.isnan(_instant(cell))
        for cell in row
    )


def _instant(cell: str) -> float:
    """Seconds since 1970 of a date and time in ISO 8601, or of a time by a clock.

    Without a zone it is taken for UTC; only differences matter. 31.12.2026 is read too.
    NaN for what is neither.
    """
    if ":" not in cell:
        return math.nan
    clock = _CLOCK.fullmatch(cell)
    if clock:
        sign, hours, minutes, seconds, *fraction = clock.groups("")
        if hours or any(fraction):  # Else they may be hours and minutes, too.
            whole = 3600.0 * int(hours or 0) + 60.0 * int(minutes) + int(seconds)
            time = whole + float("0." + "".join(fraction))
            return -time if sign else time
    elif _FRAMES.search(cell):  # Python takes them for hundredths of a second.
        return math.nan

    cell = re.sub(r"^(\d\d)\.(\d\d)\.(\d{4})\b", r"\3-\2-\1", cell)
    for text in (cell, f"1970-01-01T{cell.removeprefix('T')}"):
        with contextlib.suppress(ValueError):
            date = datetime.datetime.fromisoformat(text)
            return date.replace(tzinfo=date.tzinfo or datetime.UTC).timestamp()
    return math.nan
