"""A recording: named columns of numbers, in groups of one clock each; their units.

Every reader makes a `Recording` of its file, in the file's names, units and axes. A
mapping then picks columns by their addresses, the name of the group, a dot and the name
of the column, and scales them to SI by units or by a calibration.

pint knows more units, but takes 0.7 s to import: longer than most imports.
"""

import dataclasses
import difflib
import importlib
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from glider.errors import InputError, expect, show

_INDEXED = ("{name}[{axis}]", "{name}{axis}")
_VECTORS = ("{name}.{axis}", "{name}_{axis}", "{name} {axis}", "{name}{axis}")
"""How the columns of a vector are spelled, by digits and by letters of its axes."""

_MOST = 1000  # Names that are compared with one that is not there.

_DEGREE = math.radians(1.0)
UNITS: dict[str, dict[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "length": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254, "ft": 0.3048},
    "angle": {"rad": 1.0, "deg": _DEGREE},
    "rate": {"rad/s": 1.0, "deg/s": _DEGREE},
}
"""Units by kind, each with its size in the kind's SI unit."""

_SPELLINGS = {
    "s": "sec second",
    "ms": "msec millisecond",
    "us": "µs μs usec microsecond",
    "ns": "nsec nanosecond",
    "m": "meter metre",
    "cm": "centimeter centimetre",
    "mm": "millimeter millimetre",
    "in": "inch inche",
    "ft": "feet foot",
    "rad": "radian",
    "deg": "° degree",
    "rad/s": "radps rad_s",
    "deg/s": "°/s dps degps deg_s",
}
_SUFFIX = re.compile(
    r"_(?<=._)([mc]?m|[mun]?s|(deg|rad)(ps|_s)?|(?<=[xyz]_)(in|ft))$", re.IGNORECASE
)
"""A unit at the end of a name; `elevator_in` is an input."""
_UNITS = {word: unit for unit, words in _SPELLINGS.items() for word in words.split()}
_UNITS |= {unit: unit for units in UNITS.values() for unit in units}


@dataclasses.dataclass(frozen=True)
class Column:
    """One column of a log.

    Attributes:
        values: (n,) as logged; NaN where there is nothing.
        unit: as the file reports it, e.g. "mm"; None if it does not.
        fault: what is wrong with a cell; raised when the column is used.
        epoch: of times in a calendar, what 0 stands for, since 1970 [s].
        labels: the cells (n,), where they are text.
    """

    values: np.ndarray
    unit: str | None = None
    fault: str | None = None
    epoch: float | None = None
    labels: list[str] | None = None


@dataclasses.dataclass(frozen=True)
class Group:
    """Columns that share their rows: a table, a topic, a struct.

    Attributes:
        name: "" where a file has one group only.
        columns: by name.
        time: name of the column of times, where the format has one.
        clock: groups of one clock have the same name here.
        lines: of the rows in a text file; None if rows are counted from 0.
    """

    name: str
    columns: dict[str, Column]
    time: str | None = None
    clock: str = ""
    lines: Sequence[int] | None = None

    @property
    def rows(self) -> int:
        """Number of rows, of the longest column."""
        return max((len(column.values) for column in self.columns.values()), default=0)


Vector = tuple[Group, list[Column]]  # Columns side by side, and their group.


class _Entry(NamedTuple):
    """A column with its address, its name in its group, and the group."""

    address: str
    name: str
    group: Group
    column: Column


