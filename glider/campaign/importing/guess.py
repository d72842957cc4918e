"""`--guess`: a mapping proposed from names, ranges, gravity and the elevator's effect.

Columns are found by their names, units by their names or their ranges. Axes and signs
are tried: of all frames the one is proposed in which the flights fall down at g and
the forces of the air go with the attitude best. Each line of the proposal says why; a
sign that the flights do not tell is left to the user, with a question mark.
"""

import dataclasses
import itertools
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from glider.campaign.checks.clocks import follow_sign
from glider.campaign.checks.frame import usable_motion
from glider.campaign.checks.masks import no_masks
from glider.campaign.importing.campaign_import import ImportResult
from glider.campaign.importing.cutting import cut
from glider.campaign.importing.extraction import (
    CutRecording,
    campaign_of_cuts,
    cut_recordings,
)
from glider.campaign.importing.mapping import QUANTITIES, Mapping
from glider.campaign.importing.readers import read_recordings
from glider.campaign.importing.recording import Recording
from glider.campaign.importing.selection import select
from glider.campaign.importing.sign_checks import (
    SIGNIFICANT,
    elevator_effect,
    misfit_of,
)
from glider.campaign.importing.track import make_track
from glider.campaign.logs import Campaign
from glider.campaign.settings import Settings
from glider.errors import InputError, printable
from glider.files import schema
from glider.physics.parameters import GliderParameters

_NAMES = {
    "time": r"(^|\W)(t|time|zeit|timestamp|secs?|seconds|clock)($|\W)",
    "position": r"pos|transl|point|location|(^|\.)p$",
    "attitude": r"quat|orient|rot|att|eul|(^|\.)q$",
    "x": r"(^|[._])(x|px|pos_?x|north|range|forward)$",
    "z": r"(^|[._])(z|pz|pos_?z|h|height|alt|altitude|down|up)$",
    "pitch": r"pitch|theta|nick",
    "elevator_rate_command": r"(elev|de|servo|delta).*(rate|dot|cmd|command)|"
    r"^(rate|u)$",
    "elevator_angle_command": r"(elev|de|servo|delta).*(cmd|command|set)|control\[1\]",
    "elevator": r"elev|(^|[._])de$|delta_?e|servo|flap|angle",
}
_ULOG = {
    "position": "vehicle_local_position",
    "attitude": "vehicle_attitude.q",
    "elevator_angle_command": "actuator_controls_0.control[1]",
}
_SHAPES = {"attitude": ("xyzw", "0123", "xyz", "012"), "position": ("xyz", "012")}
_RATE = "elevator_rate_command"
_SCALARS = (_RATE, "elevator_angle_command", "time", "x", "z", "pitch", "elevator")
_IS_TIME = re.compile(r"stamp|(^|\W)(time|sec|nsec|seq)($|\W)").search
_STEPS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_SHORTEST_STEP, _LONGEST_STEP = 2e-4, 0.2  # Of logs of poses [s].
_SIGNS = ("", "-")
_AXES = [sign + axis for axis in "xyz" for sign in _SIGNS]
_MAX_TRIED = 4  # Files that frames are tried on.
_MAX_FILES = 12  # Files that are looked into.
_CLEAR = 1.2  # Ratio of misfits to the next best, from which on a frame is told.


@dataclasses.dataclass(frozen=True, kw_only=True)
class Guess:
    """A proposed mapping."""

    text: str  # Of the MAP file, with reasons.
    imported: ImportResult  # What it makes of the logs.


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Trial:
    """A frame that was tried."""

    frame: dict[str, str]
    misfit: float  # Of the forces, gravity given [m/s²].
    campaign: Campaign
    recordings: tuple[CutRecording, ...]


