"""`--guess`: a mapping proposed from names, ranges, gravity and the elevator's effect.

Columns are found by their names, units by their names or ranges. The frame is the most
probable one (`frame_posterior`); what is not certain is left to the user, with a
question mark, the next best frame and what distinguishes both.
"""

import contextlib
import json
import math
import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml

from glider.campaign.checks.forces import fit_elevator, measure_motions
from glider.campaign.checks.frame import SIGNIFICANT
from glider.campaign.checks.servo import follow_sign, measure_elevators
from glider.campaign.checks.signs import check_signs
from glider.campaign.importing.campaign_import import cut_recordings
from glider.campaign.importing.frame_posterior import rank_frames
from glider.campaign.importing.joining import as_files, read_logs
from glider.campaign.importing.readers import read_recordings
from glider.campaign.importing.recording import UNITS, Recording, split_suffix
from glider.campaign.importing.splitting import split_flights
from glider.campaign.logs import Campaign
from glider.campaign.settings import (
    EULER,
    INSTEAD,
    QUANTITIES,
    SHAPES,
    ColumnMapping,
    Settings,
    Vehicle,
)
from glider.errors import InputError, printable
from glider.files import schema
from glider.progress import silent

_ELEVATOR = r"elev|(^|_)de(_|$)|delta|servo|h(ö|oe|o)hen|ruder|prof[ou]nd|flap|joint"
_COMMAND = r"cmd|command|soll|setp|(^|_)(set|sp|ref)(_|$)|consigne|kommando|comando"
_IS_RATE = r"rate|dot|vel|d(e)?g?ps|geschw|vitesse"
_RATE = "elevator_rate_command"
_ANGLE = "elevator_angle_command"
_NAMES = {  # What names contain, in lower case, words parted by _, without units.
    "time": r"(^|_)(ts?|time|zeit|timestamp|secs?|seconds|clock|temps|tiempo|tempo)"
    r"(_|$)",
    "position": r"pos|transl|point|location|(^|\W)p$",
    "attitude": r"quat|orient|rot|att|eul|lage$|(^|\W)q$",
    "x": r"^(x|px|pos(ition)?_x|n(orth|ord|orte)|range|forward|vorn|"
    r"l(ä|ae)nge|weite|longueur|largo|lunghezza|dist(ance|anz|ancia))$",
    "y": r"^(y|py|pos(ition)?_y|east|ost|oest|este?|breite|quer)$",
    "z": r"^(z|pz|pos(ition)?_z|h|height|alt(itude)?|h(ö|oe|o)he|hauteur|altura|quota|"
    r"up|oben|haut|down|unten|bas|abajo)$",
    "roll": r"(^|_)(roll|phi|bank|roulis|alabeo|rollio)",
    "pitch": r"pitch|theta|nick|assiette|tangage|cabeceo|beccheggio",
    "yaw": r"yaw|psi$|heading|gier|lacet|gui(ñ|n)ada|imbardata",
    _RATE: rf"^(?=.*({_ELEVATOR})).*({_IS_RATE}|{_COMMAND})|^(rate|u)$",
    _ANGLE: rf"^(?=.*({_ELEVATOR})).*({_COMMAND})",
    "elevator": rf"{_ELEVATOR}|angle",
}
_NOT_AN_ANGLE = rf"{_COMMAND}|{_IS_RATE}|effort"
_SCALARS = (_RATE, _ANGLE, "x", "z", "y", *EULER, "elevator")
_SAYS_NOTHING = re.compile(r"\.(position|data|value|angle|output)(\[0\])?$").search
_LARGEST: dict[tuple[str, ...], tuple[tuple[float, str], ...]] = {
    ("position", "x"): ((1000.0, "mm"), (100.0, "cm")),
    ("attitude", *EULER): ((2.0 * np.pi, "deg"),),
    ("elevator",): ((0.5 * np.pi, "deg"),),
    (_ANGLE,): ((0.5 * np.pi, "deg"),),
    (_RATE,): ((50.0, "deg/s"),),
}
"""Of quantities with one unit what is most in SI, and the unit of what is more. Heights
and y may have any origin."""
_PULSES = (500.0, 2500.0)  # Widths that servos take, and angles are not [us].
_PULSE_SCALE = "{gain: 0.00157, zero: 1500}"  # Of most: a quarter turn in 1000 us.
_FOUR = {"xyzw": 0.5, "wxyz": 0.5}
_RARE = ("YXZ", "ZXY", "YZX", "XZY", "rotation_vector")
_THREE = {"ZYX": 0.65, "XYZ": 0.3} | dict.fromkeys(_RARE, 0.01)
"""Ways to read four or three numbers of an attitude, each with its prior."""
_CERTAIN = 0.99  # Probability above which nothing is asked: one wrong in a hundred.
_RATE_LIMIT = 13.0  # Of a servo, to try frames with [rad/s]; it is not proposed.
_MAX_FILES = 12  # Recordings that are read.

