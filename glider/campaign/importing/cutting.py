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
from glider.campaign.checks.motion import SPAN, Motion, calc_motion, robust_std
from glider.campaign.checks.rows import FILLED, find_filled, find_stale
from glider.campaign.checks.smoothness import Rows, find_one_motion, fourth_differences
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
_PUSH = 6.0  # Force along the path that only a hand exerts [m/s²].
_FREE = 1.0  # Force along the path below which the hand has let go [m/s²].
_THROW = 0.5  # Time before its release in which a hand has accelerated the body [s].
_AFTER_RELEASE = 0.05  # Also cut after the hand lets go: fingers touch the tail [s].
_BEFORE_CONTACT = 0.06  # Time before a contact that is cut as well [s].
_STOPPED = 0.75  # Part of its speed that a body keeps at most that slides.
_SHORTEST = 0.2  # Duration of a flight, at least [s].
_MIN_ROWS = 20


def cut(track: Track, gravity: float) -> tuple[list[Track], list[str]]:
    """Finds the flights of a recording in their order; notes what was omitted."""
    flights = []
    notes = [*track.notes]
    frozen = find_repeats(track.position, _EQUAL_ROWS)
    again = find_stale(track.time, track.position) & ~frozen
    filled = find_filled(track.time, track.position) & ~(again | frozen)
    is_measured = ~(again | filled)
    track = take(track, is_measured)
    seen = ~frozen[is_measured]
    if not len(seen):
        return [], [*notes, "the body is never seen"]
    step = float(np.median(np.diff(track.time))) if len(seen) > 1 else 0.0
    if step > _SLOWEST_LOG:
        expected = f"expected {_SLOWEST_LOG:g} s or less"
        return [], [f"the poses were logged every {step:.3g} s; {expected}"]
    parts = _find_parts(track, seen, gravity)
    for first, last in parts:
        part = take(track, first + np.flatnonzero(seen[first : last + 1]))
        margin = 0.0
        if last + 1 < len(seen):
            margin = _BEFORE_CONTACT
            pause = track.time[last + 1] - track.time[last]
            if seen[last + 1] and pause <= _MAX_GAP:
                # It is slow; the cubics see a stop up to half of their span late.
                margin += 0.5 * SPAN
        found = _find_flight(part, gravity, margin)
        span = f"{part.time[0]:.3f}-{part.time[-1]:.3f} s"
        if isinstance(found, Track):
            flights.append(found)
        else:
            notes.append(f"{span}: {found}")
    if not parts and not notes:
        reach = np.max(np.ptp(track.position, axis=0))
        notes.append(f"nothing moves like a flight: all is within {reach:.2g} m")
    repeats = int(np.sum(frozen | again))
    if repeats:
        notes.append(f"{repeats} rows that repeat the pose before: they are dropped")
    if count := int(np.sum(filled)):
        notes.append(f"{count} rows {FILLED}: they are dropped")
    return flights, notes


def _find_parts(
    track: Track, seen: np.ndarray, gravity: float
) -> list[tuple[int, int]]:
    """First and last row of each part in which the body is seen and moves."""
    rows = np.flatnonzero(seen)
    time = track.time[rows]
    position = track.position[rows]
    gaps = (np.flatnonzero(np.diff(time) > _MAX_GAP) + 1).tolist()
    breaks = [gap for gap in gaps if not _flies_on(time, position, gap, gravity)]
    parts = []
    for block in np.split(np.arange(len(rows)), breaks):
        if len(block) < _MIN_ROWS:
            continue
        motion = calc_motion(time[block], position[block])
        if not len(motion.time):
            continue
        speed = np.linalg.norm(motion.velocity, axis=1)
        # The ends of a block have no cubic of their own.
        speed = np.interp(time[block], motion.time, speed)
        for first, last in stretches(speed > _SLOWEST):
            parts.append((int(rows[block[first]]), int(rows[block[last]])))
    return [p for p in parts if track.time[p[1]] - track.time[p[0]] > 0.5 * _SHORTEST]


