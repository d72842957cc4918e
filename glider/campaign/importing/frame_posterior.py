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

`fly_all` reads the flights as one mapping has them, `judge` scores axes of the body on
these flights, and `rank_frames` does both for all frames.
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
from glider.campaign.importing.track import Track, turn_along
from glider.campaign.settings import AXES, ColumnMapping, unit_vector
from glider.physics.parameters import GliderParameters

_Fields = dict[str, str]  # Of `frame:`.
_Weighed = tuple[_Fields, float]  # With a prior, a score or a probability.


class _Flight(NamedTuple):
    """k rows of a flight, in the axes of the body as they are logged.

    Attributes:
        flow: (k, 3) velocity times its magnitude, |v| v [m²/s²].
        force: (k, 3) acceleration without gravity [m/s²].
        above: (k, 3) unit vectors that point up.
    """

    flow: np.ndarray
    force: np.ndarray
    above: np.ndarray


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
_MOST = 12  # Flights that are judged.
_DIGITS = 6  # Of log likelihoods: two readings that agree in them are one.


def rank_frames(
    logs: Sequence[Recording],
    claim: Callable[[_Fields], ColumnMapping],
    readings: Sequence[_Weighed],
    usual: str,
) -> list[_Weighed]:
    """Ranks frames by their probability, given the flights that they make of logs.

    Args:
        logs: recordings of one glider with the same columns.
        claim: makes a mapping with given fields of `frame:`.
        readings: fields that say how angles are read, each with its prior, the
            likeliest first.
        usual: the axis that points up in most logs like these, or "".

    Returns:
        Fields of `frame:` and their probability, the most probable first; none where
        no frame makes a flight.
    """
    # What the columns leave open: the axes of the log, and those of the body.
    first_reading, _ = readings[0]
    tracks = [make_track(log, claim({"up": AXES[0]} | first_reading)) for log in logs]
    worlds = [{"up": up} for up in AXES]
    if not tracks[0].along_throw:
        # The columns are x and z, and x goes the way of the flights.
        forward = _find_forward(tracks)
        worlds = [{"up": up, "forward": forward} for up in ("z", "-z")]
    bodies: list[_Fields] = [{}]  # Its axes are known.
    if tracks[0].spatial and "top" not in first_reading:
        pairs = itertools.product(AXES, AXES)
        bodies = [{"nose": a, "top": b} for a, b in pairs if a[-1] != b[-1]]

    # The usual axis is likely, and the others share the rest.
    habits = _UP
    if usual:
        rest = 1.0 - _USUAL
        habits = {up: rest * p / (1 - _UP[usual]) for up, p in _UP.items()}
        habits[usual] = _USUAL

    # Of readings with the same likelihood, the first and likeliest stands for all.
    found: dict[tuple, _Weighed] = {}
    for world, (reading, prior) in itertools.product(worlds, readings):
        up = world["up"]
        flights = fly_all(logs, claim(world | reading))
        if not flights:
            continue
        log_prior = math.log(prior * habits[up])
        for body in bodies:
            score = judge(flights, up, **body)
            key = (up, *body.values(), round(score, _DIGITS))
            found.setdefault(key, (world | reading | body, score + log_prior))
    if not found:
        return []

    ranked = sorted(found.values(), key=lambda scored: -scored[1])
    shares = softmax([score for _, score in ranked])
    return [(own, float(p)) for (own, _), p in zip(ranked, shares, strict=True)]


def _find_forward(tracks: Sequence[Track]) -> str:
    """Returns the direction of the throws, "x" or "-x": that of the fast steps.

    Slow ones are carried by hand, to and fro.
    """
    steps = np.concatenate([np.diff(track.position[:, 0]) for track in tracks])
    if not len(steps):
        return "x"
    sizes = np.abs(steps)
    is_fast = sizes >= np.quantile(sizes, _FAST)
    return "-x" if np.sum(np.sign(steps[is_fast])) < 0.0 else "x"


def fly_all(logs: Sequence[Recording], mapping: ColumnMapping) -> list[_Flight]:
    """Cuts flights out of recordings, as a mapping reads them.

    Returns:
        The first flights, as many as are judged; none where nothing flies.
    """
    flights = []
    for log in logs:
        track = make_track(log, mapping)
        pieces, _ = cut(track, _GRAVITY)
        flights += [_measure_flight(track, piece) for piece in pieces]
    return flights[:_MOST]


