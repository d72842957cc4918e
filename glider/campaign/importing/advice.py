"""What to change in a mapping that flights contradict: found by trying it.

One symptom has several causes: an elevator that seems to turn the glider the wrong way
may have the wrong sign or the wrong clock. So changes of one entry of the mapping go
through the import itself, and those that pass all its checks are advised, the ones
with which forces and moments fit best.
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
    """A change that passes all checks; the likelier of two is the lesser."""

    warnings: int
    misfit: float  #: Of forces and moments.
    words: str


def advise(
    error: InputError,
    recordings: Sequence[Recording],
    claim: ColumnMapping,
    run: _Import,
) -> InputError:
    """Adds to a refusal which changes of the mapping pass all checks, if any do."""
    some = recordings[:_MOST_RECORDINGS]
    longest = [max(group.rows for group in own.groups) for own in some]
    if sum(longest) > _MOST_ROWS:
        return error
    passed = []
    for part, value in _changes(claim, some[0]):
        with contextlib.suppress(InputError):
            result = run(some, _changed(claim, part, value))
            own = yaml.safe_dump({part: value}, default_flow_style=True, width=999)
            misfit = round(calc_misfit(result.campaign), 6)
            passed.append(_Passed(len(result.warnings), misfit, own.strip()[1:-1]))
    # Of two changes with the same result, as `up` and `top`, the first is enough.
    likely = {trial[:2]: trial for trial in sorted(passed, reverse=True)}
    best = sorted(likely.values())[:2]
    as_good = [t for t in best if t.misfit < _AS_GOOD * best[0].misfit]
    words = " or ".join(f"'{trial.words}'" for trial in as_good)
    if not words:
        return error
    return InputError(f"{str(error).rstrip('.')}; with {words} it passes all checks.")


def _changes(claim: ColumnMapping, log: Recording) -> Iterator[tuple[str, Any]]:
    """Yields changes of one entry of a mapping: its part, and the new fields."""
    columns = claim.columns
    yield "clock", "find"
    angles = [name for name in columns if QUANTITIES.get(name) == "angle"]
    for name in ("length", "time", "angle", "rate", *angles):
        for unit in UNITS[QUANTITIES.get(name, name)]:
            yield "units", {name: unit}
    if "elevator_rate_command" in columns:
        for unit in UNITS["angle"]:
            both = {"elevator": unit, "elevator_rate_command": f"{unit}/s"}
            yield "units", both
    signs = FRAME_CHOICES["elevator"][0]
    frames = [{"elevator": e, "command": c} for e in signs for c in signs]
    for name in ("up", "forward", "pitch"):
        frames += [{name: value} for value in FRAME_CHOICES[name][0]]
    if "attitude" in columns or "yaw" in columns:
        axes = itertools.permutations(AXES, 2)
        frames += [{"nose": nose, "top": top} for nose, top in axes]
        frames += [{"rotation": order} for order in (*ORDERS, "wxyz", "xyzw")]
    yield from (("frame", frame) for frame in frames)
    if "x" in columns and "y" not in columns:
        others = {name for group in log.groups for name in group.columns}
        unused = sorted(others.difference(map(str, columns.values())))
        yield from (("columns", {"y": name}) for name in unused)
    if {"x", "z"} <= columns.keys():
        yield "columns", {"x": columns["z"], "z": columns["x"]}


def _changed(claim: ColumnMapping, part: str, value: Any) -> ColumnMapping:
    """The mapping with a part changed; InputError where its fields exclude another."""
    if part == "frame":
        value = dataclasses.replace(claim.frame, **value)
    elif part != "clock":
        value = getattr(claim, part) | value
    return dataclasses.replace(claim, **{part: value})