def guess_mapping(files: Sequence[Path]) -> Guess:
    """Returns a mapping for logs.

    Raises:
        InputError: no columns of a pose are found, or no frame makes flights of them.
    """
    raws = [r for f in sorted(files)[:_MAX_FILES] for r in read_recordings(Path(f))]
    seen = [raw for raw in raws if any(g.columns for g in raw.groups)]
    columns, reasons = _guess_columns(seen[0])
    units = _guess_units(seen[0], columns, reasons)
    best, ratio = _best_frame(seen[:_MAX_TRIED], columns, units)
    frame = dict(best.frame)
    frame_why = (
        f"the forces fit {ratio:.2g} times as well as in the next best frame"
        if np.isfinite(ratio) and ratio > _CLEAR
        else "in no other frame they are flights"
        if ratio > _CLEAR
        else f"? another frame fits nearly as well (ratio {ratio:.2f}): check it"
    )
    servo_why = ""
    if best.campaign.elevator == "servo":
        servo_why = _guess_elevator(best.campaign, frame)
    lines = ["# Proposed by --guess: see that each line is right before you use it."]
    lines.append("columns:")
    lines += [f"  {k}: {_quoted(v)}  # {reasons[k]}" for k, v in columns.items()]
    if units:
        lines.append("units:")
        lines += [f"  {k}: {v}  # {reasons[f'units {k}']}" for k, v in units.items()]
    lines.append(f"frame:  # {frame_why}")
    lines += [f"  {k}: {_quoted(v)}" for k, v in frame.items() if k != "elevator"]
    if "elevator" in frame:
        lines.append(f"  elevator: {frame['elevator']}  # {servo_why}")
    lines.append("vehicle:  # what you know: mass, wing_area, ... in kg, m, s")
    if best.campaign.elevator != "servo":
        lines.append("  elevator: fixed  # no column of an elevator was found")
    else:
        lines.append("  elevator_rate_limit: 13.0  # ? rad/s: that of your servo")
    final = _try_frame(seen, columns, units, frame)
    best = final or best
    imported = ImportResult(
        campaign=best.campaign, recordings=best.recordings, undecided=()
    )
    return Guess(
        text="".join(f"{printable(line)}\n" for line in lines), imported=imported
    )


def _guess_elevator(campaign: Campaign, frame: dict[str, str]) -> str:
    """Sets the signs of elevator and command in a frame; returns why."""
    masks = {flight.name: no_masks(flight) for flight in campaign.flights}
    motions = {f.name: usable_motion(f, masks) for f in campaign.flights}
    effect = elevator_effect(campaign, motions)
    up, down = "trailing_edge_up", "trailing_edge_down"
    frame["elevator"] = down if effect > 0.0 else up
    if follow_sign(campaign.flights, masks) < 0:
        frame["command"] = up if effect > 0.0 else down
    if abs(effect) < SIGNIFICANT:
        return "? the flights do not tell it: check it"
    return f"it turns the glider so, by {abs(effect):.0f} standard errors"


def _quoted(value: str) -> str:
    plain = re.fullmatch(r"[A-Za-z/][\w./]*", value)
    return value if plain and value not in ("y", "n") else f'"{value}"'


def _guess_columns(raw: Recording) -> tuple[dict[str, str], dict[str, str]]:
    """Returns columns by quantity, and why each."""
    names = raw.names()
    columns: dict[str, str] = {}
    for quantity, name in _ULOG.items():
        if any(n.startswith(name) for n in names):
            columns[quantity] = name
    if len(columns) == len(_ULOG):
        return columns, dict.fromkeys(columns, "PX4's topic")
    columns = {}
    stems = list(dict.fromkeys(_stems(names)))
    for quantity, shapes in _SHAPES.items():
        fits = [
            stem
            for stem in stems
            if re.search(_NAMES[quantity], stem, re.IGNORECASE)
            and any(raw.find_all(stem, axes, quantity) for axes in shapes)
        ]
        owner = columns.get("attitude", "").rpartition(".")[0]
        own = [stem for stem in fits if owner and stem.startswith(f"{owner}.")]
        if fits:
            columns[quantity] = _most_alive(raw, own or fits)
    for quantity in _SCALARS:
        is_there = (
            (quantity in ("x", "z") and "position" in columns)
            or (quantity == "pitch" and "attitude" in columns)
            or (quantity == "elevator_angle_command" and _RATE in columns)
            or (quantity == "time" and any(g.time for g in raw.groups))
        )
        taken = tuple(columns.values())
        free = [n for n in names if not (n.startswith(taken) or _IS_TIME(n))]
        free = names if quantity == "time" else free
        for name in [] if is_there else free:
            own_name = name.rpartition(".")[2]
            if re.search(_NAMES[quantity], own_name, re.IGNORECASE):
                columns[quantity] = name
                break
    has_place = "position" in columns or {"x", "z"} <= set(columns)
    if not (has_place and {"attitude", "pitch"} & set(columns)):
        listed = ", ".join(names[:20]) + (", ..." if len(names) > 20 else "")
        raise InputError(
            f"{raw.path}: no columns of a position and an attitude were recognized by "
            f"their names in {listed}; write the mapping by hand."
        )
    ordered = {q: columns[q] for q in QUANTITIES if q in columns}
    return ordered, dict.fromkeys(ordered, "by its name")


