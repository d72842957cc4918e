"""Smooth runs of a track, and the largest set of them that is one motion.

Fourth differences of a smooth motion are noise. Where they exceed it, a row sticks
out, or the track is displaced (a marker was taken for another), or has another velocity
(a collision). Rows that stick out are removed, the track is cut where it is displaced,
and the most rows that can be one motion are kept: two runs are of one motion if
parabolas extrapolate them to the same pose and velocity between them.

A track has n rows. A run is an array of k indices of its rows, in the order of time.
Excess and jumps are ratios to what noise and forces allow: above 1 they are faults.
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
    """Rows of a track, and how noisy they are.

    Attributes:
        time: (n,), increasing [s].
        pose: (n, 3) x, z, pitch [m, m, rad].
        noise: (3,) its standard deviations.
    """

    time: np.ndarray
    pose: np.ndarray
    noise: np.ndarray


def fourth_differences(
    time: np.ndarray, pose: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Fourth differences of each five rows, scaled to the noise of one row.

    They are Σ wᵢ xᵢ with wᵢ ∝ 1 / Π (tᵢ - tⱼ) over the other rows j, and Σ wᵢ² = 1:
    zero of a cubic at any times, and of white noise as large as it is.

    Args:
        time: (n,), increasing [s].
        pose: (n, k).

    Returns:
        The differences (n - 4, k), and the mean steps of the five rows (n - 4,) [s].
    """
    if len(time) < _STENCIL:
        return np.empty((0, pose.shape[1])), np.empty(0)
    times = sliding_window_view(time, _STENCIL)
    step = np.ptp(times, axis=1) / (_STENCIL - 1)
    lags = (times[:, :, None] - times[:, None]) / step[:, None, None]
    weights = 1.0 / np.prod(lags + np.eye(_STENCIL), axis=2)
    weights /= np.linalg.norm(weights, axis=1, keepdims=True)
    # Relative to the first row: far from the origin digits are few.
    poses = sliding_window_view(pose, _STENCIL, axis=0)
    centered = poses - poses[..., :1]
    return np.einsum("ij,ikj->ik", weights, centered), step


