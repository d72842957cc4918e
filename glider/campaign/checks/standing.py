"""Rows of a log that are no flight: the glider lies on the floor, or in a hand.

A body in free fall cannot stay where it is: from rest it falls 18 mm in 60 ms. Air
takes energy from a glider: what accelerates it along its path is a hand.
"""

import numpy as np

from glider.campaign.checks.masks import stretches
from glider.campaign.checks.motion import calc_motion
from glider.campaign.logs import Flight

_HALF = 0.06  # Half of the time over which a glider must stay where it is [s].
_PLACE = 0.008  # ... within this of its middle [m]; free fall from rest: 0.018.
_SHORTEST = 0.06  # Rows that lie must last, at least [s].
_SLIDE = 0.003  # Height within which a glider slides before it lies [m].
_HAND = 6.0
"""Force per mass along the path, above that of the flight's second half, that only a
hand exerts [m/s²]; wind, drag and a thrust of half the weight stay below."""
_THROW = 16.0
"""The same of the acceleration, where the direction of gravity is unknown and the log
does not start from rest: a dive has 9.8 [m/s²]."""
_REST = 1.0  # Slower than this a log starts from rest: in a hand [m/s].
_HAND_GAIN = 1.3  # Ratio of the speeds when a hand lets go and at the log's start.
_LATER = 0.5  # From this share of the log on the force is "usual".


def find_standing(flight: Flight, usable: np.ndarray) -> np.ndarray:
    """Rows (n,), True where the glider lies still, or slides until it does.

    Where most of the way follows, it has not been thrown yet; otherwise it has landed.
    """
    standing = np.zeros(len(usable), dtype=bool)
    rows = np.flatnonzero(usable)
    if len(rows) < 3:
        return standing
    time, place = flight.time[rows], flight.pose[rows, :2]
    still = np.zeros(len(rows), dtype=bool)
    first = np.searchsorted(time, time - _HALF - 1e-9)
    last = np.searchsorted(time, time + _HALF + 1e-9) - 1
    for ends in (first, last):
        still |= np.hypot(*(place[ends] - place).T) > _PLACE
    # At an end of the log one side is enough, if there are rows enough on it.
    long = time[last] - time[first] > 0.75 * _HALF
    still = ~still & long
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(place, axis=0).T))])
    for a, b in stretches(still):
        if time[b] - time[a] < _SHORTEST:
            continue
        if way[a] < 0.5 * way[-1]:
            standing[: rows[b] + 1] = True
        else:
            level = np.abs(place[:, 1] - np.median(place[a : b + 1, 1])) < _SLIDE
            before = np.flatnonzero(~level[:a])
            standing[rows[before[-1] + 1 if len(before) else 0] :] = True
    return standing


def find_hand(flight: Flight, usable: np.ndarray, gravity: float | None) -> np.ndarray:
    """Rows (n,), True at the start, where a hand still accelerates the glider.

    A thrust, wind or a tilted frame push throughout; a hand lets go. So the force
    along the path is compared with that of the flight's second half. Gravity is None
    where its direction is unknown: then only a throw that is stronger shows.
    """
    held = np.zeros(len(usable), dtype=bool)
    motion = calc_motion(flight.time[usable], flight.pose[usable])
    if len(motion.time) < 8:
        return held
    speed = np.maximum(motion.speed, 1e-3)
    force = motion.acceleration[:, :2] + np.array([0.0, gravity or 0.0])
    along = np.sum(force * motion.velocity[:, :2], axis=1) / speed
    middle = motion.time[0] + _LATER * (motion.time[-1] - motion.time[0])
    usual = np.median(along[motion.time >= middle])
    least = _THROW if gravity is None and speed[0] > _REST else _HAND
    pushes = along - max(float(usual), 0.0) > least
    if not pushes[0]:
        return held
    free = len(pushes) if pushes.all() else int(np.argmin(pushes))
    if free == len(pushes) or speed[free] < _HAND_GAIN * speed[0]:
        return held
    # The cubics see the hand until their windows are past it.
    half = motion.time[0] - flight.time[usable][0]
    held[flight.time <= motion.time[free] + half] = True
    return held