_Columns = dict[str, Any]  # By quantity: names, of times a list.
_Fields = dict[str, str]  # Of `frame:`.


class Guess(NamedTuple):
    """A proposed mapping."""

    text: str  #: Of the MAP file, with reasons.
    campaign: Campaign  #: What it makes of the logs.
    probability: float  #: Of its frame.


def guess_mapping(files: Sequence[Path]) -> Guess:
    """Proposes a mapping; refused where no columns, or no frame, make flights."""
    recordings, join = _read(sorted(as_files(files)))
    columns = _guess_columns(recordings[0])
    is_px4 = bool(recordings[0].known)  # Its topics are in SI, and north, east, down.
    recordings = [part for log in recordings for part in split_flights(log, columns)]
    recordings = recordings[:_MAX_FILES]
    reasons = {} if is_px4 else _guess_units(recordings, columns)
    units = {kind: yaml.safe_load(unit) for kind, (unit, _) in reasons.items()}

    def claim(frame: _Fields) -> ColumnMapping:
        return _make_mapping(columns=columns, units=units, frame=frame)

    ranked = [({"axes": "NED"}, 1.0)]
    if not is_px4:
        readings, usual = _priors(recordings[0], columns)
        ranked = rank_frames(recordings, claim, readings, usual)
        ranked = ranked or [(readings[0][0], 0.0)]
    frame, probability = ranked[0]
    campaign = _make_campaign(recordings, claim(frame))
    why = ""
    vehicle = "fixed_per_flight  # no elevator found; 'fixed' if all had one trim"
    if campaign.elevator == "servo":
        signs, why = _guess_elevator(campaign)
        frame = frame | signs
        campaign = _make_campaign(recordings, claim(frame))
        # Commanded angles cannot be used without the limit.
        limit = "if you know it:" if "elevator" in columns else "? missing:"
        vehicle = f"servo  # {limit} elevator_rate_limit in rad/s"
    if _ANGLE in columns and is_px4:
        reasons = {_ANGLE: ("{gain: 1.0}", "? gain: angle at a command of 1 in rad")}
    doubts = _find_doubts(campaign, bool({"length", "time"} & reasons.keys()))
    east = re.search("east|ost|est", _words(columns.get("y", "")))
    if "roll" in columns and east and frame.get("up") == "z":
        doubts.append("north, east and up are left-handed: check roll's sign")
    lines = ["# Proposed by --guess: check each line before you use it."]
    if join:
        lines.append(f"join: {json.dumps(join)}  # the same text for * is one take")
    lines.append("columns:")
    how = "PX4's topic" if is_px4 else "by its name"
    lines += [f"  {name}: {quoted(own)}  # {how}" for name, own in columns.items()]
    lines += ["units:"] * bool(reasons)
    lines += [f"  {kind}: {unit}  # {why}" for kind, (unit, why) in reasons.items()]
    lines.append(f"frame:  # {'by the format' if is_px4 else _explain(ranked)}")
    lines += [f"  # ? {words}" for words in doubts]
    for name, value in frame.items():
        reason = f"  # {why}" if name == "elevator" else ""
        lines.append(f"  {name}: {quoted(value)}{reason}")
    lines.append("vehicle:  # what you know: mass, wing_area, ... in kg, m, s")
    lines.append(f"  elevator: {vehicle}")
    text = "".join(f"{printable(line)}\n" for line in lines)
    return Guess(text, campaign, probability)


def _make_mapping(**fields: Any) -> ColumnMapping:
    """The mapping that some fields of a MAP file are."""
    mapping = schema.convert(fields, Settings, "the guess").mapping("the guess")
    assert mapping is not None
    return mapping


