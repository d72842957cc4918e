"""Rows of a log that show no flight: frozen, held, standing, sticking out, displaced.

A glider moves smoothly, and cameras have noise. A body in free fall cannot stay where
it is: from rest it falls 18 mm in 60 ms. Air takes energy from a glider: what
accelerates it along its path is a hand. Rows are excluded, never corrected.

`find_faults` marks them in all flights, `find_hand` where a hand lets go later than the
log begins. What repeats or fills rows is found in any recording, before an import cuts
it into flights. Flags of rows are (n,), True in faulty ones.
"""

from collections.abc import Sequence

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from glider.campaign.checks.masks import (
    ExcludedRows,
    Inspection,
    Masks,
    find_repeats,
    name_rows,
    stretches,
)
from glider.campaign.checks.motion import (
    PUSH,
    calc_drive,
    calc_motion,
    half_window,
    robust_std,
)
from glider.campaign.checks.planarity import body_axes
from glider.campaign.checks.servo import LateServo, measure_elevators
from glider.campaign.checks.smoothness import Rows, find_one_motion, fourth_differences
from glider.campaign.logs import Campaign, Flight

_AGAIN = "repeat the pose before while the glider moves"
FILLED = "on a straight line without noise: filled, not measured"
_EQUAL_POSES = 3  # Equal rows of x, z and pitch together that are frozen.
_EQUAL_NUMBERS = 5  # Equal rows of one column that may be frozen.
_SURELY = 6.0  # Standard deviations by which a column should have moved, or did.
_STRAIGHT = 1e-3  # Noises by which filled rows depart from a line: they are rounded.
_FEWEST_FILLED = 3
"""Rows on a line in x and z at once that are filled; none of 4 million rows of noise of
three digits are."""
_LEAST_NOISE = 3.0  # Digits of a log that show whether rows are on a line.
_COLORED = 0.3
"""Share of neighboring fourth differences of one sign above which noise is filtered:
white noise has 0.205. Measured: 0.16 to 0.21 in campaigns of four flights, real cameras
among them; 0.39 and more behind low-pass filters of second order below two thirds of
half the rate of rows."""
_FAST_LOG = 90.0  # Rate of rows below which steps show the motion, too [Hz].
_FEWEST_NOISES = 100  # Fourth differences that show whether it is, at least.
_DECIMALS = 9  # Of m and rad, that a log may have: beyond is rounding.
_QUANTA = 5.0  # Digits of the log by which it should have.
_NOISY = 10.0  # Ratio of noise to digits: five equal rows have odds of 1e-6.
_LONG_STEP = 3.0  # Median steps above which a step is reported as a gap.
_UNCOMMANDED = 0.05
"""Gap over which a flight with a servo is cut [s]: the commands in it are lost as well,
and two of them at 50 Hz turn the elevator by 0.5 rad."""
_MIN_COMMANDED = 0.1  # Angle that commands move while an elevator is frozen [rad].
_TURN = 1.0
"""Angle by which an attitude jumps where markers are exchanged [rad]. Measured throws
turn by 0.14 at most from row to row, noise included."""
_TURNING = 30.0  # Rate by which a body may turn that far, in a longer step [rad/s].
_AT_REST = 0.15  # Speed below which a glider rests [m/s],
_HELD = 5.0  # ... if less accelerates it: half of what a falling one has [m/s²].
_STOPPED = 0.25  # Share of flights ending in a contact above which all may.
_AT_STOP = "pose: the last row before a contact, as most flights end in one"
_HAND_GAIN = 1.3  # Ratio of the speeds when a hand lets go and at the log's start.


def find_faults(campaign: Campaign) -> Inspection:
    """Finds rows that are frozen, stick out or are displaced; reports gaps.

    The noise is measured on all flights: one bad flight does not hide itself. For false
    alarms see `_THRESHOLD` in smoothness; a row that sticks out by 4 noises or less
    passes.

    Returns:
        The campaign with all flights, their masks, and what to report.
    """
    flights = campaign.flights
    scale = _measure_scale([(flight.time, flight.pose) for flight in flights])
    of_servos = _find_servo_faults(campaign)
    masks = {}
    excluded = []
    warnings = []
    repeated = 0
    stopped = 0
    for flight in flights:
        name = flight.name
        of_pose = _find_pose_faults(flight, scale)
        of_servo = of_servos.get(name, {})
        mask = _make_masks(flight, of_pose, of_servo)
        again = of_pose.pop(_AGAIN)
        for why, flags in (of_pose | of_servo).items():
            if flags.any():
                excluded.append(ExcludedRows(name, name_rows(flags), why))
        masks[name] = mask
        warnings += _report_gaps(flight)
        repeated += np.sum(again)
        stopped += mask.pose[~again][-1]

    warnings += _find_filter(campaign, masks)
    if repeated:
        rows = sum(len(flight.time) for flight in flights)
        warnings.append(f"{repeated} of {rows} rows {_AGAIN}: they are not used")

    # Where flights end in a contact, the last rows of the others may be touched, too:
    # within a row a stop can hide in noise.
    if stopped > _STOPPED * len(flights):
        for name, mask in masks.items():
            for last in np.flatnonzero(mask.usable)[-1:]:
                mask.pose[last] = True
                excluded.append(ExcludedRows(name, f"{last + 2}", _AT_STOP))
    return Inspection(
        campaign=campaign,
        masks=masks,
        excluded=tuple(excluded),
        warnings=tuple(warnings),
    )