def _stems(names: Sequence[str]) -> Iterator[str]:
    """Yields what may be the common name of a vector's columns."""
    for name in names:
        match = re.fullmatch(r"(.+?)(\[0\]|[._ ]?[xX])", name)
        if match:
            yield match[1]


def _most_alive(raw: Recording, stems: Sequence[str]) -> str:
    """Returns the vector that moves most: the glider, not the wand on the floor."""

    def travel(stem: str) -> float:
        for axes in ("xyz", "012"):
            found = raw.find_all(stem, axes, stem)
            if found:
                values = np.stack([c.values for c in found[1]])
                steps = np.abs(np.diff(values, axis=1))
                return float(np.nansum(steps)) if np.isfinite(steps).any() else -1.0
        return -1.0

    return max(stems, key=travel)


def _guess_units(
    raw: Recording, columns: dict[str, str], reasons: dict[str, str]
) -> dict[str, str]:
    """Returns units that the file does not tell, by the ranges of the columns."""
    units: dict[str, str] = {}
    if "time" in columns:
        _, column = raw.find(columns["time"], "time")
        step = float(np.nanmedian(np.diff(column.values)))
        if column.unit is None and not _LONGEST_STEP > step > _SHORTEST_STEP:
            fits = [
                unit
                for unit, size in _STEPS.items()
                if _SHORTEST_STEP < step * size < _LONGEST_STEP
            ]
            if fits:
                units["time"] = fits[0]
                reasons["units time"] = f"its median step is {step:.4g}"
    ranges = (
        ("position", "length", 100.0, "mm"),
        ("x", "length", 100.0, "mm"),
        ("pitch", "angle", 2.0 * np.pi, "deg"),
        ("attitude", "angle", 2.0 * np.pi, "deg"),
        ("elevator", "angle", 2.0 * np.pi, "deg"),
        (_RATE, "rate", 50.0, "deg/s"),
    )
    for quantity, kind, most, other in ranges:
        values, unit = _values(raw, columns.get(quantity))
        if values is None or unit is not None:
            continue
        reach = float(np.nanmax(np.abs(values)))
        if reach > most:
            units[kind] = other
            reasons[f"units {kind}"] = f"'{quantity}' reaches {reach:.4g}"
    return units


def _values(raw: Recording, name: str | None) -> tuple[np.ndarray | None, str | None]:
    if name is None:
        return None, None
    for axes in ("xyz", "012"):
        found = raw.find_all(name, axes, name)
        if found:
            return np.stack([c.values for c in found[1]]), found[1][0].unit
    _, column = raw.find(name, name)
    return column.values, column.unit


def _best_frame(
    raws: Sequence[Recording], columns: dict[str, str], units: dict[str, str]
) -> tuple[_Trial, float]:
    """Returns the frame with the least misfit, and the ratio to the next best."""
    spatial = "position" in columns
    frames = _planar_frames() if not spatial else _frames(raws, columns, units)
    trials = [
        trial
        for frame in frames
        if (trial := _try_frame(raws, columns, units, frame)) is not None
    ]
    if not trials:
        raise InputError(
            f"{raws[0].path}: in no frame the columns {', '.join(columns.values())} "
            "make flights; write the mapping by hand."
        )
    most = max(_rows(trial) for trial in trials)
    trials = [trial for trial in trials if 2 * _rows(trial) > most]
    trials.sort(key=lambda trial: trial.misfit)
    ratios = [trial.misfit / trials[0].misfit for trial in trials[1:]]
    return trials[0], min(ratios, default=np.inf)


