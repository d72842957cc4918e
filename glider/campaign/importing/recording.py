"""A recording: named columns of numbers, in groups of one clock each; their units.

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
from typing import Any

import numpy as np

from glider.errors import InputError, expect, show

_INDEXED = ("{name}[{axis}]", "{name}{axis}")
_VECTORS = ("{name}.{axis}", "{name}_{axis}", "{name} {axis}", "{name}{axis}")

_MOST = 1000  # Names that are compared with one that is not there.

_DEGREE = math.pi / 180.0
UNITS: dict[str, dict[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "length": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254, "ft": 0.3048},
    "angle": {"rad": 1.0, "deg": _DEGREE},
    "rate": {"rad/s": 1.0, "deg/s": _DEGREE},
}
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
    """One column of a log."""

    values: np.ndarray  #: (n,) as logged; nan where there is nothing.
    unit: str | None = None  #: As the file reports it, e.g. "mm"; None: it does not.
    fault: str | None = None  #: What is wrong with a cell; raised when it is used.
    epoch: float | None = None  #: Of 0 in times of a calendar, since 1970 [s].
    labels: list[str] | None = None  #: The cells, where they are text.


@dataclasses.dataclass(frozen=True)
class Group:
    """Columns that share their rows: a table, a topic, a struct."""

    name: str  #: "" where a file has one.
    columns: dict[str, Column]
    time: str | None = None  #: Name of the column of times, where the format has one.
    clock: str = ""  #: Groups of one clock have the same name here.
    lines: Sequence[int] | None = None  #: Of rows in a text; None: counted from 0.

    @property
    def rows(self) -> int:
        """Number of rows, of the longest column."""
        return max((len(column.values) for column in self.columns.values()), default=0)


Vector = tuple[Group, list[Column]]  # Columns side by side, and their group.


@dataclasses.dataclass(frozen=True)
class Recording:
    """One recording as it was logged, in its own names, units and axes."""

    path: Path  #: Of the file; of a part of it: file/part.
    groups: tuple[Group, ...]
    rotation: str = ""  #: As in `frame: rotation:`; "": the format is open.
    known: Mapping[str, str] = dataclasses.field(default_factory=dict)
    """Addresses of the quantities whose columns the format itself fixes."""
    up: str = ""  #: Axis that points up in most files of the format; "": none does.
    unread: Mapping[str, str] = dataclasses.field(default_factory=dict)
    """Why groups, by name, could not be read."""

    def names(self) -> list[str]:
        """Addresses of all columns: the group's name, a dot, the column's."""
        return [address for address, _, _ in self._all()]

    def find(self, address: str, field: str) -> tuple[Group, Column]:
        """Finds a column by its address or unique name; `field` is for messages."""
        known = list(self._all())
        found = [own for own in known if own[0] == address]
        found = found or [own for own in known if own[0] == f"{own[1].name}.{address}"]
        if len(found) == 1:
            _, group, column = found[0]
            if column.fault:
                raise InputError(f"{self.path}: {column.fault}")
            return group, column
        names = [name for name, _, _ in found or known]
        near = difflib.get_close_matches(address, names[:_MOST], n=1, cutoff=0.5)
        hint = f" (did you mean '{near[0]}'?)" if near else ""
        listed = ", ".join(names[:12]) + (", ..." if len(names) > 12 else "")
        what = f"there are {len(found)} columns" if found else "there is no column"
        reason = f"{what} '{address}'{hint}; found {listed or 'none'}"
        for name, why in self.unread.items():
            if address.startswith(name):
                reason = f"'{name}' is not read: {why}"
        raise InputError(f"{self.path}: {field}: {reason}.")

    def find_all(
        self, address: str, shapes: Sequence[str]
    ) -> tuple[str, list[str]] | None:
        """Finds the axes and columns of a vector by their common name, if it has.

        A shape has the letters of its axes in the order wanted, or digits for name[0],
        name[1]; the first that is there counts.
        """
        known: dict[str, str] = {}
        for full, group, _ in self._all():
            for name in (full.removeprefix(f"{group.name}."), full):
                known |= {split_suffix(name)[0]: full, name: full}
        for axes in shapes:
            for spelling in _INDEXED if axes[0].isdigit() else _VECTORS:
                for letters in (axes, axes.upper()):
                    names = [spelling.format(name=address, axis=a) for a in letters]
                    if known.keys() >= set(names):
                        return axes, [known[name] for name in names]
        return None

    def find_each(self, names: Sequence[str], field: str) -> Vector:
        """Finds columns of one group side by side, by their addresses."""
        groups, columns = zip(*(self.find(name, field) for name in names), strict=True)
        if any(group is not groups[0] for group in groups):
            raise InputError(
                f"{self.path}: {field}: {', '.join(names)} are in different groups; "
                "expected one with the same times."
            )
        return groups[0], list(columns)

    def find_times(self, group: Group, named: Any) -> Column | None:
        """Finds the times of a group's rows, of which there are as many."""
        names = [named] if isinstance(named, str) else named
        for name in (*names, group.time or ""):  # A damaged log may lack it.
            column = group.columns.get(name.removeprefix(f"{group.name}."))
            if column is not None:
                return column
        for address, other, column in self._all():  # Of the same clock.
            fits = other.clock == group.clock and len(column.values) == group.rows
            if fits and {address, address.removeprefix(f"{other.name}.")} & set(names):
                return column
        return None

    def refuse(self, bad: np.ndarray, name: str, expected: str) -> None:
        """Raises InputError about the first bad value (n,) of a column, if any is."""
        for i in np.flatnonzero(bad)[:1]:
            group, column = self.find(name, "column")
            row = i if group.lines is None else group.lines[i]
            raise InputError(
                f"{self.path}: column '{name}', row {row}: "
                f"found {show(column.values[i])}; expected {expected}."
            )

    def _all(self) -> Iterator[tuple[str, Group, Column]]:
        for group in self.groups:
            for name, column in group.columns.items():
                yield (f"{group.name}.{name}" if group.name else name), group, column


def need(module: str, path: Path) -> ModuleType:
    """Imports a library of a file format; InputError that says what to install."""
    try:
        return importlib.import_module(module)
    except ImportError:
        raise InputError(
            f"{path}: reading it needs {module.partition('.')[0]}, which is not "
            "installed; pip install 'drake-glider[import]' installs it."
        ) from None


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Scale:
    """SI value = gain (logged value - zero)."""

    gain: float = 1.0
    zero: float = 0.0

    def __post_init__(self):
        """Raises InputError where a logged value would be lost."""
        both = [self.gain, self.zero]
        numbers = "finite numbers, the gain other than 0"
        fits = self.gain and all(map(math.isfinite, both))
        expect(fits, "units: [gain, zero]", both, numbers)


Unit = str | _Scale  # A unit's name, or a calibration.


def spell(text: str) -> str | None:
    """Usual spelling of a unit, e.g. "mm" of "[Millimeters]"; None of other words."""
    word = text.strip(" []()").lower()
    return _UNITS.get(word) or _UNITS.get(word.removesuffix("s"))


def split_suffix(name: str) -> tuple[str, str | None]:
    """A name without the unit that it ends in, and the unit: "x_mm" is x in mm."""
    suffix = _SUFFIX.search(name)
    return (name[: suffix.start()], spell(suffix[1])) if suffix else (name, None)


def scale_of(unit: Unit, kind: str, source: str) -> _Scale:
    """Scale of a unit of a kind; the source is for the message."""
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
