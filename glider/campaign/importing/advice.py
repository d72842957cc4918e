"""What to change in a mapping that flights contradict: found by trying it.

One symptom has several causes: an elevator that seems to turn the glider the wrong way
may have the wrong sign or the wrong clock; flights that go straight up, the wrong axis
or a column that is missing. So single changes of the mapping are tried on some of the
recordings. Those that pass all checks of an import are ranked by how well forces and
moments then fit, and the best is advised: the import accepts it by construction.
"""

import contextlib
import dataclasses
import itertools
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from glider.campaign.importing.recording import UNITS, Recording
from glider.campaign.importing.sign_checks import CLEARLY, misfit_in_all
from glider.campaign.settings import AXES, FRAME_CHOICES, QUANTITIES, Mapping
from glider.errors import InputError

_MOST_RECORDINGS = 6  # That changes are tried on.
_MOST_ROWS = 20_000  # Of these: a hundred trials of them take 20 s.
_TRAVEL = 0.5  # Usual travel of an elevator [rad].
_MOST_COLUMNS = 12  # That are tried as y.
ORDERS = ("XYZ", "ZYX", "YZX", "ZXY", "YXZ", "XZY")  # Of Euler angles.
_SCALARS = ("x", "y", "z", "pitch", "elevator", "elevator_rate_command")

Part = dict[str, Any]  # Fields of one part of a mapping and their new values.
Check = Callable[[Sequence[Recording], Mapping], Any]
"""Makes an `ImportResult` of recordings; InputError if they are refused."""


class _Trial(NamedTuple):
    """A change that passes all checks."""

    words: str  # As in a MAP file.
    rows: int  # Of the flights that it makes.
    undecided: int  # Warnings.
    misfit: float  # Of forces and moments.
    unlike: float  # Log of the elevator's travel over a usual one: no misfit has it.


def advise(
    error: InputError, recordings: Sequence[Recording], claim: Mapping, check: Check
) -> InputError:
    """Adds to a refusal which change of the mapping passes all checks, if one does."""
    some = _some(recordings)
    if not some or _try("", claim, some, check) is not None:
        return error  # It is about other recordings.
    trials = []
    for part, fields in _changes(claim, some[0]):
        with contextlib.suppress(InputError):
            changed = _changed(claim, part, fields)
            if changed != claim:
                trials.append(_try(_words(part, fields), changed, some, check))
    trials = [trial for trial in trials if trial is not None]
    most = max((trial.rows for trial in trials), default=0)
    likely = [trial for trial in trials if 2 * trial.rows > most]
    if not likely:
        return error
    best, *others = sorted(likely, key=lambda t: (t.undecided, t.misfit, t.unlike))
    same = best.misfit, best.unlike  # As `up` and `top` may have the same result.
    near = [
        trial.words
        for trial in others
        if trial.misfit < CLEARLY * best.misfit and (trial.misfit, trial.unlike) != same
    ][:1]
    words = " or ".join(f"'{choice}'" for choice in (best.words, *near))
    return InputError(f"{str(error).rstrip('.')}; with {words} it passes all checks.")


def _try(
    words: str, mapping: Mapping, recordings: Sequence[Recording], check: Check
) -> _Trial | None:
    """What a mapping makes of recordings; None where a check refuses it."""
    try:
        imported = check(recordings, mapping)
        misfit = misfit_in_all(imported.campaign)
    except InputError:
        return None
    flights = imported.campaign.flights
    travel = [np.ptp(f.elevator) for f in flights if f.elevator is not None]
    return misfit and _Trial(
        words=words,
        rows=sum(len(flight.time) for flight in flights),
        undecided=len(imported.undecided),
        misfit=round(misfit, 6),
        unlike=abs(round(np.log(max(travel, default=_TRAVEL) / _TRAVEL), 3)),
    )


def _some(recordings: Sequence[Recording]) -> list[Recording]:
    """The first recordings, few enough for many trials; none of a long one."""
    rows = itertools.accumulate(
        max((len(c.values) for g in r.groups for c in g.columns.values()), default=0)
        for r in recordings[:_MOST_RECORDINGS]
    )
    return list(recordings[: sum(count <= _MOST_ROWS for count in rows)])


def _changes(claim: Mapping, log: Recording) -> Iterator[tuple[str, Part]]:
    """Yields single changes of a mapping: the part, and its fields that change."""
    columns, signs = claim.columns, FRAME_CHOICES["elevator"][0]
    yield "clock", {"clock": "find"}
    for kind in (*UNITS, *(name for name in columns if name not in UNITS)):
        for unit in UNITS[QUANTITIES.get(kind, kind)]:
            yield "units", {kind: unit}
    frames: list[Part] = [{"up": up} for up in AXES]
    if any(name.startswith("elevator") for name in columns):
        pairs = itertools.product(signs, repeat=2)
        frames += [{"elevator": own, "command": other} for own, other in pairs]
    if "attitude" in columns or "yaw" in columns:
        pairs = itertools.permutations(AXES, 2)
        frames += [{"nose": nose, "top": top} for nose, top in pairs]
        frames += [{"rotation": order} for order in (*ORDERS, "wxyz", "xyzw")]
    else:
        frames += [{"pitch": pitch} for pitch in FRAME_CHOICES["pitch"][0]]
    if "x" in columns:
        frames += [{"forward": forward} for forward in FRAME_CHOICES["forward"][0]]
    yield from (("frame", frame) for frame in frames)
    if "x" in columns and "y" not in columns:
        group, _ = log.find(str(columns["x"]), "x")
        prefix = f"{group.name}." if group.name else ""
        names = [f"{prefix}{name}" for name in group.columns]
        new = [name for name in names if name not in columns.values()]
        yield from (("columns", {"y": name}) for name in new[:_MOST_COLUMNS])
    for one, other in itertools.combinations([n for n in columns if n in _SCALARS], 2):
        yield "columns", {one: columns[other], other: columns[one]}


def _changed(claim: Mapping, part: str, fields: Part) -> Mapping:
    """The mapping with fields of a part changed; InputError where they exclude one."""
    if part == "clock":
        return dataclasses.replace(claim, **fields)
    if part != "frame":
        return dataclasses.replace(claim, **{part: getattr(claim, part) | fields})
    return dataclasses.replace(claim, frame=dataclasses.replace(claim.frame, **fields))


def _words(part: str, fields: Part) -> str:
    """A change as in a MAP file."""
    listed = ", ".join(f"{name}: {value}" for name, value in fields.items())
    return listed if part == "clock" else f"{part}: {{{listed}}}"
