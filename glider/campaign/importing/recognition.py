"""Which columns of a log hold a pose and a servo, and in which units.

Columns are found by words in their names, in the languages of the users, vectors before
scalars: the x, y and z of a position are then no quantities of their own. Units are
those that a file reports, or that names end in (`x_mm`); without them, the ranges of
the numbers tell them: no flight is a kilometer long.

What is found is a dictionary as in `columns:` of a MAP file, from quantities to
addresses of columns: of a scalar `group.name`, of a vector the common beginning of its
columns, of times a list of names.
"""

import math
import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from glider.campaign.importing.recording import UNITS, Recording, split_suffix
from glider.campaign.settings import EULER, INSTEAD, QUANTITIES, SHAPES

# Words for an elevator, a command and a rate, in any language.
_ELEVATOR = r"elev|(^|_)de(_|$)|delta|servo|h(ö|oe|o)hen|ruder|prof[ou]nd|flap|joint"
_COMMAND = r"cmd|command|soll|setp|(^|_)(set|sp|ref)(_|$)|consigne|kommando|comando"
_IS_RATE = r"rate|dot|vel|d(e)?g?ps|geschw|vitesse"
_RATE = "elevator_rate_command"
_ANGLE = "elevator_angle_command"
# What names contain: those of scalars as `words_of` makes them, of vectors as they are.
_NAMES = {
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
# What names of measured angles do not contain.
_NOT_AN_ANGLE = rf"{_COMMAND}|{_IS_RATE}|effort"
# In this order: names of commands contain those of the elevator as well.
_SCALARS = (_RATE, _ANGLE, "x", "z", "y", *EULER, "elevator")
# Quantities that make others needless.
_INSTEAD = INSTEAD | {_ANGLE: _RATE}
# Last parts of addresses, as of ROS topics, that do not name the quantity.
_SAYS_NOTHING = re.compile(r"\.(position|data|value|angle|output)(\[0\])?$").search
_LARGEST = {
    ("position", "x"): {"m": 100.0, "cm": 1000.0, "mm": math.inf},
    ("attitude", *EULER): {"rad": 2.0 * np.pi, "deg": math.inf},
    ("elevator",): {"rad": 0.5 * np.pi, "deg": math.inf},
    (_ANGLE,): {"rad": 0.5 * np.pi, "deg": math.inf},
    (_RATE,): {"rad/s": 50.0, "deg/s": math.inf},
}
"""Of quantities with one unit, the largest number in each: the first unit that admits
all numbers is taken. Heights and y may have any origin."""
_SI = {"length": "m", "angle": "rad", "rate": "rad/s"}
_PULSES = (500.0, 2500.0)  # Widths that servos take, and angles are not [us].
_PULSE_SCALE = "{gain: 0.00157, zero: 1500}"  # Of most: a quarter turn in 1000 us.

_Columns = dict[str, Any]  # By quantity: names, of times a list.


def usable_names(log: Recording) -> list[str]:
    """Lists the addresses of columns that can be used.

    A column is left out where a cell is no number, unless all are labels. Those of
    joined files, whose groups are named by patterns, have no group in their address.
    """
    names = []
    for group in log.groups:
        is_needed = group.name and "*" not in group.name
        prefix = f"{group.name}." if is_needed else ""
        for name, column in group.columns.items():
            if not column.fault or column.labels:
                names.append(prefix + name)
    return names


def words_of(name: str) -> str:
    """The part of an address that says something, parted by _, without its unit.

    "pose.NorthPosition_mm" gives "north_position", "elevator.data" "elevator_data".
    """
    text = name if _SAYS_NOTHING(name) else name.rpartition(".")[2]
    # Words begin at capitals, as of NorthPosition, and where letters and digits end.
    text = re.sub(r"(?<=[^\W_A-Z])(?=[A-Z])|\W+", "_", text).strip("_").lower()
    return split_suffix(text)[0]


def find_columns(log: Recording) -> _Columns:
    """Finds the columns of a log by their names.

    Returns:
        The address of each quantity that is recognized, in the order of QUANTITIES: the
        common name of a vector's columns, of times a list.
    """
    if {"position", "attitude"} <= log.known.keys():
        return dict(log.known)

    names = usable_names(log)
    columns = _find_vectors(log, names)
    for quantity, stem in columns.items():
        _, used = log.find_all(stem, SHAPES[quantity]) or ("", [])
        names = [name for name in names if name not in used]

    for quantity in _SCALARS:
        found = _find_scalar(quantity, names)
        if found is not None and _INSTEAD.get(quantity) not in columns:
            columns[quantity] = found
            names.remove(found)

    # What several columns tell together.
    if not set(EULER) <= columns.keys():  # Only all three are a rotation.
        columns.pop("roll", None)
        columns.pop("yaw", None)
    if _RATE in columns and _is_angle(log, columns):
        columns[_ANGLE] = columns.pop(_RATE)
    if "x" in columns and "y" in columns and "z" not in columns:  # As of a video.
        columns["z"] = columns.pop("y")

    # A column of times for each group whose format does not fix one.
    times = []
    for group in log.groups:
        own = [n for n in group.columns if re.search(_NAMES["time"], words_of(n))]
        if own and not group.time:
            times.append(own[0])
    if times:
        columns["time"] = list(dict.fromkeys(times))
    return {name: columns[name] for name in QUANTITIES if name in columns}


def _find_vectors(log: Recording, names: Sequence[str]) -> _Columns:
    """Finds an attitude and a position by the common beginning of their columns.

    Of several positions one beside the attitude is taken (pose.p with pose.q), then the
    one that travels most: the glider, not the wand on the floor.

    Args:
        log: the recording.
        names: addresses of its columns.

    Returns:
        The common beginning by quantity, of those that are found.
    """
    # What precedes the first index or axis: q of q[0], pos of pos_x, pos of posX.
    bare = [split_suffix(name)[0] for name in names]
    firsts = [re.fullmatch(r"(.+?)(\[?0\]?|[._ ]?[xX])", name) for name in bare]
    stems = dict.fromkeys(first[1] for first in firsts if first)

    columns: _Columns = {}
    for quantity, shapes in SHAPES.items():
        fits = []
        for stem in stems:
            is_named = re.search(_NAMES[quantity], stem, re.IGNORECASE)
            is_used = stem in columns.values()  # As qx of pose.x, ..., pose.qx.
            if is_named and not is_used and log.find_all(stem, shapes):
                fits.append(stem)
        owner = columns.get("attitude", "").rpartition(".")[0]
        own = [stem for stem in fits if owner and f"{stem}.".startswith(f"{owner}.")]
        if fits:
            columns[quantity] = max(own or fits, key=lambda stem: _travel(log, stem))
    return columns


def _travel(log: Recording, stem: str) -> float:
    """Sum of the magnitudes of all changes in a vector's columns."""
    values, _ = _values(log, stem)
    return np.nansum(np.abs(np.diff(values)))


def _find_scalar(quantity: str, names: Sequence[str]) -> str | None:
    """Finds the first of some columns whose name fits a quantity."""
    is_angle = quantity in ("elevator", *EULER)
    for name in names:
        words = words_of(name)
        if is_angle and re.search(_NOT_AN_ANGLE, words):
            continue
        if re.search(_NAMES[quantity], words):
            return name
    return None


def _is_angle(log: Recording, columns: _Columns) -> bool:
    """Whether commands are angles: by their unit, their name, or as the elevator moves.

    Without a unit and a word for rates, commands are angles if they correlate more with
    the elevator's angle than with its changes from row to row.
    """
    name = columns[_RATE]
    command, unit = _values(log, name)
    if unit or _are_pulses(command):
        return unit in (None, "deg", "rad")
    if "elevator" not in columns or re.search(_IS_RATE, words_of(name)):
        return False
    angle, _ = _values(log, columns["elevator"])
    if len(angle) != len(command):
        return False

    logged = np.stack([command, np.gradient(angle), angle])
    known = logged[:, np.isfinite(logged).all(axis=0)]
    with np.errstate(invalid="ignore", divide="ignore"):
        _, to_rate, to_angle = np.abs(np.corrcoef(known)[0])
    return to_angle > to_rate


def _values(log: Recording, name: str) -> tuple[np.ndarray, str | None]:
    """Returns values of a vector (k, n) or a scalar (n,), and their unit.

    The values are as logged, and the unit is None where the file reports none.
    """
    _, names = log.find_all(name, ("xyz", "012")) or ("", [name])
    _, columns = log.find_each(names, name)
    return np.squeeze([column.values for column in columns]), columns[0].unit


def guess_units(logs: Sequence[Recording], columns: _Columns) -> dict[str, str]:
    """Guesses units that the files do not report, by the ranges of the columns.

    Args:
        logs: recordings with the same columns.
        columns: addresses by quantity.

    Returns:
        For fields of `units:` a unit, or a scale, as YAML with the reason in a comment.
        Those of SI are left out, unless they may be confused with others of the same
        kind.
    """
    # Logs have 5 to 5000 rows in a second.
    units = {}
    if "time" in columns:
        values, unit = _values(logs[0], columns["time"][0])
        step = np.nanmedian(np.diff(values))
        fits = [u for u, size in UNITS["time"].items() if 2e-4 < step * size < 0.2]
        if unit is None and fits and fits[0] != "s":
            units["time"] = f"{fits[0]}  # its median step is {step:.4g}"

    found = {}
    for quantities, largest in _LARGEST.items():
        own = {name: columns[name] for name in quantities if name in columns}
        if own:
            found.update(dict.fromkeys(own, _guess_unit(logs, own, largest)))

    # A unit of SI is stated, with a question mark, where another of its kind is not.
    not_si = {
        QUANTITIES[quantity]
        for quantity, (unit, _) in found.items()
        if unit != _SI[QUANTITIES[quantity]]
    }
    for quantity, (unit, why) in found.items():
        kind = QUANTITIES[quantity]
        if why and kind in not_si:
            field = "length" if kind == "length" else quantity
            doubt = "? " if unit == _SI[kind] else ""
            units[field] = f"{unit}  # {doubt}{why}"
    return units


def _guess_unit(
    logs: Sequence[Recording], columns: _Columns, largest: dict[str, float]
) -> tuple[str, str]:
    """Guesses the unit that some columns have in common.

    Args:
        logs: recordings with these columns.
        columns: addresses by quantity, one or more.
        largest: the largest number in each unit, smaller numbers first.

    Returns:
        The unit, or the scale of a servo's pulses, and the reason: "" where the file
        reports the unit.
    """
    read = [_values(log, name) for name in columns.values() for log in logs]
    _, unit = read[0]
    if unit is not None:
        return unit, ""

    sizes = np.concatenate([np.abs(values).ravel() for values, _ in read])
    reach = float(np.nanmax(sizes, initial=0.0))
    first = next(iter(columns))
    why = f"'{first}' reaches {reach:.4g}"
    if first in ("elevator", _ANGLE) and _are_pulses(sizes):
        return (
            _PULSE_SCALE,
            f"? {why}: microseconds, and gain is the angle of one in rad",
        )
    return next(unit for unit, most in largest.items() if reach <= most), why


def _are_pulses(values: np.ndarray) -> bool:
    """Whether numbers (n,) are pulse widths of a servo in microseconds."""
    known = values[np.isfinite(values)]
    low, high = _PULSES
    return len(known) > 0 and low < np.min(known) and np.max(known) < high
