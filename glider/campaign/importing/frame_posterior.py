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

import dataclasses
import itertools
import math
from collections.abc import Callable, Collection, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import softmax

from glider.campaign.checks.motion import SPAN, calc_motion
from glider.campaign.importing.cutting import cut
from glider.campaign.importing.recording import Recording
from glider.campaign.importing.track import (
    Track,
    make_track,
    planar_rotation,
    take,
    turn_along,
)
from glider.campaign.settings import AXES, Mapping, unit_vector
from glider.physics.parameters import GliderParameters

_Fields = dict[str, str]  # Fields of `frame:`.
_Flight = tuple[np.ndarray, np.ndarray, np.ndarray]
"""At k rows, in the axes of the body as they are logged: flow |v| v and acceleration
without gravity, (k, 3) each, and the direction that is up (k, 3)."""


class _Flown(NamedTuple):
    """Flights that frames are judged by, in the axes of the body as they are logged."""

    flights: int  #: Their number.
    flow: np.ndarray  #: (k, 3) of all rows.
    force: np.ndarray  #: (k, 3)
    path: np.ndarray  #: (3,) mean direction of flight.
    above: np.ndarray  #: (3,) mean of the direction that is up.


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
_KNOWN_AXES = {"nose": "x", "top": "z"}  # Of a body whose axes are known.
_MOST = 12  # Flights that are judged.
_SAME = 0.02  # Difference of rotations up to which two readings are one.


def rank_frames(
    logs: Sequence[Recording],
    claim: Callable[[_Fields], Mapping],
    readings: Sequence[tuple[_Fields, float]],
    usual: str,
) -> list[tuple[_Fields, float]]:
    """Frames with their probabilities, the best first; none where there is no flight.

    Readings are fields that say how angles are read, each with its prior; `usual` is
    the axis that points up in most logs like these, or "".
    """
    frames = []
    scores = []
    mapping = claim({"up": "z"} | readings[0][0])
    for world in _worlds([make_track(log, mapping) for log in logs]):
        up = world["up"]
        habit = _UP[up]
        if usual:
            habit = _USUAL if up == usual else (1.0 - _USUAL) * habit / (1 - _UP[usual])
        tried: list[list[Track]] = []
        pieces: list[list[Track]] = []
        for reading, prior in readings:
            mapping = claim(world | reading)
            tracks = [make_track(log, mapping) for log in logs]
            if any(all(map(_is_same, tracks, others)) for others in tried):
                continue
            tried.append(tracks)
            pieces = pieces or [_cut(track) for track in tracks]
            flown = _fly_all(tracks, pieces)
            if flown is None:
                break
            is_known = not tracks[0].spatial or "top" in reading
            for body in [_KNOWN_AXES] if is_known else _body_axes():
                fields = {} if is_known else body
                frames.append(world | reading | fields)
                score = _judge(flown, up, body)
                scores.append(score + math.log(prior * habit))
    if not frames:
        return []
    shares = softmax(scores)
    order = np.argsort(-shares, kind="stable")
    return [(frames[k], float(shares[k])) for k in order]


def rank_orders(logs: Sequence[Recording], claims: Collection[Mapping]) -> list[float]:
    """Log probabilities, up to a constant, of mappings that differ in a rotation."""
    scores = []
    pieces: list[list[Track]] = []
    for claim in claims:
        tracks = [make_track(log, claim) for log in logs]
        pieces = pieces or [_cut(track) for track in tracks]
        flown = _fly_all(tracks, pieces)
        scores.append(_judge(flown, "z", _KNOWN_AXES) if flown else 0.0)
    return scores


def _worlds(tracks: Sequence[Track]) -> list[_Fields]:
    """The ways in which the axes of a log may point."""
    if tracks[0].along_throw:
        return [{"up": up} for up in AXES]
    # The columns are x and z, and x goes the way of the flights.
    steps = np.concatenate([np.diff(track.position[:, 0]) for track in tracks])
    sizes = np.abs(steps)
    fast = steps[sizes >= np.quantile(sizes, _FAST)] if len(steps) else steps
    forward = "-x" if np.sum(np.sign(fast)) < 0.0 else "x"
    return [{"up": up, "forward": forward} for up in ("z", "-z")]


def _is_same(one: Track, other: Track) -> bool:
    same = np.allclose(one.rotation, other.rotation, atol=_SAME)
    return one.spatial and other.spatial and same


def _cut(track: Track) -> list[Track]:
    """The flights of a recording."""
    if track.spatial:
        # Which axis is the nose is unknown: contacts are found by y, not by the pitch.
        as_pitch = planar_rotation(track.position[:, 1])
        track = dataclasses.replace(track, rotation=as_pitch, spatial=False)
    pieces, _ = cut(track, _GRAVITY)
    return pieces


def _fly_all(
    tracks: Sequence[Track], pieces: Sequence[Sequence[Track]]
) -> _Flown | None:
    """The flights that were cut out of recordings, as many as are judged, if any."""
    found = []
    for track, own in zip(tracks, pieces, strict=True):
        found += [_fly(track, piece) for piece in own]
    flights = found[:_MOST]
    if not flights:
        return None
    flow, force, _ = map(np.concatenate, zip(*flights, strict=True))
    ways = [np.sum(own, axis=0) for own, _, _ in flights]
    path = np.mean([way / np.linalg.norm(way) for way in ways], axis=0)
    above = np.mean([np.mean(own, axis=0) for _, _, own in flights], axis=0)
    return _Flown(len(flights), flow, force, path, above)


def _fly(track: Track, piece: Track) -> _Flight:
    """A flight that was cut out of a recording, in the axes of the body."""
    rows = np.searchsorted(track.time, piece.time)
    whole = take(track, np.minimum(rows, len(track.time) - 1))
    turns = whole.rotation
    if not whole.spatial:
        piece = turn_along(piece)
    stride = max(1, round(_STEP / float(np.median(np.diff(piece.time)))))
    motion = calc_motion(piece.time, piece.position, stride=stride)
    turns = turns[np.searchsorted(piece.time, motion.time)]
    speed = np.linalg.norm(motion.velocity, axis=1, keepdims=True)
    pull = motion.acceleration + _GRAVITY * unit_vector("z")
    flow = np.einsum("nji,nj->ni", turns, speed * motion.velocity)
    return flow, np.einsum("nji,nj->ni", turns, pull), turns[:, 2]


def _body_axes() -> Iterator[_Fields]:
    """The ways in which the axes of a body may point."""
    for nose, top in itertools.product(AXES, AXES):
        if nose[-1] != top[-1]:
            yield {"nose": nose, "top": top}


def _judge(flown: _Flown, up: str, axes: _Fields) -> float:
    """Log probability of a frame with these axes of the body, up to a constant."""
    nose, top = axes["nose"], axes["top"]
    ahead = unit_vector(nose)
    over = unit_vector(top)
    left = np.cross(over, ahead)
    body = np.stack([ahead, left, over])
    # Rows and flights repeat the errors of this model.
    independent = _STEP / _MEMORY / flown.flights
    score = independent * _explain(flown.flow @ body.T, flown.force @ body.T)
    score += _TOWARD * (flown.path @ ahead + flown.above @ over)
    score -= 0.5 * ((flown.path @ left) ** 2 + (flown.above @ left) ** 2) / _SIDEWAYS**2
    score *= flown.flights / (1.0 + _SHARED * (flown.flights - 1))
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