def _make_masks(
    flight: Flight, of_pose: dict[str, np.ndarray], of_servo: dict[str, np.ndarray]
) -> Masks:
    """Joins the flags of all reasons to masks, and finds the piece that is used.

    Gaps that hide commands cut a flight into pieces: the one with most usable poses is
    used. Without a servo there is one piece.

    Args:
        flight: of n rows.
        of_pose: flags (n,) of the pose's faults, by the reason.
        of_servo: flags (n,) of the elevator's faults, by the reason.
    """
    pose = np.any([*of_pose.values()], axis=0)
    elevator = np.zeros_like(pose)
    for flags in of_servo.values():
        elevator |= flags

    steps = np.diff(flight.time)
    longest = max(_UNCOMMANDED, _LONG_STEP * np.median(steps))
    is_cut = (steps > longest) & (flight.command is not None)
    piece = np.append(0, np.cumsum(is_cut))
    used = np.argmax(np.bincount(piece, weights=~pose))
    first, last = np.searchsorted(piece, [used, used + 1]).tolist()
    return Masks(pose=pose, elevator=elevator, first=first, last=last)


def _report_gaps(flight: Flight) -> list[str]:
    """Sentences on steps of a log that are much longer than the others.

    They name the line of the file before the gap.
    """
    steps = np.diff(flight.time)
    usual = np.median(steps)
    sentences = []
    for i in np.flatnonzero(steps > _LONG_STEP * usual):
        gap = f"{round(steps[i] / usual) - 1} rows ({steps[i]:.3g} s)"
        sentences.append(f"{flight.name}: a gap of {gap} after row {i + 2}")
    return sentences


def _find_filter(campaign: Campaign, masks: dict[str, Masks]) -> list[str]:
    """Warns of poses that were filtered: noise has one sign from row to row.

    Neighboring fourth differences of white noise mostly have opposite signs. Logs of a
    low rate, or of few rows, show the motion in them or nothing.
    """
    noises = []
    neighbors = []
    for flight in campaign.flights:
        usable = masks[flight.name].usable
        own, _ = fourth_differences(flight.time[usable], flight.pose[usable, :2])
        noises.append(own)
        neighbors.append(own[1:] * own[:-1] > 0.0)
    is_alike = np.concatenate(neighbors)
    if campaign.row_rate < _FAST_LOG or len(is_alike) < _FEWEST_NOISES:
        return []
    share = np.min(np.mean(is_alike, axis=0))
    if share < _COLORED:
        return []
    noise = np.max(robust_std(np.concatenate(noises)))
    return [
        f"The poses have next to no noise from row to row ({1e3 * noise:.2g} mm, of "
        f"one sign in {100 * share:.0f} % of rows): they were filtered, or simulated "
        "without noise. A filter changes forces and delays: use raw poses."
    ]


def _find_pose_faults(flight: Flight, scale: np.ndarray) -> dict[str, np.ndarray]:
    """Finds the faults of a pose; rows with one reason are not asked for the next.

    Args:
        flight: of n rows.
        scale: noise and last digits (2, 3), as of `_measure_scale`.

    Returns:
        Flags (n,), by the reason.
    """
    time = flight.time
    pose = flight.pose
    unknown = ~np.isfinite(pose).all(axis=1)
    frozen = find_repeats(pose, _EQUAL_POSES)
    again = _find_held(pose, scale, 2) & ~frozen
    for k in range(3):  # One column alone may be equal by chance for longer.
        frozen |= _find_held(pose[:, [k]], scale[:, [k]], _EQUAL_NUMBERS)
    filled = find_filled(time, pose[:, :2]) & ~(again | frozen)
    turned = _find_turned_over(flight)
    usable = ~(unknown | again | frozen | filled | turned)
    standing = _find_standing(flight, usable)
    usable &= ~standing

    # A flight may be noisier than the others, but by so much only.
    noise = measure_noise(time[usable], pose[usable])
    track = Rows(time, pose, np.clip(noise, scale[0], 3.0 * scale[0]))
    sticks_out, displaced, touched = find_one_motion(track, usable)
    return {
        "pose: is not a number": unknown,
        _AGAIN: again,
        "pose: does not change while the glider moves: frozen": frozen,
        f"pose: {FILLED}": filled,
        "pose: its attitude jumps, as where markers are taken for others": turned,
        "pose: lies still, or is held": standing,
        "pose: departs from the motion around it": sticks_out,
        "pose: the track jumps and stays displaced": displaced,
        "pose: it touches something: its velocity jumps": touched,
    }