def _flies_on(time: np.ndarray, position: np.ndarray, gap: int, gravity: float) -> bool:
    """Whether the body flies before a gap, ahead of a row, and after, and between.

    A hand that caught and threw it again took as long as a throw; one that threw it
    gave it energy, as in `_find_release`.
    """
    begin = time[gap - 1]
    end = time[gap]
    if end - begin > _THROW:
        return False
    near = slice(*np.searchsorted(time, [begin - 2.0 * SPAN, end + 2.0 * SPAN]))
    motion = calc_motion(time[near], position[near])
    sides = motion.time <= begin, motion.time >= end
    if not (sides[0].any() and sides[1].any()):
        return False
    ends = np.flatnonzero(sides[0])[-1], np.flatnonzero(sides[1])[0]
    speed = np.linalg.norm(motion.velocity, axis=1)
    energy = gravity * motion.pose[:, 2] + 0.5 * speed**2
    way = np.linalg.norm(motion.pose[ends[1]] - motion.pose[ends[0]])
    gained = energy[ends[1]] - energy[ends[0]]
    return bool(min(speed[[*ends]]) > _SLOWEST and gained <= 0.5 * _PUSH * way)


def _find_flight(part: Track, gravity: float, margin: float) -> Track | str:
    """The flight in a part in which the body moves throughout, or why there is none.

    The margin is the time before the part's end that is cut at least [s].
    """
    motion = calc_motion(part.time, part.position)
    if len(motion.time) < 8:
        return "too short for a flight"
    speed = np.linalg.norm(motion.velocity, axis=1)
    if np.max(speed) < _FASTEST:
        return f"never faster than {np.max(speed):.2g} m/s: carried, or rolling"
    force = motion.acceleration + np.array([0.0, 0.0, gravity])
    push = np.sum(force * motion.velocity, axis=1) / np.maximum(speed, 1e-3)
    energy = gravity * motion.pose[:, 2] + 0.5 * speed**2
    begin = part.time[0]
    start = "the body is seen from here on"
    release = _find_release(motion, energy, push)
    if release is not None:
        begin = release + _AFTER_RELEASE
        start = f"a hand lets go at {release:.3f} s"
    after = part.time >= begin
    if np.sum(after) < _MIN_ROWS:
        return "the hand never lets go"
    free = take(part, after)
    end = free.time[-1]
    stop = "the body is seen, and moves, until here"
    contact = _find_contact(free)
    if contact is None and margin:
        end -= margin
        stop = f"the body is lost, or stands, at {free.time[-1]:.3f} s"
    elif contact is not None:
        end = min(contact - _BEFORE_CONTACT, end - margin)
        stop = f"it touches something at {contact:.3f} s"
    flight = take(free, free.time <= end + 1e-9)
    if len(flight.time) < _MIN_ROWS or flight.time[-1] - flight.time[0] < _SHORTEST:
        return f"less than {_SHORTEST} s of free flight"
    inside = (motion.time >= begin) & (motion.time <= end)
    if not inside.any() or np.median(push[inside]) > _FREE:
        return "something pushes it throughout"
    lost = energy[inside][0] - energy[inside][-1]
    way = np.trapezoid(speed[inside], motion.time[inside])
    long = flight.time[-1] - flight.time[0] > _LONG
    if long and lost * _BEST_GLIDE < gravity * way:
        return (
            f"it loses {max(lost, 0.0):.2g} J/kg in {way:.3g} m, less than any glider: "
            "a motor drives it, or it rises with the air; expected gliding flight"
        )
    return dataclasses.replace(flight, why=f"{start}; {stop}")


def _find_release(motion: Motion, energy: np.ndarray, push: np.ndarray) -> float | None:
    """Time at which the hand lets go [s]; None where no hand is seen.

    A hand has given the body energy until then. A force that noise or a gust shows for
    a moment has not.
    """
    peak = int(np.argmax(energy))
    speed = np.linalg.norm(motion.velocity, axis=1)
    way = np.concatenate([[0.0], np.cumsum(speed[1:] * np.diff(motion.time))])
    for last in np.flatnonzero(push[: peak + 1] > _PUSH)[::-1]:
        free = last + int(np.argmax(push[last:] < _FREE))
        first = int(np.searchsorted(motion.time, motion.time[free] - _THROW))
        if energy[free] - energy[first] > 0.5 * _PUSH * (way[free] - way[first]):
            return float(motion.time[free])
    return None


def _find_contact(flight: Track) -> float | None:
    """Time at which the velocity jumps [s]; None where it does not."""
    pose = planar_pose(turn_along(flight))
    differences, _ = fourth_differences(flight.time, pose)
    if not len(differences):
        return None
    rows = Rows(flight.time, pose, robust_std(differences))
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
