"""`--guess`: a mapping proposed from names, ranges, gravity and the elevator's effect.

Columns and units are recognized by names and ranges (`recognition`). The frame is the
most probable one (`frame_posterior`); what is not certain is left to the user, with a
question mark, the next best frame and what distinguishes both. The signs of elevator
and command are those with which the flights agree. The proposal itself is imported, so
that what the import would refuse or doubt is stated in its text.
"""

import contextlib
import json
import math
import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from glider.campaign.checks.forces import fit_elevator, measure_motions
from glider.campaign.checks.frame import SIGNIFICANT
from glider.campaign.checks.servo import follow_sign, measure_elevators
from glider.campaign.checks.signs import check_signs
from glider.campaign.importing.campaign_import import cut_recordings
from glider.campaign.importing.frame_posterior import rank_frames
from glider.campaign.importing.joining import as_files, read_logs
from glider.campaign.importing.readers import read_recordings
from glider.campaign.importing.recognition import (
    find_columns,
    guess_units,
    usable_names,
    words_of,
)
from glider.campaign.importing.recording import Recording
from glider.campaign.importing.splitting import split_flights
from glider.campaign.logs import Campaign
from glider.campaign.settings import SHAPES, ColumnMapping, Settings, Vehicle
from glider.errors import InputError, printable
from glider.files import schema
from glider.progress import silent

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
    """A proposed mapping.

    Attributes:
        text: of the MAP file, with reasons.
        campaign: what it makes of the logs.
        probability: of its frame, 0 to 1.
    """

    text: str
    campaign: Campaign
    probability: float


def guess_mapping(files: Sequence[Path]) -> Guess:
    """Proposes a mapping for logs of one glider.

    Args:
        files: logs of any known format; poses and servo may be in two files each.

    Returns:
        The mapping as a text to be checked, with what it makes of the logs.

    Raises:
        InputError: no columns of a pose are recognized, or no frame makes flights.
    """
    recordings, join = _read(sorted(as_files(files)))
    columns = _require_pose(recordings[0])
    parts = [part for log in recordings for part in split_flights(log, columns)]
    parts = parts[:_MAX_FILES]
    first = parts[0]

    # The units that the format fixes, or else those that the numbers' ranges tell.
    fixed = {name: unit for name, unit in first.units.items() if name in columns}
    units = fixed if first.known else guess_units(parts, columns)
    scales = {kind: yaml.safe_load(unit) for kind, unit in units.items()}

    def claim(frame: _Fields) -> ColumnMapping:
        return _make_mapping(columns=columns, units=scales, frame=frame)

    # The frame of the format, or else the one that the flights make most probable.
    if first.known:
        ranked = [({"axes": first.axes}, 1.0)]
        source = first.known_as
        certainty = "by the format"
    else:
        readings = _find_readings(first, columns)
        ranked = rank_frames(parts, claim, readings, _usual_up(first, columns))
        ranked = ranked or [(readings[0][0], 0.0)]
        source = "by its name"
        certainty = _explain(ranked)
    frame, probability = ranked[0]
    campaign = _make_campaign(parts, claim(frame))

    # The signs of the servo, with which the flights are imported again.
    vehicle = "fixed_per_flight  # no elevator found; 'fixed' if all had one trim"
    shown = {name: quoted(value) for name, value in frame.items()}
    if campaign.elevator == "servo":
        signs, why = _guess_elevator(campaign)
        shown |= signs
        shown["elevator"] += f"  # {why}"
        campaign = _make_campaign(parts, claim(frame | signs))
        # Commanded angles cannot be used without the limit.
        limit = "if you know it:" if "elevator" in columns else "? missing:"
        vehicle = f"servo  # {limit} elevator_rate_limit in rad/s"

    # What the user has to check beside what was uncertain so far.
    doubts = _find_doubts(campaign, bool({"length", "time"} & units.keys()))
    east = re.search("east|ost|est", words_of(columns.get("y", "")))
    if "roll" in columns and east and frame.get("up") == "z":
        doubts.append("north, east and up are left-handed: check roll's sign")

    # The text, in the order of a MAP file.
    lines = ["# Proposed by --guess: check each line before you use it."]
    if join:
        lines.append(f"join: {json.dumps(join)}  # the same text for * is one take")
    lines.append("columns:")
    lines += [f"  {name}: {quoted(own)}  # {source}" for name, own in columns.items()]
    if units:
        lines.append("units:")
    lines += [f"  {kind}: {unit}" for kind, unit in units.items()]
    lines.append(f"frame:  # {certainty}")
    lines += [f"  # ? {words}" for words in doubts]
    lines += [f"  {name}: {value}" for name, value in shown.items()]
    lines.append("vehicle:  # what you know: mass, wing_area, ... in kg, m, s")
    lines.append(f"  elevator: {vehicle}")
    text = "".join(f"{printable(line)}\n" for line in lines)
    return Guess(text, campaign, probability)


def guess_columns(files: Sequence[Path]) -> _Columns:
    """Finds columns by their names, also where they make no flights.

    Returns:
        Addresses of columns by quantity, as a MAP file lists them.
    """
    recordings, _ = _read(sorted(map(Path, files)))
    return find_columns(recordings[0])


def quoted(value: str | list[str]) -> str:
    """A name, or a list of several, as YAML has it."""
    text = yaml.safe_dump(
        value, default_flow_style=True, width=math.inf, allow_unicode=True
    )
    return text.splitlines()[0]