def _find_doubts(campaign: Campaign, by_range: bool) -> list[str]:
    """What the flights of a guess contradict, or do not confirm of units by range."""
    try:
        shown = check_signs(campaign)
    except InputError as error:
        return [f"an import refuses it: {str(error).removeprefix('guess: ')}"]
    return [words for words in shown if by_range and "gravity" in words]


def guess_columns(files: Sequence[Path]) -> _Columns:
    """The columns that names tell, by quantity, also where they make no flights."""
    recordings, _ = _read(sorted(map(Path, files)))
    return _find(recordings[0])


def _read(files: Sequence[Path]) -> tuple[list[Recording], list[str]]:
    """Recordings; those of poses and servos in two files each are joined by patterns.

    `a_pose.csv a_servo.csv b_pose.csv b_servo.csv` -> `*pose.csv *servo.csv`
    """
    logs = {file: read_recordings(file) for file in files[: 2 * _MAX_FILES]}
    posed = [file for file in logs if any(_has_pose(_find(r)) for r in logs[file])]
    others = [file for file in logs if file not in posed]
    if posed and len(posed) == len(others):
        pair = [posed[0].name, others[0].name]
        before = os.path.commonprefix(pair)  # noqa: RUF071 -- of names, not paths.
        after = os.path.commonprefix([n[::-1] for n in pair])[::-1]  # noqa: RUF071
        ends = [f"*{name.removeprefix(before)}" for name in pair]
        beginnings = [f"{name.removesuffix(after)}*" for name in pair]
        for join in (ends, beginnings):
            with contextlib.suppress(InputError):  # Not all files have such names.
                return read_logs(list(logs), _make_mapping(join=join), silent), join
    found = [recording for file in posed or logs for recording in logs[file]]
    return found[:_MAX_FILES], []


def _make_campaign(recordings: Sequence[Recording], claim: ColumnMapping) -> Campaign:
    """What a mapping makes of recordings."""
    servo = any(name.startswith("elevator") for name in claim.columns)
    kind = "servo" if servo else "fixed"
    vehicle = Vehicle(elevator=kind, elevator_rate_limit=_RATE_LIMIT)
    settings = Settings(vehicle=vehicle).campaign(Path("guess"))
    found = cut_recordings(recordings, claim, settings)
    if not found.campaign.flights:
        path = recordings[0].path
        raise InputError(f"{path}: no flight was found ({found.reasons}).")
    return found.campaign


def _priors(
    log: Recording, columns: _Columns
) -> tuple[list[tuple[_Fields, float]], str]:
    """Ways to read the attitude with their priors, and the usual axis that is up."""
    z = _words(columns.get("z", "z"))
    usual = log.up
    if not re.search("z$", z):
        usual = "-z" if re.search("down|unten|bas|abajo", z) else "z"
    attitude = columns.get("attitude")
    if attitude is None:
        tops = [{"nose": "x", "top": top} for top in ("z", "-z")]
        signs = [{"pitch": sign} for sign in ("nose_up", "nose_down")]
        known = tops if "yaw" in columns else [{}]
        return [(sign | top, 0.5) for sign in signs for top in known], usual
    found = log.find_all(attitude, SHAPES["attitude"])
    axes = found[0] if found else ""
    if axes in ("012345678", "xyzw") or log.rotation:
        return [({}, 1.0)], usual
    orders = _FOUR if axes == "0123" else _THREE
    return [({"rotation": order}, prior) for order, prior in orders.items()], usual


def _explain(ranked: Sequence[tuple[_Fields, float]]) -> str:
    """How certain the best frame is; if it is not, the question to be answered."""
    best, probability = ranked[0]
    if probability >= _CERTAIN:
        return f"by forces and habits, probability {min(probability, 0.9999):.4g}"
    rival, other = ranked[min(1, len(ranked) - 1)]
    differs = [f"{field}: {v}" for field, v in rival.items() if best[field] != v]
    return (
        f"? probability {probability:.2g}, and {other:.2g} with {', '.join(differs)}; "
        "in the picture, arrows point to the nose"
    )