def find_one_motion(
    track: Rows, usable: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Finds the usable rows (n,) that are not of the one motion with most rows.

    Returns:
        Flags (n,) of the rows that stick out, of those that are displaced, and of those
        that come after a contact.
    """
    runs, sticks_out = _part(track, usable)
    is_kept = np.zeros_like(sticks_out)
    is_kept[_find_longest_chain(track, runs)] = True
    rows = np.flatnonzero(is_kept)
    for run in (rows, rows[::-1]):
        sticks_out[_find_outlying_ends(track, run)] = True
    displaced = usable & ~sticks_out & ~is_kept

    rows = rows[~sticks_out[rows]]
    touched = np.zeros_like(sticks_out)
    touched[rows[_find_contact(track, rows) :]] = True
    return sticks_out, displaced, touched


def _part(track: Rows, usable: np.ndarray) -> tuple[list[np.ndarray], np.ndarray]:
    """Parts the usable rows (n,) into smooth runs.

    Runs between gaps are changed at their largest fault, by the least change that
    explains it, until they are smooth. After `_MAX_EVENTS` changes the others stay as
    they are.

    Returns:
        The runs, in no order, and flags (n,) of the rows that stick out of them.
    """
    rows = np.flatnonzero(usable)
    usual = np.median(np.diff(track.time))
    is_gap = np.diff(track.time[rows]) > _LONG_STEP * usual * 1.01
    runs = np.split(rows, np.flatnonzero(is_gap) + 1)

    sticks_out = np.zeros(len(track.time), dtype=bool)
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
    return finished, sticks_out


def _calc_excess(track: Rows, run: np.ndarray) -> np.ndarray:
    """Largest fourth difference of each five rows over what is allowed.

    Noise σ and a step a of the acceleration allow 6 σ + a h² / √70 of five rows that
    are h apart.

    Returns:
        (k - 4,), by the first of the five rows; empty of a shorter run.
    """
    differences, step = fourth_differences(track.time[run], track.pose[run])
    # A step a makes a fourth difference a h², whose weights have the norm √70.
    forced = _FLOOR * step[:, None] ** 2 / np.sqrt(70.0)
    excess = np.abs(differences) / (_THRESHOLD * track.noise + forced)
    return np.max(excess, axis=1, initial=0.0)


def _sum_excess(track: Rows, run: np.ndarray) -> float:
    """Sum of the squared excess above 1: zero of a smooth run."""
    excess = _calc_excess(track, run)
    return np.sum(np.maximum(excess**2 - 1.0, 0.0))


def _explain(track: Rows, run: np.ndarray, worst: int) -> tuple[int, int]:
    """Finds the least change that makes a run smooth near its worst fault.

    One row that sticks out, a cut, two or three rows: the first of these that explains
    all, or whichever explains most.

    Args:
        track: of n rows.
        run: (k,).
        worst: index in the run of the first of the five rows with the largest fault.

    Returns:
        The index in the run to begin with, and how many rows to remove; 0 is a cut.
    """
    first = max(worst - _STENCIL, 0)
    last = worst + 2 * _STENCIL
    least = np.inf
    best = (worst, 1)
    for count in (1, 0, 2, 3):
        for at in range(max(worst, 1 - count), worst + _STENCIL):
            left = run[first:at]
            right = run[at + count : last]
            if count == 0:
                over = _sum_excess(track, left) + _sum_excess(track, right)
            else:
                over = _sum_excess(track, np.concatenate([left, right]))
                is_long = min(len(left), len(right)) >= _STENCIL
                if over == 0.0 and is_long and not _meet(track, left, right):
                    over = 1e-3  # The row is a part of a jump: a cut explains it.
            if over < least:
                least = over
                best = (at, count)
        if least == 0.0:
            break
    return best


def _find_longest_chain(track: Rows, runs: list[np.ndarray]) -> np.ndarray:
    """Rows of the runs with most rows that can follow one another in one motion.

    In the order of time each run continues the longest chain of earlier runs that it
    meets. Runs of fewer than five rows show no motion.
    """
    chains: list[np.ndarray] = []  # The longest that ends with each run.
    long_runs = [run for run in runs if len(run) >= _STENCIL]
    for run in sorted(long_runs, key=min):
        before = [chain for chain in chains if _meet(track, chain, run)]
        longest = max(before, key=len, default=run[:0])
        chains.append(np.concatenate([longest, run]))
    return max(chains, key=len, default=np.empty(0, dtype=int))


def _find_outlying_ends(track: Rows, rows: np.ndarray) -> np.ndarray:
    """First rows of a run, at most 3, that a parabola through the next ones misses.

    Fourth differences barely show them. The last rows are the first of a reversed run.
    """
    for count in (3, 2, 1):
        inner = rows[count : count + _ENDS]
        if len(inner) < _ENDS:
            continue
        own = rows[count - 1 : count]
        jump_of_pose, _ = _calc_jump(track, inner, own, own)
        if np.any(jump_of_pose > 1.0):
            return rows[:count]
    return rows[:0]


def _find_contact(track: Rows, rows: np.ndarray) -> int:
    """How many of the rows of one motion come before a contact.

    About each step between two rows a parabola with a jump of position and of velocity
    is fitted,
        x(t) = a + v t + b t² + (c + d t) [t > 0].
    A velocity that jumps against the motion by more than noise and forces of the air
    allow is a contact: the wire, a hand, the floor.

    Returns:
        A number of rows, among which the last one before the jump does not count; all
        (k,) of them without a contact.
    """
    time = track.time[rows]
    place = track.pose[rows, :2]
    step = np.median(np.diff(track.time))
    half = max(round(_AROUND / step), _STENCIL)
    if len(time) <= 2 * half:
        return len(time)

    # Each window has 2 half rows, and the step after its row `last` in its middle; at
    # the end of the flight, later.
    last = np.arange(half - 1, len(time) - 2)
    first = np.minimum(last - half + 1, len(time) - 2 * half)
    window = first[:, None] + np.arange(2 * half)
    middle = 0.5 * (time[last] + time[last + 1])
    since = time[window] - middle[:, None]

    # Solve for a, v, b, c, d of x and z in all windows, relative to the row `last`.
    after = (since > 0.0).astype(float)
    powers = [np.ones_like(since), since, since**2, after, after * since]
    inverse = np.linalg.pinv(np.stack(powers, axis=2))
    fitted = inverse @ (place[window] - place[last][:, None])
    velocity = fitted[:, 1]
    jump = fitted[:, 4]

    # Jumps over what noise may make, and over what a contact takes at least. A push
    # is no contact, and across a gap forces may have done it.
    spread = np.max(track.noise[:2]) * np.linalg.norm(inverse[:, 4], axis=1)
    surely = _SMALL[1, 0] + _THRESHOLD * spread
    stops = _STOPS * np.linalg.norm(velocity, axis=1)
    over = np.linalg.norm(jump, axis=1) / np.maximum(surely, stops)
    is_pushed = np.sum(jump * velocity, axis=1) > 0.0
    has_gap = np.ptp(since, axis=1) > _LONG_STEP * half * step
    over[is_pushed | has_gap] = 0.0

    # The first contact, where its jump is largest.
    begin = np.argmax(over > 1.0)
    if over[begin] <= 1.0:
        return len(time)
    worst = begin + np.argmax(over[begin : begin + half])
    return last[worst]


def _meet(track: Rows, left: np.ndarray, right: np.ndarray) -> bool:
    """Whether two runs, each extrapolated by a parabola, meet halfway."""
    between = np.array([left[-1], right[0]])
    jump = _calc_jump(track, left[-_ENDS:], right[:_ENDS], between)
    return bool(np.all(jump <= 1.0))


def _calc_jump(
    track: Rows, one: np.ndarray, other: np.ndarray, between: np.ndarray
) -> np.ndarray:
    """Jumps from one run to another over what is allowed.

    Parabolas extrapolate both to one time. Noise is allowed, what true third
    derivatives add to parabolas, and at least `_SMALL`.

    Args:
        track: of n rows.
        one: (k,) rows of one run.
        other: (m,) rows of the other; one alone shows the pose, but not its rate.
        between: rows whose mean time both are extrapolated to.

    Returns:
        (2, 3), the jumps of the pose, and of its rate.
    """
    middle = np.mean(track.time[between])
    values = []
    variance = np.zeros(2)
    forced = np.zeros((2, 3))
    for rows in (one, other):
        since = track.time[rows] - middle
        powers = since[:, None] ** np.arange(3)
        inverse = np.linalg.pinv(powers)[:2]  # To the pose and its rate.
        values.append(inverse @ track.pose[rows])
        variance += np.sum(inverse**2, axis=1)
        reach = abs(np.mean(since))
        forced += np.outer([reach**3 / 6.0, reach**2 / 2.0], _JERK)

    noise = _THRESHOLD * np.outer(np.sqrt(variance), track.noise)
    allowed = np.maximum(noise + forced, _SMALL)
    return np.abs(values[0] - values[1]) / allowed
