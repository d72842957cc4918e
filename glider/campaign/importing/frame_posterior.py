"""Which axes does a log have? Probabilities of frames, from physics and habits.

A frame specifies which axis of the log points up, how rotations are read, and which
axes of the body point to its nose and up. Its probability is made of

- habits: formats and names of columns have usual axes;
- forces: in the right frame accelerations are gravity and forces of the air,
  a = -g up + |v| R M Rᵀ v + b, with a matrix M of forces in the body's axes, and b that
  this lacks in one flight. All is Gaussian, so a frame has a marginal likelihood; it is
  taken over that of rows of any motion (a hand, a contact): a frame must explain many;
- attitude: gliders fly nose ahead and upright, each flight on the average.

Rows and flights of one glider repeat the errors of this model: they count less than
independent ones (benchmarks/bench_guess.py measures the calibration).
"""

import dataclasses
import itertools
from collections.abc import Callable, Iterator, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from glider.campaign.checks.motion import SPAN, Motion, calc_motion
from glider.campaign.importing.cutting import cut
from glider.campaign.importing.recording import Recording
from glider.campaign.importing.track import Track, make_track, take, turn_along
from glider.campaign.settings import AXES, Mapping, unit_vector
from glider.physics.parameters import GliderParameters

_Fields = dict[str, str]  # Fields of `frame:`.
_Spans = Sequence[tuple[float, float]]  # First and last time of flights [s].
_Flight = tuple[Motion, np.ndarray]
"""Rows of a flight where z is up: position, and rotations (k, 3, 3) from the body."""

_GRAVITY = GliderParameters().gravity
_DOWN = np.array([0.0, 0.0, -_GRAVITY])  # Free fall [m/s²].
_UP = {"z": 0.45, "y": 0.25, "-z": 0.2, "-y": 0.05, "x": 0.025, "-x": 0.025}
"""Prior of the axis that points up where the format has no usual one."""
_USUAL = 0.9  # Prior of the usual axis of a format or a name.
_FORCES = np.diag([-0.1, -0.1, -0.8])
_SPREADS = np.array([[0.1, 0.05, 0.15], [0.05, 0.15, 0.05], [0.15, 0.05, 0.6]])
"""Prior of M and its deviations, rows and columns to nose, left and top [1/m]: foam
gliders have a normal force of 0.5 to 1.4, an axial one of 0.06, a camber of 0.1."""
_OFFSET = 1.0  # Deviation of b [m/s²].
_NOISES = np.geomspace(0.3, 8.0, 8)  # Of accelerations, equally likely [m/s²].
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
    found: list[tuple[_Fields, float]] = []
    ways: list[tuple[_Fields, float, list[Track]]] = []
    for reading, prior in readings:
        tracks = [make_track(log, claim({"up": "z"} | reading)) for log in logs]
        if not any(all(map(_is_same, tracks, others)) for _, _, others in ways):
            ways.append((reading, prior, tracks))
    for world, axes, habit in _worlds(ways[0][2], usual):
        spans = [_find_spans(track, axes) for track in ways[0][2]]
        for reading, prior, tracks in ways:
            pairs = zip(tracks, spans, strict=True)
            flights = [_turn(t, axes, span) for t, each in pairs for span in each]
            known = tracks[0].rotation is None or "top" in reading
            for body, score in _judge(flights, world["up"], known):
                total = score + float(np.log(prior * habit))
                found.append((world | reading | body, total))
    total = np.logaddexp.reduce([score for _, score in found]) if found else 0.0
    shares = [(frame, float(np.exp(score - total))) for frame, score in found]
    return sorted(shares, key=lambda share: -share[1])


def _is_same(one: Track, other: Track) -> bool:
    a = one.rotation
    b = other.rotation
    return a is not None and b is not None and np.allclose(a, b, atol=_SAME)


def _worlds(
    tracks: Sequence[Track], usual: str
) -> Iterator[tuple[_Fields, np.ndarray, float]]:
    """Yields frames of the log with their axes (rows forward, left, up) and priors."""
    rest = (1.0 - _USUAL) / (1.0 - _UP[usual]) if usual else 1.0
    priors = {up: _USUAL if up == usual else rest * _UP[up] for up in AXES}
    if not tracks[0].along_throw:  # The columns are x and z.
        steps = np.concatenate([[0.0], *(np.diff(t.position[:, 0]) for t in tracks)])
        fast = np.abs(steps) >= np.quantile(np.abs(steps), _FAST)
        forward = "x" if np.sum(np.sign(steps[fast])) > 0.0 else "-x"
        for up in ("z", "-z"):
            axes = np.stack([unit_vector(forward), np.zeros(3), unit_vector(up)])
            yield {"up": up, "forward": forward}, axes, priors[up]
        return
    for up in AXES:
        above = unit_vector(up)
        ahead = np.roll(np.abs(above), 1)
        yield {"up": up}, np.stack([ahead, np.cross(above, ahead), above]), priors[up]


