"""Smooth runs of a track, and the largest set of them that is one motion.

Fourth differences of a smooth motion are noise. Where they exceed it, a row sticks
out, or the track is displaced (a marker was taken for another), or has another velocity
(a collision). Rows that stick out are removed, the track is cut where it is displaced,
and the most rows that can be one motion are kept.
"""

from typing import NamedTuple

import numpy as np

THRESHOLD = 6.0
"""Fourth differences, as standard deviations of noise, above which a row is faulty.
Gaussian noise passes it in 2e-9 of differences, 6e-9 of rows: the largest of all 68,000
rows of simulated logs is 4.3. See `_FLOOR` for what a true motion adds."""

_FLOOR = np.array([20.0, 20.0, 200.0])
"""Largest step of a true acceleration between two rows [m/s², m/s², rad/s²]: a step of
the elevator's rate makes 8 and 60 on the notebooks' glider at 8 m/s."""

_JERK = np.array([300.0, 300.0, 3000.0])
"""Largest third derivative over a gap of a true motion [m/s³, m/s³, rad/s³]."""

_SMALL = np.array([[0.004, 0.004, 0.04], [0.3, 0.3, 2.0]])
"""Jumps of pose [m, m, rad] and of its rate [.../s] that pass, however quiet the
cameras are: a relabelled marker or a collision does more, a shaking airframe less."""

_AROUND = 0.06  # Time on either side of a contact that shows it [s].
_STOPS = 0.25  # Part of its velocity that a body loses at least that touches something.
_ENDS = 7  # Rows from whose parabola a run is extrapolated.
_STENCIL = 5  # Rows of a fourth difference.
_LONG_STEP = 3.0  # Steps longer than this many median ones are gaps, and cut.
_MAX_EVENTS = 60  # Faults in one flight that are examined one by one.


class Track(NamedTuple):
    """Rows of a track, and how noisy they are."""

    time: np.ndarray  #: (n,) [s]
    pose: np.ndarray  #: (n, 3)
    noise: np.ndarray  #: (3,) standard deviations of x, z, pitch.