@dataclasses.dataclass(frozen=True)
class Recording:
    """One recording as it was logged, in its own names, units and axes.

    Attributes:
        path: of the file; of a part of it, file/part.
        groups: in the order of the file.
        rotation: what the columns of an attitude mean, as in `frame: rotation:`; ""
            where the format leaves it open.
        known: addresses of the quantities whose columns the format itself fixes; these
            are the known columns.
        known_as: what a known column is, for a comment in a MAP.
        axes: those of the known columns, as in `frame: axes:`.
        units: those of known columns that are not in SI, by quantity, as in `units:` of
            a MAP, with a comment that says what to check.
        up: axis that points up in most files of the format; "" where none does.
        unread: why groups could not be read, by their names.
    """

    path: Path
    groups: tuple[Group, ...]
    rotation: str = ""
    known: Mapping[str, str] = dataclasses.field(default_factory=dict)
    known_as: str = ""
    axes: str = ""
    units: Mapping[str, str] = dataclasses.field(default_factory=dict)
    up: str = ""
    unread: Mapping[str, str] = dataclasses.field(default_factory=dict)

    def names(self) -> list[str]:
        """Addresses of all columns."""
        return [entry.address for entry in self._entries()]

    def find(self, address: str, field: str) -> tuple[Group, Column]:
        """Finds a column.

        Args:
            address: of the column, or its name where no other column has it.
            field: that asks for it, for the message.

        Raises:
            InputError: there is none, there are several, or the column has a fault.
        """
        entries = list(self._entries())
        found = [entry for entry in entries if entry.address == address]
        if not found:
            found = [entry for entry in entries if entry.name == address]
        if len(found) == 1:
            [entry] = found
            if entry.column.fault:
                raise InputError(f"{self.path}: {entry.column.fault}")
            return entry.group, entry.column

        names = [entry.address for entry in found or entries]
        hint = self.hint(address)
        listed = ", ".join(names[:12]) + (", ..." if len(names) > 12 else "")
        what = f"there are {len(found)} columns" if found else "there is no column"
        reason = f"{what} '{address}'{hint}; found {listed or 'none'}"
        for name, why in self.unread.items():
            if address.startswith(name):
                reason = f"'{name}' is not read: {why}"
        raise InputError(f"{self.path}: {field}: {reason}.")

    def hint(self, address: str) -> str:
        """The column of the nearest name, as a question in brackets; "" if none is."""
        names = {name.lower(): name for name in self.names()[:_MOST]}
        near = difflib.get_close_matches(address.lower(), names, n=1, cutoff=0.5)
        return f" (did you mean '{names[near[0]]}'?)" if near else ""

    def find_all(
        self, address: str, shapes: Sequence[str]
    ) -> tuple[str, list[str]] | None:
        """Finds the columns of a vector by the beginning that their names share.

        Args:
            address: that beginning, e.g. "Glider.Position". A unit that ends the names
                of the columns is ignored.
            shapes: the axes of a vector, in the order wanted: letters, e.g. "xyz", or
                digits for name[0], name[1], ...

        Returns:
            The first shape whose columns are all there, and their addresses; None if
            there is no such shape.
        """
        known: dict[str, str] = {}
        for entry in self._entries():
            for name in (entry.name, entry.address):
                known[split_suffix(name)[0]] = entry.address
                known[name] = entry.address
        for axes in shapes:
            for spelling in _INDEXED if axes[0].isdigit() else _VECTORS:
                for letters in (axes, axes.upper()):
                    names = [spelling.format(name=address, axis=a) for a in letters]
                    if known.keys() >= set(names):
                        return axes, [known[name] for name in names]
        return None

    def find_each(self, names: Sequence[str], field: str) -> Vector:
        """Finds columns of one group side by side, by their addresses.

        Raises:
            InputError: as of `find`, or if the columns are in different groups.
        """
        found = [self.find(name, field) for name in names]
        group = found[0][0]
        if any(other is not group for other, _ in found):
            raise InputError(
                f"{self.path}: {field}: {', '.join(names)} are in different groups; "
                "expected one with the same times."
            )
        return group, [column for _, column in found]

    def find_times(self, group: Group, named: Any) -> Column | None:
        """Finds the times (n,) of the rows of a group.

        Args:
            group: of n rows.
            named: the name or names that a mapping gives the column of times. It may
                be in another group of the same clock with as many rows.
        """
        names = [named] if isinstance(named, str) else named
        for name in (*names, group.time or ""):
            # A damaged log may lack the column of its format.
            column = group.columns.get(name.removeprefix(f"{group.name}."))
            if column is not None:
                return column
        for address, name, other, column in self._entries():
            is_named = address in names or name in names
            fits = other.clock == group.clock and len(column.values) == group.rows
            if is_named and fits:
                return column
        return None

    def refuse(self, bad: np.ndarray, name: str, expected: str) -> None:
        """Raises InputError about the first bad value (n,) of a column, if any is."""
        if not bad.any():
            return
        i = int(np.argmax(bad))
        group, column = self.find(name, "column")
        row = i if group.lines is None else group.lines[i]
        raise InputError(
            f"{self.path}: column '{name}', row {row}: "
            f"found {show(column.values[i])}; expected {expected}."
        )

    def _entries(self) -> Iterator[_Entry]:
        """Yields all columns, group by group."""
        for group in self.groups:
            prefix = f"{group.name}." if group.name else ""
            for name, column in group.columns.items():
                yield _Entry(prefix + name, name, group, column)


def need(module: str, path: Path) -> ModuleType:
    """Imports a module of a library that reads a file format.

    Raises:
        InputError: the library is not installed; the message says how to install it.
    """
    try:
        return importlib.import_module(module)
    except ImportError:
        raise InputError(
            f"{path}: reading it needs {module.partition('.')[0]}, which is not "
            "installed; pip install 'drake-glider[import]' installs it."
        ) from None


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Scale:
    """A calibration: SI value = gain (logged value - zero)."""

    gain: float = 1.0
    zero: float = 0.0

    def __post_init__(self):
        """Raises InputError where a logged value would be lost."""
        both = [self.gain, self.zero]
        fits = self.gain and all(map(math.isfinite, both))
        expected = "finite numbers, the gain other than 0"
        expect(fits, "units: [gain, zero]", both, expected)


Unit = str | _Scale  # A unit's name, or a calibration.


def spell(text: str) -> str | None:
    """Usual spelling of a unit, e.g. "mm" of "[Millimeters]"; None of other words."""
    word = text.strip(" []()").lower()
    return _UNITS.get(word) or _UNITS.get(word.removesuffix("s"))


def split_suffix(name: str) -> tuple[str, str | None]:
    """A name without the unit that it ends in, and the unit: "x_mm" is x in mm."""
    suffix = _SUFFIX.search(name)
    if suffix is None:
        return name, None
    return name[: suffix.start()], spell(suffix[1])


def scale_of(unit: Unit, kind: str, source: str) -> _Scale:
    """Scale of a unit.

    Args:
        unit: in any spelling, or a calibration.
        kind: of `UNITS` that it must be of.
        source: the entry of a mapping or column that has it, for the message.

    Raises:
        InputError: it is no unit of this kind.
    """
    if isinstance(unit, _Scale):
        return unit
    factors = UNITS[kind]
    spelled = spell(unit)
    if spelled not in factors:
        raise InputError(
            f"{source}: found {show(unit)}; expected one of {', '.join(factors)}, "
            "or {gain: ..., zero: ...} for gain * (logged - zero)."
        )
    return _Scale(gain=factors[spelled])