def _read(files: Sequence[Path]) -> tuple[list[Recording], list[str]]:
    """Reads recordings; those of poses and servos in two files each are joined.

    Returns:
        At most as many recordings as are used, and the patterns that join files: of
        a_pose.csv, a_servo.csv, b_pose.csv, b_servo.csv they are *pose.csv, *servo.csv.
        Without such pairs of files there are no patterns, and the recordings are those
        of files with poses, if any has.
    """
    logs = {file: read_recordings(file) for file in files[: 2 * _MAX_FILES]}
    posed = [f for f in logs if any(_has_pose(find_columns(r)) for r in logs[f])]
    others = [file for file in logs if file not in posed]

    # The two files of a take have the same beginning, or the same end.
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


def _require_pose(log: Recording) -> _Columns:
    """Finds columns by quantity; refuses logs without those of a pose."""
    columns = find_columns(log)
    if _has_pose(columns):
        return columns
    names = usable_names(log)
    listed = ", ".join(names[:20])
    if len(names) > 20:
        listed += ", ..."
    raise InputError(
        f"{log.path}: no columns of a position and an attitude were recognized by "
        f"their names in {listed}; write the mapping by hand (markers give an "
        "attitude as {nose: ..., tail: ...})."
    )


def _has_pose(columns: _Columns) -> bool:
    """Whether columns, by quantity, contain a position and an attitude or pitch."""
    has_place = "position" in columns or {"x", "z"} <= columns.keys()
    return has_place and ("attitude" in columns or "pitch" in columns)


def _make_mapping(**fields: Any) -> ColumnMapping:
    """Makes the mapping of a MAP file that has these fields alone."""
    mapping = schema.convert(fields, Settings, "the guess").mapping("the guess")
    assert mapping is not None
    return mapping


def _make_campaign(recordings: Sequence[Recording], claim: ColumnMapping) -> Campaign:
    """Imports recordings by a mapping; refuses one that makes no flight of them."""
    has_servo = any(name.startswith("elevator") for name in claim.columns)
    kind = "servo" if has_servo else "fixed"
    vehicle = Vehicle(elevator=kind, elevator_rate_limit=_RATE_LIMIT)
    settings = Settings(vehicle=vehicle).campaign(Path("guess"))
    found = cut_recordings(recordings, claim, settings)
    if not found.campaign.flights:
        path = recordings[0].path
        raise InputError(f"{path}: no flight was found ({found.reasons}).")
    return found.campaign


def _usual_up(log: Recording, columns: _Columns) -> str:
    """Returns the axis that points up by the name of z, or by the format.

    It is "" where neither tells.
    """
    z = words_of(columns.get("z", "z"))
    if z.endswith("z"):
        return log.up
    return "-z" if re.search("down|unten|bas|abajo", z) else "z"


def _find_readings(log: Recording, columns: _Columns) -> list[tuple[_Fields, float]]:
    """Lists the ways in which the attitude may be read.

    Returns:
        Fields of `frame:`, each with its prior, the likeliest first.
    """
    attitude = columns.get("attitude")
    if attitude is None:
        signs = [{"pitch": sign} for sign in ("nose_up", "nose_down")]
        if "yaw" in columns:
            tops = [{"nose": "x", "top": top} for top in ("z", "-z")]
            signs = [sign | top for sign in signs for top in tops]
        return [(sign, 0.5) for sign in signs]

    axes, _ = log.find_all(attitude, SHAPES["attitude"]) or ("", [])
    if axes in ("012345678", "xyzw") or log.rotation:
        return [({}, 1.0)]
    orders = _FOUR if axes == "0123" else _THREE
    return [({"rotation": order}, prior) for order, prior in orders.items()]


def _explain(ranked: Sequence[tuple[_Fields, float]]) -> str:
    """Says how certain the best frame is; if it is not, what is to be decided.

    Args:
        ranked: fields of `frame:` and their probability, the best first.
    """
    best, probability = ranked[0]
    if probability >= _CERTAIN:
        return f"by forces and habits, probability {min(probability, 0.9999):.4g}"
    rival, other = ranked[:2][-1]
    differs = [f"{field}: {v}" for field, v in rival.items() if best[field] != v]
    return (
        f"? probability {probability:.2g}, and {other:.2g} with {', '.join(differs)}; "
        "in the picture, arrows point to the nose"
    )


def _guess_elevator(campaign: Campaign) -> tuple[_Fields, str]:
    """Finds the signs of elevator and command by their effects.

    An elevator whose trailing edge is up raises the nose: its effect on the pitch's
    acceleration, which is positive nose down, is negative. The command has the same
    sign unless the elevator moves against it.

    Returns:
        Fields of `frame:`, and the reason.
    """
    motions = measure_motions(campaign.flights, {})
    effect = fit_elevator(campaign, motions).effect
    own, other = "trailing_edge_up", "trailing_edge_down"
    if effect > 0.0:
        own, other = other, own
    signs = {"elevator": own}
    if follow_sign(measure_elevators(campaign, {})) < 0:
        signs["command"] = other
    if abs(effect) < SIGNIFICANT:
        return signs, "? the flights do not show it: check it"
    return signs, f"it turns the glider so, by {abs(effect):.0f} standard errors"


def _find_doubts(campaign: Campaign, by_range: bool) -> list[str]:
    """Lists what the flights of a guess contradict.

    Args:
        campaign: the flights as the guess reads them.
        by_range: whether a length or time unit is guessed by its range: then gravity
            has to confirm it.
    """
    try:
        shown = check_signs(campaign)
    except InputError as error:
        return [f"an import refuses it: {str(error).removeprefix('guess: ')}"]
    return [words for words in shown if by_range and "gravity" in words]