def _measure_flight(track: Track, piece: Track) -> _Flight:
    """Differentiates a piece of a recording, and turns the results into body axes.

    Args:
        track: the whole recording.
        piece: the rows of one flight.
    """
    # Without a yaw the pitch is measured in the vertical plane of the flight.
    flown = piece if track.spatial else turn_along(piece)
    row_step = np.median(np.diff(flown.time))
    stride = max(1, round(_STEP / row_step))
    motion = calc_motion(flown.time, flown.position, stride=stride)
    speed = np.linalg.norm(motion.velocity, axis=1, keepdims=True)
    without_gravity = motion.acceleration + _GRAVITY * unit_vector("z")

    # R turns from the body's axes to those of the track, so v in the body is Rᵀ v.
    rotation = track.rotation[np.isin(track.time, motion.time)]
    flow = np.einsum("nji,nj->ni", rotation, speed * motion.velocity)
    force = np.einsum("nji,nj->ni", rotation, without_gravity)
    return _Flight(flow, force, above=rotation[:, 2])


def judge(
    flights: Sequence[_Flight], up: str = "z", nose: str = "x", top: str = "z"
) -> float:
    """Log probability of a frame with these axes of the body, up to a constant.

    With the mean directions p (`path`) of flight and u (`above`) of the vertical, to
    the nose, left and top,
        log P = n / (1 + (n - 1) r) (w log L + κ (p_nose + u_top)
                - (p_left² + u_left²) / (2 σ²)) + log prior,
    where L is the likelihood of the forces in n flights. Its weight w and the
    correlation r of flights account for errors of the model that are not independent.

    Args:
        flights: what the frame makes of the logs.
        up: axis of the log that points up.
        nose: axis of the body that points to its nose.
        top: axis of the body that points up in level flight.
    """
    ahead = unit_vector(nose)
    over = unit_vector(top)
    left = np.cross(over, ahead)
    body = np.stack([ahead, left, over], axis=1)

    flow = np.concatenate([flight.flow for flight in flights])
    force = np.concatenate([flight.force for flight in flights])
    count = len(flights)
    score = _STEP / _MEMORY / count * _explain(flow @ body, force @ body)

    ways = [np.sum(flight.flow, axis=0) for flight in flights]
    path = np.mean([way / np.linalg.norm(way) for way in ways], axis=0) @ body
    verticals = [np.mean(flight.above, axis=0) for flight in flights]
    above = np.mean(verticals, axis=0) @ body
    score += _TOWARD * (path[0] + above[2])
    score -= 0.5 * (path[1] ** 2 + above[1] ** 2) / _SIDEWAYS**2

    score *= count / (1.0 + _SHARED * (count - 1))
    # Bodies are often defined as they lie upright, or with x ahead.
    usual = 0.1 * (top == up) + 0.2 * (nose == "x" and top[-1] == "z") + 0.008
    return score + math.log(usual)


def _explain(flow: np.ndarray, force: np.ndarray) -> float:
    """Log likelihood of forces as M |v| v, over that of any motion.

    Each row of M has a normal prior, and is fitted by ridge regression. With the mean
    square s² of the remaining N accelerations, at least that of a good model, and σ²
    that of any motion, the result is N/2 log(σ² / s²).

    Args:
        flow: |v| v (k, 3) to the nose, left and top [m²/s²].
        force: acceleration without gravity (k, 3), in the same axes [m/s²].
    """
    squares = 0.0
    for measured, mean, spread in zip(force.T, _FORCES, _SPREADS, strict=True):
        rest = measured - flow @ mean
        scaled = flow * spread  # Unit variance of what is fitted.
        normal = scaled.T @ scaled + _NOISE**2 * np.eye(3)
        fitted = np.linalg.solve(normal, scaled.T @ rest)
        squares += rest @ (rest - scaled @ fitted)
    variance = max(squares / force.size, _LEAST**2)
    return 0.5 * force.size * math.log(_ANY**2 / variance)
