"""The cutting step: flights, from release to contact, out of a long recording.

A glider in flight moves and loses energy to the air; a hand adds energy, and an impact
shows as a jump of the velocity. So a recording is split where the body is not seen,
stands still or is frozen; each part that moves is searched for the last push of a hand
and for the first jump of the velocity.
"""

from typing import NamedTuple

import numpy as np

from glider.campaign.checks.masks import find_repeats, stretches
from glider.campaign.checks.motion import Motion, calc_motion, robust_std
from glider.campaign.checks.smoothness import Track as Rows
from glider.campaign.checks.smoothness import find_one_motion, fourth_differences
from glider.campaign.importing.track import Track, planar_pose, take

_MAX_GAP = 0.1  # Time without the body that splits a recording [s].
_EQUAL_ROWS = 3  # As many equal positions are frozen: the body is lost.
_SLOWEST = 0.7  # Speed of a flight, at least [m/s].
_FASTEST = 2.5  # Speed that a flight must reach: people walk at 1.5 [m/s].
_PUSH = 6.0  # Force along the path that only a hand exerts [m/s²].
_FREE = 1.0  # Force along the path below which the hand has let go [m/s²].
_AFTER_RELEASE = 0.05  # Also cut after the hand lets go: fingers touch the tail [s].
_BEFORE_CONTACT = 0.06  # Time before a contact that is cut as well [s].
_SHORTEST = 0.2  # Duration of a flight, at least [s].
_MIN_ROWS = 20


class Cut(NamedTuple):
    """One flight of a recording."""

    track: Track
    why: str  # It begins and ends where it does.


def cut(track: Track, gravity: float) -> tuple[list[Cut], list[str]]:
    """Finds the flights of a recording in their order; notes what was omitted."""
    flights, notes = [], []
    seen = ~find_repeats(track.position, _EQUAL_ROWS)
    for first, last in _parts(track, seen):
        part = take(track, slice(first, last + 1))
        is_lost = last + 1 < len(seen) and (
            not seen[last + 1] or track.time[last + 1] - track.time[last] > _MAX_GAP
        )
        found = _find_flight(part, gravity, is_lost=is_lost)
        span = f"{part.time[0]:.3f}-{part.time[-1]:.3f} s"
        if isinstance(found, Cut):
            flights.append(found)
        else:
            notes.append(f"{span}: {found}")
    if not len(seen):
        notes.append("the body is never seen")
    if lost := int(np.sum(~seen)):
        notes.append(f"{lost} rows that repeat the one before: the body was lost")
    return flights, notes


def _parts(track: Track, seen: np.ndarray) -> list[tuple[int, int]]:
    """First and last row of each part in which the body is seen and moves."""
    rows = np.flatnonzero(seen)
    time, position = track.time[rows], track.position[rows]
    breaks = np.flatnonzero(np.diff(time) > _MAX_GAP) + 1
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


def _find_flight(part: Track, gravity: float, *, is_lost: bool) -> Cut | str:
    """The flight in a part in which the body moves throughout, or why there is none."""
    motion = calc_motion(part.time, part.position)
    if len(motion.time) < 8:
        return "too short for a flight"
    speed = np.linalg.norm(motion.velocity, axis=1)
    if np.max(speed) < _FASTEST:
        return f"never faster than {np.max(speed):.2g} m/s: carried, or rolling"
    force = motion.acceleration + np.array([0.0, 0.0, gravity])
    push = np.sum(force * motion.velocity, axis=1) / np.maximum(speed, 1e-3)
    begin, start = part.time[0], "the body is seen from here on"
    release = _find_release(motion, gravity * motion.pose[:, 2] + 0.5 * speed**2, push)
    if release is not None:
        begin, start = release + _AFTER_RELEASE, f"a hand lets go at {release:.3f} s"
    after = part.time >= begin
    if np.sum(after) < _MIN_ROWS:
        return "the hand never lets go"
    free = take(part, after)
    end, stop = free.time[-1], "the body is seen, and moves, until here"
    contact = _find_contact(free)
    if contact is None and is_lost:
        end -= _BEFORE_CONTACT
        stop = f"the body is lost at {free.time[-1]:.3f} s"
    elif contact is not None:
        end, stop = (
            contact - _BEFORE_CONTACT,
            f"it touches something at {contact:.3f} s",
        )
    flight = take(free, free.time <= end + 1e-9)
    if len(flight.time) < _MIN_ROWS or flight.time[-1] - flight.time[0] < _SHORTEST:
        return f"less than {_SHORTEST} s of free flight"
    inside = (motion.time >= begin) & (motion.time <= end)
    if not inside.any() or np.median(push[inside]) > _FREE:
        return "something pushes it throughout"
    return Cut(flight, f"{start}; {stop}")


def _find_release(motion: Motion, energy: np.ndarray, push: np.ndarray) -> float | None:
    """Time at which the hand lets go [s]; None where no hand is seen."""
    peak = int(np.argmax(energy))
    pushed = np.flatnonzero(push[: peak + 1] > _PUSH)
    if not len(pushed):
        return None
    free = pushed[-1] + np.argmax(push[pushed[-1] :] < _FREE)
    return float(motion.time[free])


def _find_contact(flight: Track) -> float | None:
    """Time at which the velocity jumps [s]; None where it does not."""
    pose = planar_pose(flight)
    differences, _ = fourth_differences(flight.time, pose)
    if not len(differences):
        return None
    rows = Rows(flight.time, pose, robust_std(differences))
    _, displaced = find_one_motion(rows, np.ones(len(pose), dtype=bool))
    first, last = (stretches(displaced) or [(0, 0)])[-1]
    at_end = first > 0 and last == len(displaced) - 1
    return float(flight.time[first]) if at_end else None