def fourth_differences(
    time: np.ndarray, pose: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Differences (n - 4, k) over the noise of a row, and mean steps (n - 4,) [s]."""
    count = len(time) - _STENCIL + 1
    if count <= 0:
        return np.empty((0, pose.shape[1])), np.empty(0)
    window = np.arange(count)[:, None] + np.arange(_STENCIL)
    t = time[window]
    step = (t[:, -1] - t[:, 0]) / (_STENCIL - 1)
    lags = (t[:, :, None] - t[:, None, :]) / step[:, None, None]
    weights = 1.0 / np.prod(lags + np.eye(_STENCIL), axis=2)
    weights /= np.linalg.norm(weights, axis=1, keepdims=True)
    # Relative to the first row: far from the origin digits are few.
    near = pose[window] - pose[window[:, :1]]
    return np.einsum("ik,ikj->ij", weights, near), step


def find_one_motion(
    track: Track, usable: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Usable rows (n,) that stick out, are displaced, or come after a contact."""
    sticks_out = np.zeros(len(track.time), dtype=bool)
    rows = np.flatnonzero(usable)
    limit = _LONG_STEP * np.median(np.diff(track.time)) * 1.01
    gaps = np.flatnonzero(np.diff(track.time[rows]) > limit) + 1
    runs = [run for run in np.split(rows, gaps) if len(run)]
    finished: list[np.ndarray] = []
    events = 0
    while runs:
        run = runs.pop()
        excess = _excess(track, run)
        if len(excess) == 0 or excess.max() <= 1.0 or events > _MAX_EVENTS:
            finished.append(run)
            continue
        events += 1
        worst = int(np.argmax(excess))
        at, count = _explain(track, run, worst)
        if count:
            sticks_out[run[at : at + count]] = True
            runs.append(np.delete(run, slice(at, at + count)))
        else:
            runs += [run[:at], run[at:]]
    kept = np.zeros(len(track.time), dtype=bool)
    for run in _longest_chain(track, finished):
        kept[run] = True
    rows = np.flatnonzero(kept)
    sticks_out[_outlying_ends(track, rows)] = True
    sticks_out[_outlying_ends(track, rows[::-1])] = True
    rows = rows[~sticks_out[rows]]
    touched = np.zeros_like(kept)
    touched[rows[_find_contact(track, rows) :]] = True
    return sticks_out, usable & ~sticks_out & ~kept, touched


def _excess(track: Track, run: np.ndarray) -> np.ndarray:
    """Fourth differences of rows (k,) over what is allowed, (k - 4,)."""
    differences, step = fourth_differences(track.time[run], track.pose[run])
    # A step a of the acceleration makes a fourth difference a step², of norm sqrt(70).
    bound = THRESHOLD * track.noise + _FLOOR * step[:, None] ** 2 / np.sqrt(70.0)
    return np.max(np.abs(differences) / bound, axis=1, initial=0.0)


def _explain(track: Track, run: np.ndarray, worst: int) -> tuple[int, int]:
    """The least change that makes a track smooth near a stencil.

    One row that sticks out, a cut, two or three rows: the first of these that explains
    all, or whichever explains most.

    Returns:
        The row of the run to begin with, and how many to remove; 0 is a cut.
    """
    first = max(worst - _STENCIL, 0)
    last = worst + 2 * _STENCIL
    near = range(worst, worst + _STENCIL)
    ways = [(i, c) for c in (1, 0, 2, 3) for i in near if i > 0 or c > 0]
    least = np.inf
    best = ways[0]
    for at, count in ways:
        left = run[first:at]
        right = run[at + count : last]
        if count == 0:
            over = _total_excess(track, left) + _total_excess(track, right)
        else:
            over = _total_excess(track, np.concatenate([left, right]))
            long = min(len(left), len(right)) >= _STENCIL
            if over == 0.0 and long and not _meet(track, left, right):
                over = 1e-3  # One row is a part of a jump.
        if over < least:
            least = over
            best = (at, count)
        if (at, count) == (near[-1], count) and least == 0.0:
            break
    return best


def _total_excess(track: Track, rows: np.ndarray) -> float:
    return float(np.sum(np.maximum(_excess(track, rows) ** 2 - 1.0, 0.0)))


def _longest_chain(track: Track, runs: list[np.ndarray]) -> list[np.ndarray]:
    """The runs with most rows that can follow one another in one motion."""

    def rows(chain: list[np.ndarray]) -> int:
        return sum(map(len, chain))

    chains: list[list[np.ndarray]] = []  # The longest that ends with each run.
    long = (run for run in runs if len(run) >= _STENCIL)
    for run in sorted(long, key=lambda run: int(run[0])):
        earlier = [chain for chain in chains if _meet(track, chain[-1], run)]
        chains.append([*max(earlier, key=rows, default=[]), run])
    return max(chains, key=rows, default=[])


def _outlying_ends(track: Track, rows: np.ndarray) -> np.ndarray:
    """First rows (k,), at most 3, that a parabola through the next ones misses."""
    for count in (3, 2, 1):
        inner = rows[count : count + _ENDS]
        if len(inner) < _ENDS:
            continue
        end = rows[count - 1]
        expected, variance, reach = _extrapolate(track, inner, track.time[end])
        distance = np.abs(track.pose[end] - expected[0])
        noise = THRESHOLD * np.sqrt(1.0 + variance[0]) * track.noise
        if np.any(distance > np.maximum(noise + _JERK * reach**3 / 6.0, _SMALL[0])):
            return rows[:count]
    return rows[:0]


def _find_contact(track: Track, rows: np.ndarray) -> int:
    """How many of the rows (k,) of one motion come before a contact.

    About each step between two rows a parabola with a jump of position and of velocity
    is fitted. A velocity that jumps against the motion by more than noise and forces of
    the air allow is a contact: the wire, a hand, the floor.
    """
    time = track.time[rows]
    place = track.pose[rows, :2]
    step = float(np.median(np.diff(track.time)))
    half = max(round(_AROUND / step), _STENCIL)
    if len(time) <= 2 * half:
        return len(time)
    last = np.arange(half - 1, len(time) - 2)
    first = np.minimum(last - half + 1, len(time) - 2 * half)
    window = first[:, None] + np.arange(2 * half)
    since = time[window] - 0.5 * (time[last] + time[last + 1])[:, None]
    after = (since > 0.0).astype(float)
    inverse = np.linalg.pinv(
        np.stack([after**0, since, since**2, after, after * since], axis=2)
    )
    fitted = inverse @ (place[window] - place[last][:, None])
    velocity = fitted[:, 1]
    jump = fitted[:, 4]
    spread = np.linalg.norm(inverse[:, 4], axis=1) * np.max(track.noise[:2])
    least = np.maximum(
        _SMALL[1, 0] + THRESHOLD * spread, _STOPS * np.hypot(*velocity.T)
    )
    over = np.hypot(*jump.T) / least
    over[np.sum(jump * velocity, axis=1) > 0.0] = 0.0
    over[np.ptp(since, axis=1) > _LONG_STEP * half * step] = 0.0  # A gap in it.
    begin = int(np.argmax(over > 1.0))
    if over[begin] <= 1.0:
        return len(time)
    return int(last[begin + np.argmax(over[begin : begin + half])])


def _meet(track: Track, left: np.ndarray, right: np.ndarray) -> bool:
    """Whether two runs, each extrapolated by a parabola, meet halfway."""
    middle = 0.5 * (track.time[left[-1]] + track.time[right[0]])
    ends = [_extrapolate(track, r, middle) for r in (left[-_ENDS:], right[:_ENDS])]
    jump = np.abs(ends[0][0] - ends[1][0])  # (2, 3) of position and rate.
    variance = (ends[0][1] + ends[1][1])[:, None] * track.noise**2
    reach = np.array([e[2] for e in ends])
    slack = np.stack([_JERK * np.sum(reach**3) / 6.0, _JERK * np.sum(reach**2) / 2.0])
    allowed = np.maximum(THRESHOLD * np.sqrt(variance) + slack, _SMALL)
    return bool(np.all(jump <= allowed))


def _extrapolate(
    track: Track, rows: np.ndarray, time: float
) -> tuple[np.ndarray, np.ndarray, float]:
    """Pose and rate (2, 3), their variances (2,) for noise 1, and the reach [s]."""
    since = track.time[rows] - time
    inverse = np.linalg.pinv(since[:, None] ** np.arange(3))[:2]
    reach = float(abs(np.mean(since)))
    return inverse @ track.pose[rows], np.sum(inverse**2, axis=1), reach
