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

_VECTORS = ("{name}.{axis}", "{name}_{axis}", "{name} {axis}", "{name}{axis}")

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


Vector = tuple[Group, list[Column]]  # Columns side by side, and their group.


@dataclasses.dataclass(frozen=True)
class Recording:
    """One recording as it was logged, in its own names, units and axes."""

    path: Path  #: Of the file; of a part of it: file/part.
    groups: tuple[Group, ...]
    rotation: str | None = None  #: As in `frame: rotation:`; None: the format is open.
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
        found = [(group, column) for full, group, column in known if full == address]
        found = found or [(g, c) for n, g, c in known if f"{g.name}.{address}" == n]
        source = f"{self.path}: {field}"
        if len(found) > 1:
            groups = ", ".join(repr(group.name) for group, _ in found)
            raise InputError(
                f"{source}: column '{address}' is in several groups, {groups}; "
                "expected the group's name, a dot and the column's."
            )
        for name, why in self.unread.items() if not found else ():
            if address.startswith(name):
                raise InputError(f"{source}: '{name}' is not read: {why}.")
        if not found:
            names = self.names()
            near = difflib.get_close_matches(address, names, n=1, cutoff=0.5)
            hint = f" (did you mean '{near[0]}'?)" if near else ""
            listed = ", ".join(names[:12]) + (", ..." if len(names) > 12 else "")
            raise InputError(
                f"{source}: there is no column '{address}'{hint}; "
                f"found {listed or 'none'}."
            )
        group, column = found[0]
        if column.fault:
            raise InputError(f"{self.path}: {column.fault}")
        return group, column

    def find_all(self, address: str, axes: str, field: str) -> Vector | None:
        """Finds the columns of a vector by their common name; None where it is none.

        Their axes are letters in the order wanted, or digits for name[0], name[1].
        """
        known = {full.removeprefix(f"{g.name}."): full for full, g, _ in self._all()}
        known |= {full: full for full in self.names()}
        known = {split_suffix(name)[0]: full for name, full in known.items()} | known
        spellings = ("{name}[{axis}]", "{name}{axis}")
        for spelling in spellings if axes[0].isdigit() else _VECTORS:
            for letters in (axes, axes.upper()):
                names = [spelling.format(name=address, axis=a) for a in letters]
                if all(name in known for name in names):
                    return self.find_each([known[name] for name in names], field)
        return None

    def find_each(self, names: Sequence[str], field: str) -> Vector:
        """Finds columns side by side, by their addresses."""
        pairs = [self.find(name, field) for name in names]
        return pairs[0][0], [column for _, column in pairs]

    def find_times(self, group: Group, named: Any, rows: int) -> Column | None:
        """Finds the times of a group's rows, of which there are as many."""
        names = [named] if isinstance(named, str) else named
        for name in names:
            column = group.columns.get(name.removeprefix(f"{group.name}."))
            if column is not None:
                return column
        if group.time in group.columns:  # A damaged log may lack it.
            return group.columns[group.time]
        for other in self.groups:  # Of the same clock, with as many rows.
            for name, column in other.columns.items():
                fits = other.clock == group.clock and len(column.values) == rows
                if fits and {name, f"{other.name}.{name}"} & set(names):
                    return column
        return None

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