def _guess_elevator(campaign: Campaign) -> tuple[_Fields, str]:
    """The signs of elevator and command, and the reason."""
    motions = measure_motions(campaign.flights, {})
    effect = fit_elevator(campaign, motions).effect
    own = "trailing_edge_up"
    other = "trailing_edge_down"
    if effect > 0.0:
        own, other = other, own
    signs = {"elevator": own}
    if follow_sign(measure_elevators(campaign, {})) < 0:
        signs["command"] = other
    if abs(effect) < SIGNIFICANT:
        return signs, "? the flights do not show it: check it"
    return signs, f"it turns the glider so, by {abs(effect):.0f} standard errors"


def quoted(value: str | list[str]) -> str:
    """A name, or a list of several, as YAML has it."""
    text = yaml.safe_dump(
        value, default_flow_style=True, width=math.inf, allow_unicode=True
    )
    return text.splitlines()[0]


def _words(name: str) -> str:
    """The part of an address that says something, parted by _, without its unit."""
    text = name if _SAYS_NOTHING(name) else name.rpartition(".")[2]
    text = re.sub(r"(?<=[^\W_A-Z])(?=[A-Z])|\W+", "_", text).strip("_").lower()
    return split_suffix(text)[0]


def _addresses(log: Recording) -> list[str]:
    """Names of columns that can be used; those of joined files without patterns."""
    return [
        f"{group.name}.{name}" if group.name and "*" not in group.name else name
        for group in log.groups
        for name, column in group.columns.items()
        if not column.fault or column.labels
    ]


def _guess_columns(log: Recording) -> _Columns:
    """Finds columns by quantity; refuses logs without those of a pose."""
    columns = _find(log)
    if not _has_pose(columns):
        names = _addresses(log)
        listed = ", ".join(names[:20]) + (", ..." if len(names) > 20 else "")
        raise InputError(
            f"{log.path}: no columns of a position and an attitude were recognized by "
            f"their names in {listed}; write the mapping by hand (markers give an "
            "attitude as {nose: ..., tail: ...})."
        )
    return columns


def _has_pose(columns: _Columns) -> bool:
    has_place = "position" in columns or {"x", "z"} <= set(columns)
    return has_place and bool({"attitude", "pitch"} & set(columns))


def _find(log: Recording) -> _Columns:
    """Columns by quantity, those that are recognized."""
    if {"position", "attitude"} <= log.known.keys():
        return dict(log.known)
    names = _addresses(log)
    columns = _find_vectors(log, names)
    for quantity, stem in columns.items():
        _, used = log.find_all(stem, SHAPES[quantity]) or ("", [])
        names = [name for name in names if name not in used]
    instead = INSTEAD | {_ANGLE: _RATE}
    for quantity in _SCALARS:
        found = _find_scalar(quantity, names)
        if found is not None and instead.get(quantity) not in columns:
            columns[quantity] = found
            names.remove(found)
    if not set(EULER) <= columns.keys():  # Only all three are a rotation.
        columns.pop("roll", None)
        columns.pop("yaw", None)
    if _RATE in columns and _is_angle(log, columns):
        columns[_ANGLE] = columns.pop(_RATE)
    if "x" in columns and "y" in columns and "z" not in columns:  # As of a video.
        columns["z"] = columns.pop("y")
    times: list[str] = []
    for group in log.groups:
        if group.time:
            continue
        own = [n for n in group.columns if re.search(_NAMES["time"], _words(n))]
        times += own[:1]
    if times:
        columns["time"] = list(dict.fromkeys(times))
    return {
        quantity: columns[quantity] for quantity in QUANTITIES if quantity in columns
    }


def _find_vectors(log: Recording, names: Sequence[str]) -> _Columns:
    """Common beginnings of the names of an attitude's and a position's columns."""
    bare = (split_suffix(name)[0] for name in names)
    firsts = (re.fullmatch(r"(.+?)(\[?0\]?|[._ ]?[xX])", name) for name in bare)
    stems = dict.fromkeys(first[1] for first in firsts if first)
    columns: _Columns = {}
    for quantity, shapes in SHAPES.items():
        is_named = re.compile(_NAMES[quantity], re.IGNORECASE).search
        fits = [
            stem
            for stem in filter(is_named, stems)
            # As qx, qy, qz of pose.x, ..., pose.qx.
            if stem not in columns.values() and log.find_all(stem, shapes)
        ]
        owner = columns.get("attitude", "").rpartition(".")[0]
        own = [stem for stem in fits if owner and f"{stem}.".startswith(f"{owner}.")]
        if fits:
            columns[quantity] = max(own or fits, key=lambda stem: _travel(log, stem))
    return columns


