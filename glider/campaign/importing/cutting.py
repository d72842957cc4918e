"""The cutting step: flights, from release to contact, out of a long recording.

A glider in flight moves and loses energy to the air; a hand adds energy, and an impact
shows as a jump of the velocity. So a recording is split where the body is not seen,
stands still or is frozen; each part that moves is searched for the last push of a hand
and for the first jump of the velocity. A throw in which the body is not seen for a
moment is one flight: in a gap too short for another throw it has gained no energy.
"""

import dataclasses

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
    """Finds the flights of a recording in their order; notes what was omitted."""
    frozen = find_repeats(track.position, _EQUAL_ROWS)
    again = find_stale(track.time, track.position) & ~frozen
    filled = find_filled(track.time, track.position) & ~(again | frozen)
    track = take(track, ~(again | filled))
    seen = take(track, ~frozen[~(again | filled)])
    if not len(seen.time):
        return [], [*track.notes, "the body is never seen"]
    step = np.median(np.diff(seen.time)) if len(seen.time) > 1 else 0.0
    if step > _SLOWEST_LOG:
        expected = f"expected {_SLOWEST_LOG:g} s or less"
        return [], [f"the poses were logged every {step:.3g} s; {expected}"]
    flights = []
    notes = [*track.notes]
    drive = calc_drive(seen.time, seen.position, gravity)
    parts = _find_parts(drive)
    for first, last in parts:
        rows = slice(first, last + 1)
        part = take(seen, rows)
        margin = 0.0
        if part.time[-1] < track.time[-1]:
            margin = _BEFORE_CONTACT
            if np.any(seen.time[last + 1 : last + 2] - part.time[-1] <= _MAX_GAP):
                # It is slow; the cubics see a stop up to half of their span late.
                margin += 0.5 * SPAN
        found = _find_flight(part, drive.take(rows), gravity, margin)
        if isinstance(found, Track):
            flights.append(found)
        else:
            begin, end = part.span
            notes.append(f"{begin:.3f}-{end:.3f} s: {found}")
    if not parts and not notes:
        reach = np.max(np.ptp(seen.position, axis=0))
        notes.append(f"nothing moves like a flight: all is within {reach:.2g} m")
    dropped = {"that repeat the pose before": frozen | again, FILLED: filled}
    for why, rows in dropped.items():
        if rows.any():
            notes.append(f"{np.sum(rows)} rows {why}: they are dropped")
    return flights, notes


def _find_parts(drive: Drive) -> list[tuple[int, int]]:
    """First and last row of each part in which the body is seen and moves."""
    time = drive.time
    moves = drive.speed > _SLOWEST
    gaps = (np.flatnonzero(np.diff(time) > _MAX_GAP) + 1).tolist()
    breaks = [gap for gap in gaps if not _flies_on(drive, gap, gaps)]
    parts = []
    for block in np.split(np.arange(len(time)), breaks):
        if len(block) >= _MIN_ROWS:
            for first, last in stretches(moves[block]):
                if np.ptp(time[block[[first, last]]]) > 0.5 * _SHORTEST:
                    parts.append((int(block[first]), int(block[last])))
    return parts


def _flies_on(drive: Drive, gap: int, gaps: list[int]) -> bool:
    """Whether the body flies before and after a gap, which ends at a row, and between.

    A hand that caught and threw it again took as long as a throw; one that threw it
    gave it energy, as in `_find_release`. A moment at an end of the log, or between two
    of its gaps, shows nothing.
    """
    time, speed, way, energy, _ = drive.take(slice(gap - 1, gap + 1))
    gained = energy[1] - energy[0]
    first = drive.time[max((row for row in gaps if row < gap), default=0)]
    last = drive.time[min((row for row in gaps if row > gap), default=0) - 1]
    is_short = time[1] - time[0] <= _THROW
    is_shown = min(time[0] - first, last - time[1]) > SPAN
    flies = min(speed) > _SLOWEST and gained <= 0.5 * PUSH * (way[1] - way[0])
    return bool(is_short and is_shown and flies)


def _find_flight(
    part: Track, drive: Drive, gravity: float, margin: float
) -> Track | str:
    """The flight in a part in which the body moves throughout, or why there is none.

    The margin is the time before the part's end that is cut at least [s].
    """
    if len(part.time) < _MIN_ROWS:
        return "too short for a flight"
    if np.max(drive.speed) < _FASTEST:
        return f"never faster than {np.max(drive.speed):.2g} m/s: carried, or rolling"
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
    a moment has not.
    """
    time, _, way, energy, push = drive
    pushed = np.flatnonzero(push[: np.argmax(energy) + 1] > PUSH)
    for last in pushed[::-1]:
        free = last + int(np.argmax(push[last:] < _FREE))
        first = int(np.searchsorted(time, time[free] - _THROW))
        if energy[free] - energy[first] > 0.5 * PUSH * (way[free] - way[first]):
            return float(time[free])
    return None


def _find_contact(flight: Track) -> float | None:
    """Time at which the velocity jumps [s]; None where it does not."""
    pose = planar_pose(turn_along(flight))
    rows = Rows(flight.time, pose, measure_noise(flight.time, pose))
    faulty = np.any(find_one_motion(rows, np.ones(len(pose), dtype=bool)), axis=0)
    same = np.flatnonzero(~faulty)
    if len(same) and flight.time[same[0]] - flight.time[0] > _SHORTEST:
        steps = np.linalg.norm(np.diff(flight.position, axis=0), axis=1)
        speed = steps / np.diff(flight.time)
        before = take(flight, slice(same[0]))
        # What follows may be a slide, and longer.
        if np.median(speed[same[0] :]) < _STOPPED * np.median(speed[: same[0]]):
            contact = _find_contact(before)
            return float(before.time[-1]) if contact is None else contact
    touched = np.max(same, initial=-1) + 1
    return float(flight.time[touched]) if 0 < touched < len(pose) else None