def _find_spans(track: Track, axes: np.ndarray) -> _Spans:
    """The flights of a recording in some axes."""
    position = track.position @ axes.T
    # Which axis is the nose is unknown: contacts are found by y, not by the pitch.
    pitch = track.pitch if track.rotation is None else position[:, 1]
    turned = dataclasses.replace(track, position=position, rotation=None, pitch=pitch)
    found, _ = cut(turned, _GRAVITY)
    return [(c.track.time[0], c.track.time[-1]) for c in found]


def _turn(track: Track, axes: np.ndarray, span: tuple[float, float]) -> _Flight:
    """A flight of a recording in some axes."""
    first, last = np.searchsorted(track.time, span)
    part = take(track, slice(first, last + 1))
    turns = None if part.rotation is None else axes @ part.rotation
    part = dataclasses.replace(part, position=part.position @ axes.T, rotation=turns)
    part = turn_along(part)
    stride = max(1, round(_STEP / float(np.median(np.diff(part.time)))))
    motion = calc_motion(part.time, part.position, stride=stride)
    turns = part.rotation
    if turns is None:
        turns = Rotation.from_euler("y", np.c_[part.pitch]).as_matrix()
    return motion, turns[np.searchsorted(part.time, motion.time)]


def _judge(
    flights: Sequence[_Flight], up: str, known: bool
) -> Iterator[tuple[_Fields, float]]:
    """Yields axes of the body with their log probabilities (up to a constant).

    If they are known already the nose is x, the top z.
    """
    flights = flights[:_MOST]
    if not flights:
        return
    count = len(flights) / (1.0 + _SHARED * (len(flights) - 1))
    paths = [np.einsum("nji,nj->i", turn, m.velocity) for m, turn in flights]
    path = np.mean([p / np.linalg.norm(p) for p in paths], axis=0)
    above = np.mean([np.mean(turn[:, 2], axis=0) for _, turn in flights], axis=0)
    forces = _Forces(flights)
    independent = _STEP / _MEMORY / len(flights)
    pairs = [("x", "z")] if known else itertools.product(AXES, AXES)
    for nose, top in pairs:
        if nose[-1] == top[-1]:
            continue
        ahead = unit_vector(nose)
        over = unit_vector(top)
        left = np.cross(over, ahead)
        # Bodies are often defined as they lie upright, or with x ahead.
        usual = 0.1 * (top == up) + 0.2 * (nose == "x" and top[-1] == "z") + 0.008
        score = independent * forces.evidence(np.stack([ahead, left, over]))
        score += _TOWARD * (path @ ahead + above @ over)
        score -= 0.5 * ((path @ left) ** 2 + (above @ left) ** 2) / _SIDEWAYS**2
        body = {} if known else {"nose": nose, "top": top}
        yield body, float(count * score + np.log(usual))


class _Forces:
    """Accelerations of flights as gravity and forces of the air, which are linear."""

    def __init__(self, flights: Sequence[_Flight]) -> None:
        velocity = np.concatenate([motion.velocity for motion, _ in flights])
        acceleration = np.concatenate([motion.acceleration for motion, _ in flights])
        turn = np.concatenate([turn for _, turn in flights])
        speed = np.linalg.norm(velocity, axis=1)
        flow = np.einsum("n,nji,nj->ni", speed, turn, velocity)
        forces = np.einsum("nci,nj->ncij", turn, flow).reshape(-1, 3, 9)  # Of M.
        rows = np.repeat(np.eye(len(flights)), [len(turn) for _, turn in flights], 0)
        offsets = np.einsum("nf,cd->ncfd", rows, np.eye(3)).reshape(len(turn), 3, -1)
        design = np.dstack([forces, offsets])
        size = 3 * len(turn)
        self._design = design.reshape(size, -1)
        self._target = (acceleration - _DOWN).reshape(size)
        self._square = self._design.T @ self._design
        self._other = -size * np.log(_ANY) - 0.5 * np.sum((acceleration / _ANY) ** 2)

    def evidence(self, axes: np.ndarray) -> float:
        """Log likelihood over that of any motion; rows of axes are nose, left, top."""
        order = np.abs(axes)
        mean = np.zeros(self._design.shape[1])
        mean[:9] = (order.T @ _FORCES @ order).reshape(-1)
        spread = np.full(len(mean), _OFFSET)
        spread[:9] = (order.T @ _SPREADS @ order).reshape(-1)
        rest = self._target - self._design @ mean
        along = spread * (self._design.T @ rest)
        variance = _NOISES[:, None, None] ** 2
        matrix = np.eye(len(mean)) + spread[:, None] * self._square * spread / variance
        fitted = np.linalg.solve(matrix, along[:, None] / variance)[..., 0] @ along
        values = (rest @ rest - fitted) / _NOISES**2 + np.linalg.slogdet(matrix)[1]
        values += 2.0 * len(rest) * np.log(_NOISES)
        total = np.logaddexp.reduce(-0.5 * values) - np.log(len(values))
        return float(total - self._other)
