"""Rows that are excluded: as masks for the fits, and as sentences for the report.

`Masks` marks the pose and the elevator of a flight apart, because the pose remains
usable where only the elevator is faulty. `ExcludedRows` names the rows as an editor
numbers the lines of the file: the header is line 1, so that row 0 is line 2.
"""

import dataclasses
from collections.abc import Mapping

import numpy as np

from glider.campaign.logs import Campaign, Flight

ALL = "all"  # `ExcludedRows.rows` of a whole flight.


@dataclasses.dataclass(frozen=True)
class ExcludedRows:
    """Rows of a file that are not used, and why.

    Attributes:
        file: name of the flight, e.g. "flight_003.csv".
        rows: lines of the file, e.g. "12, 41-80", or ALL.
        why: the reason, as the report prints it.
    """

    file: str
    rows: str
    why: str


@dataclasses.dataclass(frozen=True, kw_only=True)
class Masks:
    """Rows of one flight of n rows that are excluded.

    A gap in the log hides commands. It cuts the flight into pieces, of which the one
    with most rows is used wherever the servo matters.

    Attributes:
        pose: (n,) True where x, z and pitch are excluded.
        elevator: (n,) True where the measured elevator is excluded.
        first: first row of the piece that is used.
        last: row after the end of that piece; None: the end of the flight.
    """

    pose: np.ndarray
    elevator: np.ndarray
    first: int = 0
    last: int | None = None

    @property
    def usable(self) -> np.ndarray:
        """True in rows (n,) whose pose may be used."""
        return ~self.pose

    @property
    def beyond(self) -> np.ndarray:
        """True in rows (n,) of the other pieces."""
        beyond = np.ones(len(self.pose), dtype=bool)
        beyond[self.first : self.last] = False
        return beyond


@dataclasses.dataclass(frozen=True, kw_only=True)
class Inspection:
    """What the checks leave of a campaign.

    Attributes:
        campaign: the campaign without the excluded flights.
        masks: of the remaining flights, by name.
        excluded: rows and whole flights that are excluded.
        warnings: sentences on doubtful rates, gaps, scales and the like.
    """

    campaign: Campaign
    masks: dict[str, Masks]
    excluded: tuple[ExcludedRows, ...]
    warnings: tuple[str, ...]


def masks_of(flight: Flight, masks: Mapping[str, Masks]) -> Masks:
    """Masks of a flight, by its name; without an entry they exclude nothing."""
    none = np.zeros(len(flight.time), dtype=bool)
    return masks.get(flight.name, Masks(pose=none, elevator=none.copy()))


def stretches(flags: np.ndarray) -> list[tuple[int, int]]:
    """First and last (inclusive) row of each run of True in flags (n,)."""
    changes = np.diff(np.pad(flags.astype(int), 1))  # -1 in the row after a run.
    firsts = np.flatnonzero(changes == 1)
    lasts = np.flatnonzero(changes == -1) - 1
    return list(zip(firsts.tolist(), lasts.tolist(), strict=True))


def find_repeats(values: np.ndarray, least: int) -> np.ndarray:
    """Finds rows that equal the row before.

    Args:
        values: (n, k), a NaN equals nothing.
        least: number of equal rows, the first one included, below which they pass.

    Returns:
        (n,) True in all equal rows but the first.
    """
    steps = np.diff(values, axis=0, prepend=np.nan)
    is_repeat = np.all(steps == 0.0, axis=1)
    found = np.zeros(len(values), dtype=bool)
    for first, last in stretches(is_repeat):
        equal_rows = last - first + 2
        found[first : last + 1] = equal_rows >= least
    return found


def name_rows(flags: np.ndarray) -> str:
    """Lines of the file of rows that are True (n,), e.g. "12, 41-80"."""
    parts = []
    for first, last in stretches(flags):
        part = f"{first + 2}"
        if last > first:
            part += f"-{last + 2}"
        parts.append(part)
    return ", ".join(parts)
