"""A recording: named columns of numbers, in groups of one clock each."""

import dataclasses
import difflib
import importlib
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np

from glider.errors import InputError

_SPELLINGS = ("{name}.{axis}", "{name}_{axis}", "{name} {axis}", "{name}{axis}")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Column:
    """One column of a log."""

    values: np.ndarray  # (n,) as logged; nan where there is nothing.
    unit: str | None = None  # As the file reports it, e.g. "mm"; None: it does not.
    fault: str | None = None  # What is wrong with a cell; raised when it is used.
    epoch: float | None = (
        None  # Of the value 0, since 1970 [s], for times of a calendar.
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Group:
    """Columns that share their rows: a table, a topic, a struct."""

    name: str  # "" where a file has one.
    columns: dict[str, Column]
    time: str | None = None  # Name of the column of times, where the format has one.
    clock: str = ""  # Groups of one clock have the same name here.


@dataclasses.dataclass(frozen=True, kw_only=True)
class Recording:
    """One recording as it was logged, in its own names, units and axes."""

    path: Path  # Of the file; of a sheet in a workbook: file/sheet.
    groups: tuple[Group, ...]
    rotation: str | None = None
    """Meaning of the file's rotations, as in `frame: rotation:` of a mapping; None
    where the format leaves it open."""

    def names(self) -> list[str]:
        """Addresses of all columns: the group's name, a dot, the column's."""
        return [address for address, _, _ in self._all()]

    def find(self, address: str, field: str) -> tuple[Group, Column]:
        """Finds a column and its group by its address, or by its name if unique.

        The `field` of the mapping that asks is for the message.
        """
        found = [
            (full == address, group, column)
            for full, group, column in self._all()
            if address in (full, full.removeprefix(f"{group.name}."))
        ]
        found = [entry for entry in found if entry[0]] or found
        if len(found) != 1:
            groups = [group.name for _, group, _ in found]
            raise InputError(f"{self.path}: {field}: {self._not_one(address, groups)}")
        _, group, column = found[0]
        if column.fault:
            raise InputError(f"{self.path}: {column.fault}")
        return group, column

    def find_all(
        self, address: str, axes: str, field: str
    ) -> tuple[Group, list[Column]] | None:
        """Finds the columns of a vector by their common name; None where it is none.

        Their axes are letters in the order wanted, or digits for name[0], name[1].
        """
        known = {full for full, _, _ in self._all()}
        known |= {full.removeprefix(f"{g.name}.") for full, g, _ in self._all()}
        spellings = ("{name}[{axis}]",) if axes[0].isdigit() else _SPELLINGS
        for spelling in spellings:
            for letters in (axes, axes.upper()):
                names = [spelling.format(name=address, axis=a) for a in letters]
                if all(name in known for name in names):
                    pairs = [self.find(name, field) for name in names]
                    return pairs[0][0], [column for _, column in pairs]
        return None

    def _all(self) -> Iterator[tuple[str, Group, Column]]:
        for group in self.groups:
            for name, column in group.columns.items():
                yield (f"{group.name}.{name}" if group.name else name), group, column

    def _not_one(self, address: str, groups: list[str]) -> str:
        if groups:
            return (
                f"column '{address}' is in several groups, "
                f"{', '.join(map(repr, groups))}; "
                "expected the group's name, a dot and the column's."
            )
        names = self.names()
        near = difflib.get_close_matches(address, names, n=1, cutoff=0.5)
        hint = f" (did you mean '{near[0]}'?)" if near else ""
        listed = ", ".join(names[:12]) + (", ..." if len(names) > 12 else "")
        return f"there is no column '{address}'{hint}; found {listed or 'none'}."


def need(module: str, path: Path) -> ModuleType:
    """Imports a library of a file format; InputError that says what to install."""
    try:
        return importlib.import_module(module)
    except ImportError:
        raise InputError(
            f"{path}: reading it needs {module.partition('.')[0]}, which is not "
            "installed; pip install 'drake-glider[import]' installs it."
        ) from None
