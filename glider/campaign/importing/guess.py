"""`--guess`: a mapping proposed from names, ranges, gravity and the elevator's effect.

Columns are found by their names, units by their names or ranges. Axes and signs are
tried: the frame is proposed in which the flights fall down at g and the forces of the
air agree best with the attitude. Each line of the proposal has its reason; a sign that
the flights do not show is left to the user, with a question mark.
"""

import itertools
import json
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from glider.campaign.checks.clocks import follow_sign
from glider.campaign.checks.forces import usable_motion
from glider.campaign.importing.campaign_import import campaign_of_cuts, cut_recordings
from glider.campaign.importing.cutting import cut
from glider.campaign.importing.readers import read_recordings
from glider.campaign.importing.recording import Recording
from glider.campaign.importing.sign_checks import (
    CLEARLY,
    SIGNIFICANT,
    elevator_effect,
    misfit_of,
)
from glider.campaign.importing.track import make_track
from glider.campaign.logs import Campaign
from glider.campaign.settings import AXES, QUANTITIES, Mapping, Settings, Vehicle
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
_SHAPES = {"attitude": ("xyzw", "0123", "xyz", "012"), "position": ("xyz", "012")}
_RATE = "elevator_rate_command"
_SCALARS = (_RATE, "elevator_angle_command", "time", "x", "z", "pitch", "elevator")
_INSTEAD = {"x": "position", "z": "position", "pitch": "attitude"}
_INSTEAD |= {"elevator_angle_command": _RATE}  # Quantity that makes another needless.
_IS_TIME = re.compile(r"stamp|(^|\W)(time|sec|nsec|seq)($|\W)").search
_STEPS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Units of time: logs of poses step by 0.2 to 200 ms."""
_RANGES = (
    ("position", "length", 100.0, "mm"),
    ("x", "length", 100.0, "mm"),
    ("pitch", "angle", 2.0 * np.pi, "deg"),
    ("attitude", "angle", 2.0 * np.pi, "deg"),
    ("elevator", "angle", 2.0 * np.pi, "deg"),
    (_RATE, "rate", 50.0, "deg/s"),
)
"""Quantity, kind of unit, largest value in SI, and the unit of larger ones."""
_PITCH = ("nose_down", "nose_up")
_RATE_LIMIT = 13.0  # Of a servo, to try frames with [rad/s]; it is not proposed.
_MAX_TRIED = 4  # Files that frames are tried on.
_MAX_FILES = 12  # Files that are read.

Fields = dict[str, str]  # Fields of one part of a mapping: columns, units or frame.


class Guess(NamedTuple):
    """A proposed mapping."""

    text: str  # Of the MAP file, with reasons.
    campaign: Campaign  # What it makes of the logs.


class _Logs(NamedTuple):
    """Recordings, and what was found of their columns and units."""

    recordings: Sequence[Recording]
    columns: Fields
    units: Fields

    def claim(self, frame: Fields) -> Mapping:
        """The mapping with a frame."""
        fields = {"columns": self.columns, "units": self.units, "frame": frame}
        claim = schema.convert(fields, Settings, "the guess").mapping("the guess")
        assert claim is not None
        return claim


class _Trial(NamedTuple):
    """A frame that was tried."""

    frame: Fields
    misfit: float  # Of the forces, gravity given [m/s²].
    campaign: Campaign


def guess_mapping(files: Sequence[Path]) -> Guess:
    """Proposes a mapping; refused where no columns, or no frame, make flights."""
    logs = [r for f in sorted(files)[:_MAX_FILES] for r in read_recordings(Path(f))]
    logs = [log for log in logs if any(group.columns for group in log.groups)]
    if not logs:
        raise InputError(f"{files[0]}: has no columns; expected those of a pose.")
    columns, reason = _guess_columns(logs[0])
    # PX4's topics are in SI, and north, east, down.
    reasons = {} if logs[0].known else _guess_units(logs[0], columns)
    units = {kind: unit for kind, (unit, _) in reasons.items()}
    best, why = _best_frame(_Logs(logs[:_MAX_TRIED], columns, units))
    frame, servo = dict(best.frame), best.campaign.elevator == "servo"
    servo_why = _guess_elevator(best.campaign, frame) if servo else ""
    lines = ["# Proposed by --guess: check each line before you use it.", "columns:"]
    lines += [f"  {k}: {_quoted(v)}  # {reason}" for k, v in columns.items()]
    command = "elevator_angle_command"
    if command in logs[0].known:
        lines.append("units:  # ? gain: the elevator's angle at a command of 1 in rad")
        lines.append(f"  {command}: {{gain: 1.0}}")
    elif units:
        lines.append("units:")
        lines += [f"  {k}: {v}  # {words}" for k, (v, words) in reasons.items()]
    lines.append(f"frame:  # {why}")
    lines += [f"  {k}: {_quoted(v)}" for k, v in frame.items() if k != "elevator"]
    if servo:
        lines.append(f"  elevator: {frame['elevator']}  # {servo_why}")
    lines.append("vehicle:  # what you know: mass, wing_area, ... in kg, m, s")
    if not servo:
        lines.append("  elevator: fixed  # no column of an elevator was found")
    elif "elevator" in columns:
        lines.append(
            "  elevator: servo  # if you know it: elevator_rate_limit in rad/s"
        )
    else:  # Commanded angles cannot be used without it.
        lines.append("  elevator: servo  # ? elevator_rate_limit in rad/s is missing")
    best = _try_frame(_Logs(logs, columns, units), frame) or best
    text = "".join(f"{printable(line)}\n" for line in lines)
    return Guess(text, best.campaign)


def _guess_elevator(campaign: Campaign, frame: Fields) -> str:
    """Sets the signs of elevator and command in a frame; returns the reason."""
    motions = {f.name: usable_motion(f, {}) for f in campaign.flights}
    effect = elevator_effect(campaign, motions)
    signs = ["trailing_edge_up", "trailing_edge_down"]
    own, other = reversed(signs) if effect > 0.0 else signs
    frame["elevator"] = own
    if follow_sign(campaign.flights, {}) < 0:
        frame["command"] = other
    if abs(effect) < SIGNIFICANT:
        return "? the flights do not show it: check it"
    return f"it turns the glider so, by {abs(effect):.0f} standard errors"


def _quoted(value: str) -> str:
    plain = re.fullmatch(r"[A-Za-z/][\w./]*", value)
    if plain and value not in ("y", "n"):
        return value
    return json.dumps(value, ensure_ascii=False)  # JSON's strings are YAML's, too.


def _guess_columns(log: Recording) -> tuple[Fields, str]:
    """Finds columns by quantity, and how."""
    names = log.names()
    if {"position", "attitude"} <= log.known.keys():
        return dict(log.known), "PX4's topic"
    columns: Fields = {}
    first = (re.fullmatch(r"(.+?)(\[0\]|[._ ]?[xX])", name) for name in names)
    stems = list(dict.fromkeys(match[1] for match in first if match))
    for quantity, shapes in _SHAPES.items():
        fits = [
            stem
            for stem in stems
            if re.search(_NAMES[quantity], stem, re.IGNORECASE)
            and any(log.find_all(stem, axes, quantity) for axes in shapes)
        ]
        owner = columns.get("attitude", "").rpartition(".")[0]
        own = [stem for stem in fits if owner and stem.startswith(f"{owner}.")]
        if fits:
            columns[quantity] = max(own or fits, key=lambda stem: _travel(log, stem))
    timed = any(group.time for group in log.groups)
    for quantity in _SCALARS:
        if _INSTEAD.get(quantity) in columns or (timed and quantity == "time"):
            continue
        taken = tuple(columns.values())
        for name in names:
            if quantity != "time" and (name.startswith(taken) or _IS_TIME(name)):
                continue
            if re.search(_NAMES[quantity], name.rpartition(".")[2], re.IGNORECASE):
                columns[quantity] = name
                break
    has_place = "position" in columns or {"x", "z"} <= set(columns)
    if not (has_place and {"attitude", "pitch"} & set(columns)):
        listed = ", ".join(names[:20]) + (", ..." if len(names) > 20 else "")
        raise InputError(
            f"{log.path}: no columns of a position and an attitude were recognized by "
            f"their names in {listed}; write the mapping by hand."
        )
    return {q: columns[q] for q in QUANTITIES if q in columns}, "by its name"


def _travel(log: Recording, stem: str) -> float:
    """Way of a vector: the glider moves most, not the wand on the floor."""
    steps = np.abs(np.diff(_values(log, stem)[0]))
    return float(np.nansum(steps)) if np.isfinite(steps).any() else -1.0


def _values(log: Recording, name: str) -> tuple[np.ndarray, str | None]:
    """Values of a vector (k, n) or a scalar (n,), and their unit."""
    for axes in ("xyz", "012"):
        found = log.find_all(name, axes, name)
        if found:
            return np.stack([c.values for c in found[1]]), found[1][0].unit
    _, column = log.find(name, name)
    return column.values, column.unit


def _guess_units(log: Recording, columns: Fields) -> dict[str, tuple[str, str]]:
    """Units that the file does not report, by the ranges of the columns, and why."""
    units = {}
    if "time" in columns:
        values, unit = _values(log, columns["time"])
        step = float(np.nanmedian(np.diff(values)))
        fits = [u for u, size in _STEPS.items() if 2e-4 < step * size < 0.2]
        if unit is None and fits and fits[0] != "s":
            units["time"] = fits[0], f"its median step is {step:.4g}"
    for quantity, kind, most, other in _RANGES:
        if quantity not in columns:
            continue
        values, unit = _values(log, columns[quantity])
        reach = float(np.nanmax(np.abs(values)))
        if unit is None and reach > most:
            units[kind] = other, f"'{quantity}' reaches {reach:.4g}"
    return units


def _best_frame(logs: _Logs) -> tuple[_Trial, str]:
    """The frame with the least misfit, and how clearly it is the best."""
    tried = [_try_frame(logs, frame) for frame in _frames(logs)]
    trials = [trial for trial in tried if trial is not None]
    if not trials:
        raise InputError(
            f"{logs.recordings[0].path}: the columns "
            f"{', '.join(logs.columns.values())} make flights in no frame; write the "
            "mapping by hand."
        )
    rows = [sum(len(f.time) for f in trial.campaign.flights) for trial in trials]
    pairs = zip(trials, rows, strict=True)
    likely = (trial for trial, count in pairs if 2 * count > max(rows))
    best, *others = sorted(likely, key=lambda trial: trial.misfit)
    if not others:
        return best, "the columns make flights in no other frame"
    ratio = others[0].misfit / best.misfit
    nearly = f"? another frame fits nearly as well (ratio {ratio:.2f}): check it"
    clearly = f"the forces fit {ratio:.2g} times as well as in the next best frame"
    return best, nearly if ratio <= CLEARLY else clearly


def _frames(logs: _Logs) -> Iterator[Fields]:
    """Yields a frame for each axis that may point up and each way to read rotations.

    The nose is the axis of the body along which the flights go, the top the one that
    points up then.
    """
    first, attitude = logs.recordings[0], logs.columns.get("attitude")
    if first.known:
        yield {"axes": "NED"}
        return
    if "position" not in logs.columns:
        for up, forward, pitch in itertools.product(("z", "-z"), ("x", "-x"), _PITCH):
            yield {"up": up, "forward": forward, "pitch": pitch}
        return
    if attitude is None:
        yield from ({"up": u, "pitch": p} for u, p in itertools.product(AXES, _PITCH))
        return
    readings: tuple[Fields, ...] = ({},)
    if not first.find_all(attitude, "xyzw", "attitude") and first.rotation is None:
        three = any(first.find_all(attitude, a, "attitude") for a in ("xyz", "012"))
        orders = ("ZYX", "XYZ") if three else ("wxyz", "xyzw")
        readings = tuple({"rotation": order} for order in orders)
    for up, reading in itertools.product(AXES, readings):
        frame = {"up": up} | reading
        claim = logs.claim(frame)
        ahead, above = [], []
        for log in logs.recordings:
            track = make_track(log, claim)
            for flight in cut(track, GliderParameters().gravity)[0]:
                turns = flight.track.rotation
                if turns is not None:
                    way = np.diff(flight.track.position, axis=0)
                    ahead.append(np.einsum("ni,nij->j", way, turns[1:]))
                    above.append(np.mean(turns[:, 2], axis=0))
        if ahead:
            nose = _nearest_axis(np.sum(ahead, axis=0), "")
            top = _nearest_axis(np.mean(above, axis=0), nose)
            yield frame | {"nose": nose, "top": top}


def _nearest_axis(direction: np.ndarray, other: str) -> str:
    """The axis nearest to a direction (3,), not along another axis."""
    sizes = np.abs(direction)
    if other:
        sizes["xyz".index(other[-1])] = -1.0
    k = int(np.argmax(sizes))
    return ("-" if direction[k] < 0.0 else "") + "xyz"[k]


def _try_frame(logs: _Logs, frame: Fields) -> _Trial | None:
    """What a frame makes of the logs; None where it makes no flights."""
    servo = any(name.startswith("elevator") for name in logs.columns)
    fixed, moving = Vehicle(elevator="fixed"), Vehicle(elevator_rate_limit=_RATE_LIMIT)
    settings = Settings(vehicle=moving if servo else fixed).campaign(Path("guess"))
    try:
        recordings = cut_recordings(logs.recordings, logs.claim(frame), settings)
        if not any(recording.flights for recording in recordings):
            return None
        campaign = campaign_of_cuts(settings, recordings)
        misfit = misfit_of(campaign)
    except InputError:
        return None
    return None if misfit is None else _Trial(frame, misfit, campaign)
