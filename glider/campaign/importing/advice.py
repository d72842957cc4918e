"""What to change in a mapping that flights contradict: found by trying it.

One symptom has several causes: an elevator that seems to turn the glider the wrong way
may have the wrong sign or the wrong clock; flights that go straight up, the wrong axis
or a column that is missing. So single changes of the mapping are tried on some of the
recordings. Those that pass all checks of an import are ranked by how well forces and
moments then fit, and the best is advised: the import accepts it by construction. Where
none passes, there may be two errors: changes are tried beside the one that fits best.
"""

import contextlib
import dataclasses
import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import yaml

from glider.campaign.importing.recording import UNITS, Recording, Scale, scale_of
from glider.campaign.importing.sign_checks import CLEARLY, MIN_FLIGHTS, misfit_of
from glider.campaign.logs import Campaign
from glider.campaign.settings import AXES, FRAME_CHOICES, QUANTITIES, Mapping
from glider.errors import InputError

_MOST_RECORDINGS = 6  # That changes are tried on.
_MOST_ROWS = 20_000  # Of these: a hundred trials of them take 20 s.
_MOST_COLUMNS = 12  # That are tried as y.
_STARTS = 2  # Changes, those that fit best, beside which others are tried.
ORDERS = ("XYZ", "ZYX", "YZX", "ZXY", "YXZ", "XZY")  # Of Euler angles.
_SCALARS = ("x", "y", "z", "roll", "pitch", "yaw", "elevator", "elevator_rate_command")

Change = dict[str, Any]  # Parts of a mapping, with a new value or new fields.
Made = tuple[Campaign, Callable[[], Any]]
"""A campaign, and what makes an `ImportResult` of it, or refuses it."""

Make = Callable[[Sequence[Recording], Mapping], Made]  # InputError without flights.


class _Trial(NamedTuple):
    """What a change makes of recordings."""

    fails: bool  #: Whether a check refuses it.
    undecided: int  #: Warnings.
    exchanges: bool  #: Whether columns are exchanged: other changes are likelier.
    misfit: float  #: Of forces and moments.
    rows: int  #: Of the flights.
    change: Change
    mapping: Mapping


def advise(
    error: InputError, recordings: Sequence[Recording], claim: Mapping, make: Make
) -> InputError:
    """Adds to a refusal which changes of the mapping pass all checks, if any do."""
    some = _some(recordings)
    if not some or ((own := _try({}, claim, some, make)) and not own.fails):
        return error  # It is about other recordings.
    advised, failed = _search({}, claim, recordings, make)
    for first in failed[:_STARTS]:
        if not advised and first.misfit < CLEARLY * failed[0].misfit:
            advised, _ = _search(first.change, first.mapping, recordings, make)
    if not advised:
        return error
    near = [t.change for t in advised if t.misfit < CLEARLY * advised[0].misfit]
    texts = (yaml.safe_dump(c, default_flow_style=True, width=999) for c in near)
    words = " or ".join(f"'{text.strip()[1:-1]}'" for text in texts)
    return InputError(f"{str(error).rstrip('.')}; with {words} it passes all checks.")


def _search(
    first: Change, claim: Mapping, recordings: Sequence[Recording], make: Make
) -> tuple[list[_Trial], list[_Trial]]:
    """Tries changes beside a first one; the best two that pass, and those that fail."""
    trials = []
    some = _some(recordings)
    for part, value in _changes(claim, some[0]):
        with contextlib.suppress(InputError):
            if (changed := _changed(claim, part, value)) != claim:
                fields = isinstance(value, dict)
                new = first.get(part, {}) | value if fields else value
                trials.append(_try({**first, part: new}, changed, some, make))
    made = sorted(filter(None, trials), key=lambda trial: trial[:5])
    most = max((trial.rows for trial in made), default=0)
    full = [trial for trial in made if 2 * trial.rows > most]
    # `up` and `top` may have the same result: only another one is a rival.
    sure = (t for t in full if not t.fails and not (first and t.undecided))
    likely = {t[:4]: t for t in reversed(list(sure))}.values()
    # Few flights may not show what is wrong.
    every = (_try(t.change, t.mapping, recordings, make) for t in reversed(likely))
    passed = itertools.islice((t for t in every if t and not t.fails), 2)
    failed = sorted((t for t in full if t.fails), key=lambda trial: trial.misfit)
    return list(passed), failed