def _find_turned_over(flight: Flight) -> np.ndarray:
    """Flags of rows between jumps of the axis to the left that no body can turn by.

    Each jump exchanges markers, or undoes it; most rows are right. (Where markers are
    exchanged so that the axis stays, the pitch jumps.)
    """
    if flight.attitude is None:
        return np.zeros(len(flight.time), dtype=bool)
    _, roll, yaw = flight.attitude.T
    left = body_axes(flight.pose[:, 2], roll, yaw)[:, :, 1]

    cosine = np.sum(left[:-1] * left[1:], axis=1)
    is_quick = np.diff(flight.time) < _TURN / _TURNING
    is_jump = (cosine < np.cos(_TURN)) & is_quick
    jumps = np.cumsum(np.append(0, is_jump))
    turned = jumps % 2 == 1
    return turned if np.mean(turned) < 0.5 else ~turned


def measure_noise(time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Standard deviations (k,) of the noise of columns; zeros of less than five rows.

    Args:
        time: (n,), increasing [s].
        values: (n, k).
    """
    differences, _ = fourth_differences(time, values)
    if len(differences) == 0:
        return np.zeros(values.shape[1])
    return robust_std(differences)


def _measure_scale(logs: Sequence[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    """Noise and last digits (2, k) of logs by the same cameras.

    Second differences are multiples of the last digit, and the smallest is taken for
    it: infinite of a column that never bends. Rows that repeat others do not count.

    Args:
        logs: times (n,) and columns (n, k) of each.
    """
    noises = []
    bends = []
    for time, values in logs:
        fresh = np.isfinite(values).all(axis=1) & ~find_repeats(values, 2)
        noises.append(measure_noise(time[fresh], values[fresh]))
        bends.append(np.diff(values[fresh], 2, axis=0))
    sizes = np.round(np.abs(np.concatenate(bends)), _DECIMALS)
    digits = np.min(sizes, axis=0, where=sizes > 0.0, initial=np.inf)
    return np.stack([np.median(noises, axis=0), digits])


def find_stale(time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Flags of rows that repeat the one before though the body moves on.

    Args:
        time: (n,) of a recording, increasing [s].
        values: (n, k).
    """
    scale = _measure_scale([(time, values)])
    return _find_held(values, scale, 2)


def find_filled(time: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Flags of rows of positions (n, k) that software put on a straight line.

    Second differences of what cameras measure have noise; of rows that fill a gap, but
    for rounding, they are zero in all columns at once. Positions of few digits do not
    show it.

    Args:
        time: (n,), increasing [s].
        position: (n, k), of which columns that never bend do not count [m].
    """
    noise, digits = _measure_scale([(time, position)])
    moves = np.isfinite(digits)
    noise = noise[moves]
    is_fine = noise > _LEAST_NOISE * digits[moves]

    # The way by which row i + 1 departs from the line through its neighbors.
    steps = np.diff(time)[:, None]
    slopes = np.diff(position[:, moves], axis=0) / steps
    bends = np.diff(slopes, axis=0) * np.minimum(steps[:-1], steps[1:])
    is_straight = np.all(np.abs(bends) <= _STRAIGHT * noise, axis=1)
    is_straight &= np.any(slopes[1:] != 0.0, axis=1) & is_fine.all()

    is_filled = np.zeros(len(time), dtype=bool)
    for first, last in stretches(is_straight):
        is_filled[first + 1 : last + 2] = last - first + 1 >= _FEWEST_FILLED
    return is_filled


def _find_held(values: np.ndarray, scale: np.ndarray, least: int) -> np.ndarray:
    """Flags of rows that repeat the one before though a body moves.

    A camera that measures again measures another number, but for its last digit and
    noise: equal rows of a body that then moves on by several of these are the last
    pose, sent again. A slow body, in coarse digits, repeats what was measured. Or all
    columns are noisier than their digits by so much that many equal numbers cannot be.

    Args:
        values: (n, k).
        scale: noise and last digits (2, k).
        least: number of equal rows below which they pass.
    """
    held = np.zeros(len(values), dtype=bool)
    noise, digits = scale
    surely = np.maximum(_SURELY * noise, _QUANTA * digits)
    is_noisy = least >= _EQUAL_NUMBERS and np.all(noise > _NOISY * digits)

    for first, last in stretches(find_repeats(values, least)):
        beside = last + 1  # The row after them; at the end of a log, that before.
        if beside == len(values):
            beside = first - 2
        moved = np.abs(values[beside] - values[last])
        held[first : last + 1] = is_noisy or np.any(moved > surely)
    return held


def _find_servo_faults(campaign: Campaign) -> dict[str, dict[str, np.ndarray]]:
    """Finds where measured elevators stick out or are frozen.

    An angle sticks out if it departs from the median of itself and its neighbors by
    more than noise and a turn of the servo. Equal angles are frozen if the commands,
    without any delay, would have moved them.

    Returns:
        Flags of rows, by the name of a flight and the reason.
    """
    elevators = measure_elevators(campaign, {})
    if not elevators:
        return {}
    angles = np.concatenate([elevator.angle for elevator in elevators])
    low, high = campaign.elevator_limits or (np.min(angles), np.max(angles))
    servo = LateServo(low, high)
    noises = [measure_noise(each.seen, each.angle[:, None]) for each in elevators]
    surely = _SURELY * np.median(noises)

    faults = {}
    for elevator in elevators:
        # A turn of the servo within a step sticks out by a step at full rate.
        rate = campaign.elevator_rate_limit or np.max(np.abs(elevator.tape.commands))
        turn = rate * np.median(np.diff(elevator.seen))
        angle = elevator.angle
        around = sliding_window_view(np.pad(angle, 1, mode="edge"), 3)
        apart = np.abs(angle - np.median(around, axis=1))
        sticks_out = apart > np.sqrt(2.0) * surely + turn

        frozen = np.zeros_like(sticks_out)
        ordered = elevator.follow(elevator.seen, servo)
        for first, last in stretches(find_repeats(angle[:, None], _EQUAL_NUMBERS)):
            moved = np.ptp(ordered[first - 1 : last + 1])
            frozen[first : last + 1] = moved > max(_MIN_COMMANDED, surely)
        frozen &= ~sticks_out
        faults[elevator.name] = {
            "elevator: departs from the motion around it": sticks_out,
            "elevator: does not change while commands move it: frozen": frozen,
        }
    return faults


def _find_standing(flight: Flight, usable: np.ndarray) -> np.ndarray:
    """Flags of rows up to the last at rest before the throw, and from the first landed.

    A body that rests in free air falls: where it is slow, and does not accelerate, it
    is held or lies. In the first half of its way that is before the throw.

    Args:
        flight: of n rows.
        usable: (n,) rows whose pose may be used.
    """
    time = flight.time
    motion = calc_motion(time[usable], flight.pose[usable])
    force = np.linalg.norm(motion.acceleration[:, :2], axis=1)
    rests = (motion.speed < _AT_REST) & (force < _HELD)
    way = np.cumsum(motion.speed)
    is_early = way < 0.5 * np.max(way, initial=0.0)
    begin = np.max(motion.time, where=rests & is_early, initial=-np.inf)
    end = np.min(motion.time, where=rests & ~is_early, initial=np.inf)
    return (time <= begin) | (time >= end)


def find_hand(flight: Flight, usable: np.ndarray, gravity: float) -> np.ndarray:
    """Flags of rows at the start where a hand still accelerates the glider.

    A thrust, wind or a tilted frame push throughout; a hand lets go. So the force
    along the path is compared with that of the flight's second half.

    Args:
        flight: of n rows.
        usable: (n,) rows whose pose may be used.
        gravity: [m/s²].
    """
    none = np.zeros_like(usable)
    own = flight.time[usable]
    if len(own) == 0:
        return none
    drive = calc_drive(own, flight.pose[usable, :2], gravity)
    second_half = drive.push[len(own) // 2 :]
    usual = max(np.median(second_half), 0.0)
    free = np.argmax(drive.push - usual <= PUSH)
    # First held, then free: 0 is also what `argmax` says of a glider held throughout.
    if free == 0 or drive.speed[free] < _HAND_GAIN * max(drive.speed[0], 1e-3):
        return none
    # The cubics see the hand until their windows are past it.
    last = min(free + half_window(own), len(own) - 1)
    return flight.time <= own[last]
