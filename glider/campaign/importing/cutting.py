"""The cutting step: flights, from release to contact, out of a long recording.

A glider in flight moves and loses energy to the air; a hand adds energy, and an impact
shows as a jump of the velocity. So a recording is split where the body is not seen,
stands still or is frozen; each part that moves is searched for the last push of a hand
and for the first jump of the velocity. A throw in which the body is not seen for a
moment is one flight: in a gap too short for another throw it has gained no energy.
"""

import dataclasses
import itertools

import numpy as np

from glider.campaign.checks.masks import find_repeats, stretches
from glider.campaign.checks.motion import PUSH, SPAN, Drive, calc_drive
from glider.campaign.checks.rows import FILLED, find_filled, find_stale, measure_noise
from glider.campaign.checks.smoothness import Rows, find_one_motion
from glider.campaign.importing.track import Track, planar_pose, take, turn_along

_BEST_GLIDE = 60.0
"""Ratio of path to height that no glider exceeds in still air: what loses less energy
has a motor, or rises with the air."""
_LONG = 3.0
"""Duration above which that is asked [s]: at 10 m/s the air then takes 5 J/kg at least,
and a speed that is 0.1 m/s wrong at an end makes an error of 1."""
_SLOWEST_LOG = 0.06
"""Time between rows above which they are too few [s]: seven make a cubic, and a pitch
oscillation lasts half a second."""
_MAX_GAP = 0.1
"""Time without the body that splits a recording [s], unless it flies on meanwhile."""

_EQUAL_ROWS = 3  # As many equal positions are frozen: the body is lost.
_SLOWEST = 0.7  # Speed of a flight, at least [m/s].
_FASTEST = 2.5  # Speed that a flight must reach: people walk at 1.5 [m/s].
_FREE = 1.0  # Force along the path below which the hand has let go [m/s²].
_THROW = 0.5  # Time before its release in which a hand has accelerated the body [s].
_AFTER_RELEASE = 0.05  # Also cut after the hand lets go: fingers touch the tail [s].
_BEFORE_CONTACT = 0.06  # Time before a contact that is cut as well [s].
_STOPPED = 0.75  # Part of its speed that a body keeps at most that slides.
_SHORTEST = 0.2  # Duration of a flight, at least [s].
_MIN_ROWS = 20


def cut(track: Track, gravity: float) -> tuple[list[Track], list[str]]:
    """Finds the flights of a recording.

    Args:
        track: the recording, n rows.
        gravity: [m/s²]

    Returns:
        The flights in their order, each with the reason for its beginning and end in
        `why`; and notes on what was omitted: parts without a flight, and rows.
    """
    # A frozen pose stands for a body that is lost. Rows that are logged again or were
    # filled in show nothing new.
    frozen = find_repeats(track.position, _EQUAL_ROWS)
    repeated = frozen | find_stale(track.time, track.position)
    filled = find_filled(track.time, track.position) & ~repeated
    kept = ~(repeated | filled)
    seen = take(track, kept)
    if not len(seen.time):
        return [], [*track.notes, "the body is never seen"]
    step = np.median(np.diff(seen.time)) if len(seen.time) > 1 else 0.0
    if step > _SLOWEST_LOG:
        return [], [
            f"the poses were logged every {step:.3g} s; expected {_SLOWEST_LOG:g} s or "
            "less"
        ]

    # Each part in which the body moves may have one flight.
    flights = []
    notes = [*track.notes]
    drive = calc_drive(seen.time, seen.position, gravity)
    log_end = track.time[kept | frozen][-1]
    parts = _find_parts(drive)
    for first, last in parts:
        rows = slice(first, last + 1)
        part = take(seen, rows)
        margin = _calc_margin(seen.time, last, log_end)
        found = _find_flight(part, drive.take(rows), gravity, margin)
        if isinstance(found, Track):
            flights.append(found)
        else:
            begin, end = part.span
            notes.append(f"{begin:.3f}-{end:.3f} s: {found}")

    if not parts and not notes:
        reach = np.max(np.ptp(seen.position, axis=0))
        notes.append(f"nothing moves like a flight: all is within {reach:.2g} m")
    dropped = {"that repeat the pose before": repeated, FILLED: filled}
    for why, flags in dropped.items():
        if flags.any():
            notes.append(f"{np.sum(flags)} rows {why}: they are dropped")
    return flights, notes


