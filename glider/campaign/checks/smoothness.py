"""Smooth runs of a track, and the largest set of them that is one motion.

Fourth differences of a smooth motion are noise. Where they exceed it, a row sticks
out, or the track is displaced (a marker was taken for another), or has another velocity
(a collision). Rows that stick out are removed, the track is cut where it is displaced,
and the most rows that can be one motion are kept.
"""

from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

_THRESHOLD = 6.0
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


class Rows(NamedTuple):
    """Rows of a track, and how noisy they are."""

    time: np.ndarray  #: (n,) [s]
    pose: np.ndarray  #: (n, 3)
    noise: np.ndarray  #: (3,) standard deviations of x, z, pitch.


def fourth_differences(
    time: np.ndarray, pose: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Differences (n - 4, k) over the noise of a row, and mean steps (n - 4,) [s]."""
    if len(time) < _STENCIL:
        return np.empty((0, pose.shape[1])), np.empty(0)
    own = sliding_window_view(time, _STENCIL)
    step = np.ptp(own, axis=1) / (_STENCIL - 1)
    lags = (own[:, :, None] - own[:, None]) / step[:, None, None]
    weights = 1.0 / np.prod(lags + np.eye(_STENCIL), axis=2)
    weights /= np.linalg.norm(weights, axis=1, keepdims=True)
    # Relative to the first row: far from the origin digits are few.
    near = sliding_window_view(pose, _STENCIL, axis=0)
    return np.einsum("ij,ikj->ik", weights, near - near[..., :1]), step


def find_one_motion(
    track: Rows, usable: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Usable rows (n,) that stick out, are displaced, or come after a contact."""
    sticks_out = np.zeros(len(track.time), dtype=bool)
    rows = np.flatnonzero(usable)
    usual = np.median(np.diff(track.time))
    steps = np.diff(track.time[rows])
    gaps = np.flatnonzero(steps > _LONG_STEP * usual * 1.01)
    runs = np.split(rows, gaps + 1)
    finished = []
    events = 0
    while runs:
        run = runs.pop()
        excess = _calc_excess(track, run)
        if np.max(excess, initial=0.0) <= 1.0 or events > _MAX_EVENTS:
            finished.append(run)
            continue
        events += 1
        at, count = _explain(track, run, int(np.argmax(excess)))
        if count:
            removed = slice(at, at + count)
            sticks_out[run[removed]] = True
            runs.append(np.delete(run, removed))
        else:
            runs += [run[:at], run[at:]]
    kept = np.zeros(len(track.time), dtype=bool)
    kept[_find_longest_chain(track, finished)] = True
    rows = np.flatnonzero(kept)
    for run in (rows, rows[::-1]):
        sticks_out[_find_outlying_ends(track, run)] = True
    rows = rows[~sticks_out[rows]]
    contact = _find_contact(track, rows)
    touched = np.zeros_like(kept)
    touched[rows[contact:]] = True
    displaced = usable & ~sticks_out & ~kept
    return sticks_out, displaced, touched


def _calc_excess(track: Rows, run: np.ndarray) -> np.ndarray:
    """Fourth differences of rows (k,) over what is allowed, (k - 4,)."""
    differences, step = fourth_differences(track.time[run], track.pose[run])
    # A step a of the acceleration makes a fourth difference a step², of norm sqrt(70).
    forced = _FLOOR * step[:, None] ** 2 / np.sqrt(70.0)
    bound = _THRESHOLD * track.noise + forced
    excess = np.abs(differences) / bound
    return np.max(excess, axis=1, initial=0.0)


def _explain(track: Rows, run: np.ndarray, worst: int) -> tuple[int, int]:
    """The least change that makes a track smooth near a stencil.

    One row that sticks out, a cut, two or three rows: the first of these that explains
    all, or whichever explains most.

    Returns:
        The row of the run to begin with, and how many to remove; 0 is a cut.
    """
    first = max(worst - _STENCIL, 0)
    last = worst + 2 * _STENCIL
    least = np.inf
    best = (worst, 1)
    for count in (1, 0, 2, 3):
        for at in range(max(worst, 1 - count), worst + _STENCIL):
            left = run[first:at]
            right = run[at + count : last]
            pieces = [np.concatenate([left, right])] if count else [left, right]
            over = sum(_sum_excess(track, piece) for piece in pieces)
            is_long = min(len(left), len(right)) >= _STENCIL
            if count and over == 0.0 and is_long and not _meet(track, left, right):
                over = 1e-3  # One row is a part of a jump.
            if over < least:
                least = over
                best = (at, count)
        if least == 0.0:
            break
    return best


def _sum_excess(track: Rows, rows: np.ndarray) -> float:
    excess = _calc_excess(track, rows)
    return float(np.sum(np.maximum(excess**2 - 1.0, 0.0)))


def _find_longest_chain(track: Rows, runs: list[np.ndarray]) -> np.ndarray:
    """Rows of the runs with most rows that can follow one another in one motion."""
    best = np.empty(0, dtype=int)
    chains: list[np.ndarray] = []  # The longest with each last run, in order.
    for run in sorted((run for run in runs if len(run) >= _STENCIL), key=min):
        before = [chain for chain in chains if _meet(track, chain, run)]
        chains.append(np.concatenate([max(before, key=len, default=best[:0]), run]))
        best = max(best, chains[-1], key=len)
    return best


def _find_outlying_ends(track: Rows, rows: np.ndarray) -> np.ndarray:
    """First rows (k,), at most 3, that a parabola through the next ones misses."""
    for count in (3, 2, 1):
        inner = rows[count : count + _ENDS]
        own = rows[count - 1 : count]
        if len(inner) == _ENDS and np.any(_jump(track, inner, own, own)[0] > 1.0):
            return rows[:count]
    return rows[:0]


def _find_contact(track: Rows, rows: np.ndarray) -> int:
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
    powers = [np.ones_like(since), since, since**2, after, after * since]
    inverse = np.linalg.pinv(np.stack(powers, axis=2))
    fitted = inverse @ (place[window] - place[last][:, None])
    velocity = fitted[:, 1]
    jump = fitted[:, 4]
    spread = np.max(track.noise[:2]) * np.linalg.norm(inverse[:, 4], axis=1)
    surely = _SMALL[1, 0] + _THRESHOLD * spread
    stops = _STOPS * np.linalg.norm(velocity, axis=1)
    over = np.linalg.norm(jump, axis=1) / np.maximum(surely, stops)
    is_pushed = np.sum(jump * velocity, axis=1) > 0.0
    has_gap = np.ptp(since, axis=1) > _LONG_STEP * half * step
    over[is_pushed | has_gap] = 0.0
    begin = int(np.argmax(over > 1.0))
    if over[begin] <= 1.0:
        return len(time)
    return int(last[begin + np.argmax(over[begin : begin + half])])


def _meet(track: Rows, left: np.ndarray, right: np.ndarray) -> bool:
    """Whether two runs, each extrapolated by a parabola, meet halfway."""
    between = np.array([left[-1], right[0]])
    jump = _jump(track, left[-_ENDS:], right[:_ENDS], between)
    return bool(np.all(jump <= 1.0))


def _jump(
    track: Rows, one: np.ndarray, other: np.ndarray, between: np.ndarray
) -> np.ndarray:
    """Jump of the pose and its rate from rows to others, over what may be (2, 3).

    Each is extrapolated by a parabola to the mean time of rows between them.
    """
    middle = np.mean(track.time[between])
    values = []
    variance = np.zeros(2)
    forced = np.zeros((2, 3))
    for rows in (one, other):
        since = track.time[rows] - middle
        inverse = np.linalg.pinv(since[:, None] ** np.arange(3))[:2]
        values.append(inverse @ track.pose[rows])
        variance += np.sum(inverse**2, axis=1)
        reach = abs(np.mean(since))
        forced += np.outer([reach**3 / 6.0, reach**2 / 2.0], _JERK)
    noise = _THRESHOLD * np.outer(np.sqrt(variance), track.noise)
    return np.abs(values[0] - values[1]) / np.maximum(noise + forced, _SMALL)