def _try(
    change: Change, mapping: Mapping, recordings: Sequence[Recording], make: Make
) -> _Trial | None:
    """What a mapping makes of recordings; None where that is no campaign."""
    with contextlib.suppress(InputError):
        campaign, check = make(recordings, mapping)
        fails = True
        doubts = 0
        exchanges = "columns" in change
        with contextlib.suppress(InputError):
            doubts = len(check().undecided)
            fails = False
        misfit = round(misfit_of(campaign), 6)
        rows = sum(len(flight.time) for flight in campaign.flights)
        if len(campaign.flights) >= MIN_FLIGHTS:
            return _Trial(fails, doubts, exchanges, misfit, rows, change, mapping)
    return None


def _some(recordings: Sequence[Recording]) -> list[Recording]:
    """The first recordings, few enough for many trials; none of a long one."""
    rows = itertools.accumulate(
        max((len(c.values) for g in r.groups for c in g.columns.values()), default=0)
        for r in recordings[:_MOST_RECORDINGS]
    )
    return list(recordings[: sum(count <= _MOST_ROWS for count in rows)])


def _changes(claim: Mapping, log: Recording) -> Iterator[tuple[str, Any]]:
    """Yields single changes of a mapping: a part, and its new value or fields."""
    columns = claim.columns
    signs = FRAME_CHOICES["elevator"][0]
    yield "clock", "find"
    angles = [name for name in columns if QUANTITIES[name] == "angle"]
    for name in ("length", "time", "angle", "rate", *angles):
        for unit in UNITS[QUANTITIES.get(name, name)]:
            yield "units", {name: unit}
    if "elevator" in angles and "elevator_rate_command" in columns:
        pairs = ("angle", "rate"), ("elevator", "elevator_rate_command")
        for (angle, rate), unit in itertools.product(pairs, UNITS["angle"]):
            yield "units", {angle: unit, rate: f"{unit}/s"}
    if "pitch" in angles and "yaw" not in angles:  # Off by half a turn.
        _, pitch = log.find(str(columns["pitch"]), "pitch")
        logged = claim.units.get("pitch", claim.units.get("angle", pitch.unit or "rad"))
        gain, zero = dataclasses.astuple(scale_of(logged, "angle", claim.source))
        scale = {"gain": round(gain, 12), "zero": round(zero + math.pi / gain, 9)}
        yield "units", {"pitch": scale}
    frames: list[dict[str, str]] = [{"up": up} for up in AXES]
    if any(name.startswith("elevator") for name in columns):
        frames += [{"elevator": e, "command": c} for e in signs for c in signs]
    if "attitude" in columns or "yaw" in columns:
        axes = itertools.permutations(AXES, 2)
        frames += [{"nose": nose, "top": top} for nose, top in axes]
        frames += [{"rotation": order} for order in (*ORDERS, "wxyz", "xyzw")]
    if "pitch" in columns or "attitude" in columns:
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


def _changed(claim: Mapping, part: str, value: Any) -> Mapping:
    """The mapping with a part changed; InputError where its fields exclude another."""
    if part == "frame":
        value = dataclasses.replace(claim.frame, **value)
    elif part == "units":
        read = {k: Scale(**u) if isinstance(u, dict) else u for k, u in value.items()}
        value = claim.units | read
    elif part != "clock":
        value = getattr(claim, part) | value
    return dataclasses.replace(claim, **{part: value})