def _rows(trial: _Trial) -> int:
    return sum(len(flight.time) for flight in trial.campaign.flights)


def _planar_frames() -> Iterator[dict[str, str]]:
    """Yields the frames of x and z."""
    for up, forward, pitch in itertools.product(
        _SIGNS, _SIGNS, ("nose_down", "nose_up")
    ):
        yield {"up": f"{up}z", "forward": f"{forward}x", "pitch": pitch}


def _frames(
    raws: Sequence[Recording], columns: dict[str, str], units: dict[str, str]
) -> Iterator[dict[str, str]]:
    """Yields a frame for each axis that may point up and each way to read rotations.

    The nose is where the body's axes point that the flights go along, and its top that
    which is up then.
    """
    if "attitude" not in columns:
        for up, pitch in itertools.product(_AXES, ("nose_down", "nose_up")):
            yield {"up": up, "pitch": pitch}
        return
    four = raws[0].find_all(columns["attitude"], "xyzw", "attitude")
    three = any(
        raws[0].find_all(columns["attitude"], axes, "attitude")
        for axes in ("xyz", "012")
    )
    readings: tuple[str, ...] = ("",)
    if not four and raws[0].rotation is None:
        readings = ("ZYX", "XYZ") if three else ("wxyz", "xyzw")
    for up, reading in itertools.product(_AXES, readings):
        frame = {"up": up} | ({"rotation": reading} if reading else {})
        claim = _claim(columns, units, frame)
        ahead, above = [], []
        for raw in raws:
            track = make_track(select(raw, claim), claim.frame, claim.source)
            for found in cut(track, GliderParameters().gravity)[0]:
                turns = found.track.rotation
                if turns is None:
                    continue
                way = np.diff(found.track.position, axis=0)
                ahead.append(np.einsum("ni,nij->j", way, turns[1:]))
                above.append(np.mean(turns[:, 2], axis=0))
        if not ahead:
            continue
        nose = _axis_of(np.sum(ahead, axis=0), "")
        yield frame | {"nose": nose, "top": _axis_of(np.mean(above, axis=0), nose)}


def _axis_of(direction: np.ndarray, other: str) -> str:
    """Returns the axis nearest to a direction (3,), not along another axis."""
    sizes = np.abs(direction)
    if other:
        sizes["xyz".index(other[-1])] = -1.0
    k = int(np.argmax(sizes))
    return ("-" if direction[k] < 0.0 else "") + "xyz"[k]


def _claim(
    columns: dict[str, str], units: dict[str, str], frame: dict[str, str]
) -> Mapping:
    fields = {"columns": columns, "units": units, "frame": frame}
    claim = schema.convert(fields, Settings, "the guess").mapping("the guess")
    assert claim is not None
    return claim


def _try_frame(
    raws: Sequence[Recording],
    columns: dict[str, str],
    units: dict[str, str],
    frame: dict[str, str],
) -> _Trial | None:
    """Returns what a frame makes of the logs; None where it makes no flights."""
    servo = any(name.startswith("elevator") for name in columns)
    settings = Campaign(
        name="guess",
        path=Path("guess"),
        vehicle={},
        elevator="servo" if servo else "fixed",
        elevator_limits=None,
        elevator_rate_limit=13.0 if servo else None,
        pose_rate=np.nan,
        command_rate=None,
        flights=(),
    )
    claim = _claim(columns, units, frame)
    try:
        recordings = cut_recordings(raws, claim, settings)
        if not any(recording.flights for recording in recordings):
            return None
        campaign = campaign_of_cuts(settings, recordings)
        misfit = misfit_of(campaign)
    except InputError:
        return None
    if misfit is None:
        return None
    return _Trial(frame=frame, misfit=misfit, campaign=campaign, recordings=recordings)