def _find_scalar(quantity: str, names: Sequence[str]) -> str | None:
    """The first of some columns whose name fits a quantity."""
    is_angle = quantity in ("elevator", *EULER)
    for name in names:
        words = _words(name)
        if is_angle and re.search(_NOT_AN_ANGLE, words):
            continue
        if re.search(_NAMES[quantity], words):
            return name
    return None


def _is_angle(log: Recording, columns: _Columns) -> bool:
    """Whether commands are angles: by their unit, or as the elevator has them."""
    name = columns[_RATE]
    command, unit = _values(log, name)
    if unit or _are_pulses(command):
        return unit in (None, "deg", "rad")
    if "elevator" not in columns or re.search(_IS_RATE, _words(name)):
        return False
    angle, _ = _values(log, columns["elevator"])
    if len(angle) != len(command):
        return False
    logged = np.stack([command, np.gradient(angle), angle])
    shown = logged[:, np.isfinite(logged).all(axis=0)]
    with np.errstate(invalid="ignore", divide="ignore"):
        _, to_rate, to_angle = np.abs(np.corrcoef(shown)[0])
    return bool(to_angle > to_rate)


def _travel(log: Recording, stem: str) -> float:
    """Way of a vector: the glider moves most, not the wand on the floor."""
    return float(np.nansum(np.abs(np.diff(_values(log, stem)[0]))))


def _values(log: Recording, name: str) -> tuple[np.ndarray, str | None]:
    """Values of a vector (k, n) or a scalar (n,), and their unit."""
    _, names = log.find_all(name, ("xyz", "012")) or ("", [name])
    _, columns = log.find_each(names, name)
    return np.squeeze([column.values for column in columns]), columns[0].unit


def _guess_units(
    logs: Sequence[Recording], columns: _Columns
) -> dict[str, tuple[str, str]]:
    """Units that the files do not report, by the ranges of the columns, and why."""
    units: dict[str, tuple[str, str]] = {}
    if "time" in columns:
        values, unit = _values(logs[0], columns["time"][0])
        step = float(np.nanmedian(np.diff(values)))
        fits = [u for u, size in UNITS["time"].items() if 2e-4 < step * size < 0.2]
        if unit is None and fits and fits[0] != "s":
            units["time"] = fits[0], f"its median step is {step:.4g}"
    found: dict[str, tuple[str, str]] = {}
    for quantities, largest in _LARGEST.items():
        own = [quantity for quantity in quantities if quantity in columns]
        read = [_values(log, columns[quantity]) for quantity in own for log in logs]
        if not read:
            continue
        unit = read[0][1]
        why = ""
        if unit is None:
            values = np.concatenate([np.abs(values).ravel() for values, _ in read])
            reach = np.nanmax(np.append(values, 0.0))
            larger = (name for most, name in largest if reach > most)
            unit = next(larger, next(iter(UNITS[QUANTITIES[own[0]]])))
            why = f"'{own[0]}' reaches {reach:.4g}"
            if own[0] in ("elevator", _ANGLE) and _are_pulses(values):
                unit = _PULSE_SCALE
                why = f"? {why}: microseconds, and gain is the angle of one in rad"
        found |= dict.fromkeys(own, (unit, why))
    # Those that are not of SI are stated, and what they may be confused with.
    is_si = {name: UNITS[QUANTITIES[name]].get(found[name][0]) == 1.0 for name in found}
    kinds = {QUANTITIES[name] for name in found if not is_si[name]}
    for name, (unit, why) in found.items():
        kind = QUANTITIES[name]
        if why and kind in kinds:
            what = "length" if kind == "length" else name
            units[what] = unit, f"? {why}" if is_si[name] else why
    return units


def _are_pulses(values: np.ndarray) -> bool:
    """Whether numbers (n,) are pulse widths of a servo in microseconds."""
    known = values[np.isfinite(values)]
    return len(known) > 0 and _PULSES[0] < np.min(known) <= np.max(known) < _PULSES[1]
