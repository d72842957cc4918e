"""Advice on a mapping that its flights contradict: which changes of it would pass.

One symptom has several causes: an elevator that seems to turn the glider the wrong way
may have the wrong sign or the wrong clock. So the import is run again with one entry of
the mapping changed, for each plausible change in turn. Of the changes that pass all
checks those are advised with which forces and moments fit best.
"""

import contextlib
import dataclasses
import itertools
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import yaml

from glider.campaign.checks.frame import calc_misfit
from glider.campaign.importing.recording import UNITS, Recording
from glider.campaign.settings import AXES, FRAME_CHOICES, QUANTITIES, ColumnMapping
from glider.errors import InputError

_MOST_RECORDINGS = 6  # That changes are tried on.
_MOST_ROWS = 20_000  # Of these: a hundred trials of them take 20 s.
_AS_GOOD = 1.2  # Ratio of misfits below which two changes fit as well.
ORDERS = ("XYZ", "ZYX", "YZX", "ZXY", "YXZ", "XZY")  # Of Euler angles.

_Import = Callable[[Sequence[Recording], ColumnMapping], Any]
"""From recordings and a mapping to an ImportResult; InputError if refused."""


class _Passed(NamedTuple):
    """A change that passes all checks; the likelier of two is the lesser.

    Attributes:
        warnings: number of warnings that the import gives with it.
        misfit: of forces and moments with it, see `calc_misfit`.
        words: the changed entry as the user would write it, e.g. "frame: {up: y}".
    """

    warnings: int
    misfit: float
    words: str


def advise(
    error: InputError,
    recordings: Sequence[Recording],
    claim: ColumnMapping,
    run: _Import,
) -> InputError:
    """Adds to a refusal which changes of the mapping pass all checks.

    Two changes are named if the second fits about as well as the first.

    Args:
        error: the refusal of the mapping as it is.
        recordings: the logs; changes are tried on the first few.
        claim: the mapping that is refused.
        run: the import, with all its checks.

    Returns:
        The error with advice; as it is where no change passes, or where the recordings
        are too long to try a hundred changes on them.
    """
    some = recordings[:_MOST_RECORDINGS]
    rows = [max(group.rows for group in recording.groups) for recording in some]
    if sum(rows) > _MOST_ROWS:
        return error

    passed = []
    for part, value in _changes(claim, some[0]):
        with contextlib.suppress(InputError):
            result = run(some, _changed(claim, part, value))
            misfit = round(calc_misfit(result.campaign), 6)
            entry = yaml.safe_dump({part: value}, default_flow_style=True, width=999)
            words = entry.strip()[1:-1]  # Without the outer braces.
            passed.append(_Passed(len(result.warnings), misfit, words))

    # Of several changes with the same result, as `up` and `top`, one is enough.
    groups = itertools.groupby(sorted(passed), key=lambda change: change[:2])
    best = [next(group) for _, group in groups][:2]
    as_good = [own for own in best if own.misfit < _AS_GOOD * best[0].misfit]
    if not as_good:
        return error
    words = " or ".join(f"'{change.words}'" for change in as_good)
    return InputError(f"{str(error).rstrip('.')}; with {words} it passes all checks.")


def _changes(claim: ColumnMapping, log: Recording) -> Iterator[tuple[str, Any]]:
    """Yields changes of one entry of a mapping: its part, and the new fields."""
    columns = claim.columns
    yield "clock", "find"

    # Each unit for all quantities of a kind, then for each angle alone.
    for kind, units in UNITS.items():
        for unit in units:
            yield "units", {kind: unit}
    for unit in UNITS["angle"]:
        for name in columns:
            if QUANTITIES.get(name) == "angle":
                yield "units", {name: unit}
        if "elevator_rate_command" in columns:
            both = {"elevator": unit, "elevator_rate_command": f"{unit}/s"}
            yield "units", both

    # Signs, axes, and readings of a rotation where one is logged.
    signs, _ = FRAME_CHOICES["elevator"]
    for elevator, command in itertools.product(signs, signs):
        yield "frame", {"elevator": elevator, "command": command}
    for name in ("up", "forward", "pitch"):
        for value in FRAME_CHOICES[name][0]:
            yield "frame", {name: value}
    if "attitude" in columns or "yaw" in columns:
        for nose, top in itertools.permutations(AXES, 2):
            yield "frame", {"nose": nose, "top": top}
        for order in (*ORDERS, "wxyz", "xyzw"):
            yield "frame", {"rotation": order}

    # An unused column as the y that is not mapped; x and z exchanged.
    if "x" in columns and "y" not in columns:
        names = {name for group in log.groups for name in group.columns}
        for name in sorted(names.difference(map(str, columns.values()))):
            yield "columns", {"y": name}
    if {"x", "z"} <= columns.keys():
        yield "columns", {"x": columns["z"], "z": columns["x"]}


def _changed(claim: ColumnMapping, part: str, value: Any) -> ColumnMapping:
    """Returns the mapping with a part changed.

    Raises:
        InputError: the new fields contradict others of the mapping.
    """
    if part == "frame":
        value = dataclasses.replace(claim.frame, **value)
    elif part != "clock":
        value = getattr(claim, part) | value
    return dataclasses.replace(claim, **{part: value})
