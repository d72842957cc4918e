"""Which axes does a log have? Frames ranked by forces, attitude and habits.

A frame specifies which axis of the log points up, how rotations are read, and which
axes of the body point to its nose and up. Three things make it likely:

- habits: formats and names of columns have usual axes;
- forces: in the axes of the body, what gravity does not explain of an acceleration is
  M |v| v, with a matrix M of forces that is like that of foam gliders. How well this
  fits is compared with any motion (a hand, a contact): a frame must explain many rows;
- attitude: gliders fly nose ahead and upright, each flight on the average.

Rows and flights of one glider repeat the errors of this model: they count less than
independent ones (benchmarks/bench_guess.py measures how often a certain frame is
wrong).
"""

import itertools
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import softmax

from glider.campaign.checks.motion import SPAN, calc_motion
from glider.campaign.importing.cutting import cut
from glider.campaign.importing.picking import make_track
from glider.campaign.importing.recording import Recording
from glider.campaign.importing.track import turn_along
from glider.campaign.settings import AXES, ColumnMapping, unit_vector
from glider.physics.parameters import GliderParameters

_Fields = dict[str, str]  # Fields of `frame:`.


class _Flight(NamedTuple):
    """k rows of a flight, in the axes of the body as they are logged."""

    flow: np.ndarray  #: (k, 3) |v| v [m²/s²].
    force: np.ndarray  #: (k, 3) acceleration without gravity [m/s²].
    above: np.ndarray  #: (k, 3) direction that is up.


_GRAVITY = GliderParameters().gravity
_UP = {"z": 0.45, "y": 0.25, "-z": 0.2, "-y": 0.05, "x": 0.025, "-x": 0.025}
"""Prior of the axis that points up where the format has no usual one."""
_USUAL = 0.9  # Prior of the usual axis of a format or a name.
_FORCES = np.diag([-0.1, -0.1, -0.8])
_SPREADS = np.array([[0.1, 0.05, 0.15], [0.05, 0.15, 0.05], [0.15, 0.05, 0.6]])
"""Prior of M and its deviations, rows and columns to nose, left and top [1/m]: foam
gliders have a normal force of 0.5 to 1.4, an axial one of 0.06, a camber of 0.1."""
_NOISE = 1.0  # Of accelerations, in the weight of the prior [m/s²].
_LEAST = 0.5  # Deviation of accelerations below which no frame is better [m/s²].
_ANY = 10.0  # Deviation of accelerations in a hand or at a contact [m/s²].
_FAST = 0.8  # Quantile of steps above which a body flies: not in a hand.
_TOWARD = 3.0
"""Concentration (von Mises-Fisher) of mean paths at the nose and of the vertical at
the top of the body: 40 degrees off are usual."""
_SIDEWAYS = 0.3  # Deviation of both toward the wing tips, where they are less off.
_STEP = 0.5 * SPAN  # Time between rows [s].
_MEMORY = 0.2  # Time over which errors of this model persist [s].
_SHARED = 0.2  # Correlation of the model's errors between flights of one glider.
_KNOWN_BODY = ("x", "z")  # Nose and top where they are known.
_MOST = 12  # Flights that are judged.
_DIGITS = 6  # Of log likelihoods: two readings that agree in them are one.