def _find_parts(drive: Drive) -> list[tuple[int, int]]:
    """First and last row of each part in which the body is seen and moves.

    A part does not go on beyond a gap, unless the body flies on in it.
    """
    time = drive.time
    moves = drive.speed > _SLOWEST

    # Gaps are known by the rows at which they end.
    gaps = (np.flatnonzero(np.diff(time) > _MAX_GAP) + 1).tolist()
    edges = [0, *gaps, len(time)]
    breaks = [
        gap
        for before, gap, after in zip(edges, gaps, edges[2:], strict=False)
        if not _flies_on(drive, before, gap, after)
    ]

    parts = []
    for start, end in itertools.pairwise([0, *breaks, len(time)]):
        if end - start >= _MIN_ROWS:
            for i, j in stretches(moves[start:end]):
                first = start + i
                last = start + j
                if time[last] - time[first] > 0.5 * _SHORTEST:
                    parts.append((first, last))
    return parts


def _flies_on(drive: Drive, before: int, gap: int, after: int) -> bool:
    """Whether the body flies on in a gap, in which it is not seen.

    A hand that caught it and threw it again took as long as a throw, and gave it
    energy. The body must be fast on either side of the gap; what is seen of it there
    must be longer than the span of a cubic, or its speed and energy are not known.

    Args:
        drive: of the recording.
        before: row at which the gap before ends; 0 for the first gap.
        gap: row at which the gap ends.
        after: row at which the gap after ends; the number of rows for the last gap.
    """
    time = drive.time
    is_short = time[gap] - time[gap - 1] <= _THROW
    seen_before = time[gap - 1] - time[before]
    seen_after = time[after - 1] - time[gap]
    is_shown = min(seen_before, seen_after) > SPAN
    is_fast = min(drive.speed[gap - 1 : gap + 1]) > _SLOWEST
    is_free = not _is_driven(drive, gap - 1, gap)
    return is_short and is_shown and is_fast and is_free


def _is_driven(drive: Drive, first: int, last: int) -> bool:
    """Whether a hand gives the body energy between two rows.

    It does if the energy per mass grows by more than half of a hand's least push,
    `PUSH`, times the way.
    """
    gained = drive.energy[last] - drive.energy[first]
    way = drive.way[last] - drive.way[first]
    return gained > 0.5 * PUSH * way


def _calc_margin(time: np.ndarray, last: int, log_end: float) -> float:
    """Time before the last row of a part that a flight must not include [s].

    A part that ends before the log does may end with a contact, after which the body
    is lost or stands.

    Args:
        time: (n,) of the rows in which the body is seen [s].
        last: last row of the part.
        log_end: time of the last row of the log, in which the pose may be frozen [s].
    """
    if time[last] >= log_end:
        return 0.0
    if np.any(time[last + 1 : last + 2] - time[last] <= _MAX_GAP):
        # It is seen on, but slow: the cubics see a stop up to half of their span late.
        return _BEFORE_CONTACT + 0.5 * SPAN
    return _BEFORE_CONTACT


