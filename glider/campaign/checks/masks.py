"""What is excluded: rows by masks, and the sentence that reports it."""

import dataclasses
from collections.abc import Mapping

import numpy as np

from glider.campaign.logs import Campaign, Flight

ALL = "all"  # `ExcludedRows.rows` of a whole flight.


@dataclasses.dataclass(frozen=True)
class ExcludedRows:
    """Rows of a file that are not used, and why."""

    file: str  #: E.g. "flight_003.csv".
    rows: str  #: Lines of the file (the header is line 1), e.g. "41-80", or ALL.
    why: str


@dataclasses.dataclass(frozen=True, kw_only=True)
class Masks:
    """Rows of one flight that are excluded: True where so."""

    pose: np.ndarray  #: (n,) of x, z and pitch.
    elevator: np.ndarray  #: (n,)
    first: int = 0  #: First row of the piece whose commands are known.
    last: int | None = None  #: Row after it; None: that after the flight.

    @property
    def usable(self) -> np.ndarray:
        """Rows (n,) whose pose may be used."""
        return ~self.pose

    @property
    def beyond(self) -> np.ndarray:
        """Rows (n,) of other pieces."""
        beyond = np.ones(len(self.pose), dtype=bool)
        beyond[self.first : self.last] = False
        return beyond


@dataclasses.dataclass(frozen=True, kw_only=True)
class Inspection:
    """A campaign after checks: flights that fly, and rows that count."""

    campaign: Campaign  #: Without the excluded flights.
    masks: dict[str, Masks]  #: Of the flights that are kept, by name.
    excluded: tuple[ExcludedRows, ...]  #: Rows and whole flights, by file.
    warnings: tuple[str, ...]  #: Rates that are off, gaps, ...


def masks_of(flight: Flight, masks: Mapping[str, Masks]) -> Masks:
    """Masks of a flight, by its name; without an entry they exclude nothing."""
    none = np.zeros(len(flight.time), dtype=bool)
    return masks.get(flight.name) or Masks(pose=none, elevator=none.copy())


def stretches(flags: np.ndarray) -> list[tuple[int, int]]:
    """First and last (inclusive) of each run of True in flags (n,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]])))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def find_repeats(values: np.ndarray, least: int) -> np.ndarray:
    """Rows (n,) that repeat the one before, where `least` or more are equal."""
    same = np.all(np.diff(values, axis=0, prepend=np.nan) == 0.0, axis=1)
    repeats = np.zeros(len(same), dtype=bool)
    for first, last in stretches(same):
        repeats[first : last + 1] = last - first + 2 >= least
    return repeats


def name_rows(flags: np.ndarray) -> str:
    """Rows as lines of the file, e.g. "12, 41-80"."""
    parts = [f"{a + 2}" if a == b else f"{a + 2}-{b + 2}" for a, b in stretches(flags)]
    return ", ".join(parts)