def rank_frames(
    logs: Sequence[Recording],
    claim: Callable[[_Fields], ColumnMapping],
    readings: Sequence[tuple[_Fields, float]],
    usual: str,
) -> list[tuple[_Fields, float]]:
    """Frames with their probabilities, the best first; none where there is no flight.

    Readings are fields that say how angles are read, each with its prior, the likeliest
    first; `usual` is the axis that points up in most logs like these, or "".
    """
    worlds = [{"up": up} for up in AXES]
    tracks = [make_track(log, claim(worlds[0] | readings[0][0])) for log in logs]
    if not tracks[0].along_throw:
        # The columns are x and z, and x goes the way of the flights.
        steps = np.concatenate([np.diff(track.position[:, 0]) for track in tracks])
        sizes = np.abs(steps)
        fast = steps[sizes >= np.quantile(sizes, _FAST)] if len(steps) else steps
        forward = "-x" if np.sum(np.sign(fast)) < 0.0 else "x"
        worlds = [{"up": up, "forward": forward} for up in ("z", "-z")]
    is_known = not tracks[0].spatial or "top" in readings[0][0]
    bodies = [b for b in itertools.product(AXES, AXES) if b[0][-1] != b[1][-1]]
    found: dict[tuple, tuple[_Fields, float]] = {}
    for world, (reading, prior) in itertools.product(worlds, readings):
        up = world["up"]
        habit = _UP[up]
        if usual:
            habit = _USUAL if up == usual else (1.0 - _USUAL) * habit / (1 - _UP[usual])
        flights = fly_all(logs, claim(world | reading))
        for nose, top in [_KNOWN_BODY] if is_known else bodies:
            if flights:
                score = judge(flights, up, nose, top)
                body = {} if is_known else {"nose": nose, "top": top}
                frame = world | reading | body, score + math.log(prior * habit)
                found.setdefault((up, nose, top, round(score, _DIGITS)), frame)
    ranked = sorted(found.values(), key=lambda frame: -frame[1])
    shares = softmax([score for _, score in ranked]) if ranked else []
    return [(own, float(p)) for (own, _), p in zip(ranked, shares, strict=True)]


def fly_all(logs: Sequence[Recording], mapping: ColumnMapping) -> list[_Flight]:
    """The flights in recordings as a mapping reads them, as many as are judged."""
    flights = []
    for log in logs:
        track = make_track(log, mapping)
        pieces, _ = cut(track, _GRAVITY)
        for piece in pieces:
            flown = piece if track.spatial else turn_along(piece)
            stride = max(1, round(_STEP / float(np.median(np.diff(flown.time)))))
            motion = calc_motion(flown.time, flown.position, stride=stride)
            turns = track.rotation[np.isin(track.time, motion.time)]
            speed = np.linalg.norm(motion.velocity, axis=1, keepdims=True)
            pull = motion.acceleration + _GRAVITY * unit_vector("z")
            flow = np.einsum("nji,nj->ni", turns, speed * motion.velocity)
            force = np.einsum("nji,nj->ni", turns, pull)
            flights.append(_Flight(flow, force, turns[:, 2]))
    return flights[:_MOST]


def judge(
    flights: Sequence[_Flight],
    up: str = "z",
    nose: str = _KNOWN_BODY[0],
    top: str = _KNOWN_BODY[1],
) -> float:
    """Log probability of a frame with these axes of the body, up to a constant."""
    ahead = unit_vector(nose)
    over = unit_vector(top)
    left = np.cross(over, ahead)
    body = np.stack([ahead, left, over], axis=1)
    ways = [np.sum(flight.flow, axis=0) for flight in flights]
    path = np.mean([way / np.linalg.norm(way) for way in ways], axis=0) @ body
    above = np.mean([np.mean(flight.above, axis=0) for flight in flights], axis=0)
    above = above @ body
    flow = np.concatenate([flight.flow for flight in flights])
    force = np.concatenate([flight.force for flight in flights])
    count = len(flights)
    # Rows and flights repeat the errors of this model.
    score = _STEP / _MEMORY / count * _explain(flow @ body, force @ body)
    score += _TOWARD * (path[0] + above[2])
    score -= 0.5 * (path[1] ** 2 + above[1] ** 2) / _SIDEWAYS**2
    score *= count / (1.0 + _SHARED * (count - 1))
    # Bodies are often defined as they lie upright, or with x ahead.
    usual = 0.1 * (top == up) + 0.2 * (nose == "x" and top[-1] == "z") + 0.008
    return float(score) + math.log(usual)


def _explain(flow: np.ndarray, force: np.ndarray) -> float:
    """Log likelihood of forces by a flow, over that of any motion; (k, 3) each.

    Their columns are to the nose, left and top.
    """
    left = 0.0
    for own, mean, spread in zip(force.T, _FORCES, _SPREADS, strict=True):
        rest = own - flow @ mean
        scaled = flow * spread
        square = scaled.T @ scaled + _NOISE**2 * np.eye(3)
        fitted = np.linalg.solve(square, scaled.T @ rest)
        left += rest @ (rest - scaled @ fitted)
    variance = max(left / force.size, _LEAST**2)
    return 0.5 * force.size * math.log(_ANY**2 / variance)