def _find_flight(
    part: Track, drive: Drive, gravity: float, margin: float
) -> Track | str:
    """Finds the flight in a part in which the body moves throughout.

    It begins after the last push of a hand, or with the part. It ends before the first
    contact, or with the part, less a margin.

    Args:
        part: k rows.
        drive: of these rows.
        gravity: [m/s²]
        margin: time before the part's end that is cut at least [s].

    Returns:
        The flight, or the reason why there is none.
    """
    if len(part.time) < _MIN_ROWS:
        return "too short for a flight"
    fastest = np.max(drive.speed)
    if fastest < _FASTEST:
        return f"never faster than {fastest:.2g} m/s: carried, or rolling"

    begin = part.time[0]
    start = "the body is seen from here on"
    release = _find_release(drive)
    if release is not None:
        begin = release + _AFTER_RELEASE
        start = f"a hand lets go at {release:.3f} s"
    free = take(part, part.time >= begin)
    if len(free.time) < _MIN_ROWS:
        return "the hand never lets go"

    end = free.time[-1] - margin
    stop = "the body is seen, and moves, until here"
    contact = _find_contact(free)
    if contact is not None:
        end = min(contact - _BEFORE_CONTACT, end)
        stop = f"it touches something at {contact:.3f} s"
    elif margin:
        stop = f"the body is lost, or stands, at {free.time[-1]:.3f} s"
    flight = take(free, free.time <= end + 1e-9)
    if len(flight.time) < _MIN_ROWS or np.ptp(flight.time) < _SHORTEST:
        return f"less than {_SHORTEST} s of free flight"

    # A glider loses energy to the air, and more than in its best glide.
    flown = drive.take((drive.time >= begin) & (drive.time <= end))
    if np.median(flown.push) > _FREE:
        return "something pushes it throughout"
    lost = flown.energy[0] - flown.energy[-1]
    way = np.ptp(flown.way)
    if np.ptp(flight.time) > _LONG and lost * _BEST_GLIDE < gravity * way:
        return (
            f"it loses {max(lost, 0.0):.2g} J/kg in {way:.3g} m, less than any glider: "
            "a motor drives it, or it rises with the air; expected gliding flight"
        )
    return dataclasses.replace(flight, why=f"{start}; {stop}")


def _find_release(drive: Drive) -> float | None:
    """Time at which the hand lets go [s]; None where no hand is seen.

    A hand has given the body energy until then. A force that noise or a gust shows for
    a moment has not. So the last push before the highest energy counts that has done
    work in the time of a throw.
    """
    time = drive.time
    highest = np.argmax(drive.energy)
    pushed = np.flatnonzero(drive.push[: highest + 1] > PUSH)
    for last in pushed[::-1]:
        # The first row at which it is free, and the one at which a throw began.
        free = last + int(np.argmax(drive.push[last:] < _FREE))
        first = int(np.searchsorted(time, time[free] - _THROW))
        if _is_driven(drive, first, free):
            return float(time[free])
    return None


def _find_contact(flight: Track) -> float | None:
    """Time at which the velocity jumps [s]; None where it does not.

    The most rows that can be one smooth motion end with the contact. After a long slide
    they may begin with it: the contact is then searched for before them.
    """
    pose = planar_pose(turn_along(flight))
    rows = Rows(flight.time, pose, measure_noise(flight.time, pose))
    faults = find_one_motion(rows, np.ones(len(pose), dtype=bool))
    smooth = np.flatnonzero(~np.any(faults, axis=0))
    if not len(smooth):
        return None

    first = smooth[0]
    if flight.time[first] - flight.time[0] > _SHORTEST and _slows_down(flight, first):
        before = take(flight, slice(first))
        contact = _find_contact(before)
        return float(before.time[-1]) if contact is None else contact

    after = smooth[-1] + 1
    return float(flight.time[after]) if after < len(pose) else None


def _slows_down(flight: Track, row: int) -> bool:
    """Whether a body is as much slower from a row on as one that slides."""
    steps = np.linalg.norm(np.diff(flight.position, axis=0), axis=1)
    speed = steps / np.diff(flight.time)
    before = np.median(speed[:row])
    after = np.median(speed[row:])
    return bool(after < _STOPPED * before)
