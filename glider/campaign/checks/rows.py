"""Rows of a log that show no flight: frozen, held, standing, sticking out, displaced.

A glider moves smoothly, and cameras have noise. A body in free fall cannot stay where
it is: from rest it falls 18 mm in 60 ms. Air takes energy from a glider: what
accelerates it along its path is a hand. Rows are excluded, never corrected.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np

from glider.campaign.checks.masks import (
    ExcludedRows,
    Masks,
    find_repeats,
    name_rows,
    stretches,
)
from glider.campaign.checks.motion import calc_motion, robust_std
from glider.campaign.checks.planarity import body_axes
from glider.campaign.checks.smoothness import Track, find_one_motion, fourth_differences
from glider.campaign.logs import Campaign, Flight
from glider.physics.held_commands import command_steps, hides_command
from glider.physics.servo import elevator_path

_AGAIN = "repeat the pose before while the glider moves"
_EQUAL_POSES = 3  # Equal rows of x, z and pitch together that are frozen.
_EQUAL_NUMBERS = 5  # Equal rows of one column that may be frozen.
_SURELY = 6.0  # Standard deviations by which a column should have moved, or did.
_DECIMALS = 9  # Of m and rad, that a log may have: beyond is rounding.
_QUANTA = 5.0  # Digits of the log by which it should have.
_NOISY = 10.0  # Ratio of noise to digits: five equal rows have odds of 1e-6.
_REACH = 6  # Rows beside a frozen stretch from which its slope is taken.
_LONG_STEP = 3.0  # Median steps above which a step is reported as a gap.
_LOST = 1.5  # The same above which rows are lost.
_UNCOMMANDED = 0.05
"""Gap over which a flight with a servo is cut [s]: the commands in it are lost as well,
and two of them at 50 Hz turn the elevator by 0.5 rad."""
_BESIDE = 3  # Rows on each side of a gap that show how far the elevator turned in it.
_MIN_COMMANDED = 0.1  # Angle that commands move while an elevator is frozen [rad].
_NEAR_STOP = 0.02  # An elevator this close to its stop may rest there [rad].
_TURN = 1.0
"""Angle by which an attitude jumps where markers are exchanged [rad]. Measured throws
turn by 0.14 at most from row to row, noise included."""
_TURNING = 30.0  # Rate by which a body may turn that far, in a longer step [rad/s].
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
_STOPPED = 0.25  # Share of flights ending in a contact above which all may.
_AT_STOP = "pose: the last row before a contact, as most flights end in one"
_REST = 1.0  # Slower than this a log starts from rest: in a hand [m/s].
_HAND_GAIN = 1.3  # Ratio of the speeds when a hand lets go and at the log's start.
_LATER = 0.5  # From this share of the log on the force is "usual".


@dataclasses.dataclass(frozen=True, kw_only=True)
class Faults:
    """What is wrong with rows of a campaign."""

    masks: dict[str, Masks]  #: By the name of the flight.
    excluded: tuple[ExcludedRows, ...]
    warnings: tuple[str, ...]


def find_faults(campaign: Campaign) -> Faults:
    """Finds rows that are frozen, stick out or are displaced; reports gaps.

    The noise is measured on all flights: one bad flight does not hide itself. For false
    alarms see `smoothness.THRESHOLD`; a row that sticks out by 4 noises or less passes.
    """
    flights = campaign.flights
    known = [(f, np.isfinite(f.pose).all(axis=1)) for f in flights]
    known = [(f, rows & ~find_repeats(f.pose, 2)) for f, rows in known]
    each = [_measure_noise(f.time[rows], f.pose[rows]) for f, rows in known]
    noise = np.median(each, axis=0)
    digits = _last_digits([f.pose[rows] for f, rows in known])
    angles = [(f.time, f.elevator[:, None]) for f in flights if f.elevator is not None]
    each = [_measure_noise(time, angle) for time, angle in angles]
    elevator_noise = float(np.median(each)) if each else 0.0
    masks = {}
    excluded = []
    warnings = []
    repeated = 0
    is_stopped = list[bool]()
    for flight in flights:
        piece = pieces_with_commands(flight, campaign)
        of_pose = _pose_faults(flight, noise, digits)
        of_servo = _elevator_faults(campaign, flight, elevator_noise)
        again = of_pose.pop(_AGAIN)
        pose = np.logical_or.reduce([again, *of_pose.values()])
        elevator = np.logical_or.reduce([np.zeros_like(pose), *of_servo.values()])
        first = 0
        last = len(pose)
        if flight.command is not None:  # The longest piece has all its commands.
            longest = np.argmax(np.bincount(piece, weights=~pose))
            first, last = np.searchsorted(piece, [longest, longest + 1]).tolist()
        mask = Masks(pose=pose, elevator=elevator, first=first, last=last)
        masks[flight.name] = mask
        for what, faults in (("pose", of_pose), ("elevator", of_servo)):
            excluded += [
                ExcludedRows(flight.name, name_rows(flags), f"{what}: {why}")
                for why, flags in faults.items()
                if flags.any()
            ]
        steps = np.diff(flight.time)
        usual = float(np.median(steps))
        warnings += [
            f"{flight.name}: a gap of {round(steps[i] / usual) - 1} rows "
            f"({steps[i]:.3g} s) after row {i + 2}"
            for i in np.flatnonzero(steps > _LONG_STEP * usual)
        ]
        repeated += int(np.sum(again))
        is_stopped.append(pose[~again][-1])
    if repeated:
        rows = sum(len(flight.time) for flight in flights)
        warnings.append(f"{repeated} of {rows} rows {_AGAIN}: they are not used")
    if sum(is_stopped) > _STOPPED * len(flights):
        for name, mask in masks.items():  # Within a row a stop can hide in noise.
            for last in np.flatnonzero(mask.usable)[-1:]:
                mask.pose[last] = True
                excluded.append(ExcludedRows(name, f"{last + 2}", _AT_STOP))
    return Faults(masks=masks, excluded=tuple(excluded), warnings=tuple(warnings))


def pieces_with_commands(flight: Flight, campaign: Campaign) -> np.ndarray:
    """The piece that each row is in (n,): gaps that hide commands are cut.

    Lost rows that may hide one command are such a gap if the elevator turned there by
    what no command says, and more than anywhere else: there a servo lags, or stops.
    """
    steps = np.diff(flight.time)
    usual = float(np.median(steps))
    rate = campaign.switch_rate
    is_gap = steps > max(_UNCOMMANDED, _LONG_STEP * usual)
    if flight.command is None or flight.elevator is None:
        return np.concatenate([[0], np.cumsum(is_gap)])
    hides = hides_command(flight.time, flight.command, rate) & (steps > _LOST * usual)
    if hides.any():
        tape = command_steps(flight.time, flight.command, rate, flight.command_time)
        begin = float(flight.elevator[0])
        servo = campaign.limits
        ordered = elevator_path(*tape, flight.time, servo, start=begin)
        apart = np.pad(flight.elevator - ordered, _BESIDE, mode="edge")
        rows = np.lib.stride_tricks.sliding_window_view(apart, _BESIDE)
        level = np.median(rows, axis=1)  # Of which one may be wrong.
        turned = (level[_BESIDE:] - level[:-_BESIDE])[1:-1]
        turned -= np.median(turned)
        least = _SURELY * float(robust_std(turned))
        is_near = np.convolve(hides, np.ones(2 * _BESIDE + 1), "same") > 0.0
        least = np.max(np.abs(turned), where=~is_near, initial=least)
        is_gap |= hides & (np.abs(turned) > least)
    return np.concatenate([[0], np.cumsum(is_gap)])


def _pose_faults(
    flight: Flight, noise: np.ndarray, digits: np.ndarray
) -> dict[str, np.ndarray]:
    """Faulty rows (n,) of the pose, by the reason."""
    unknown = ~np.all(np.isfinite(flight.pose), axis=1)
    least = np.maximum(_SURELY * noise, _QUANTA * digits)
    again = _repeated(flight.time, flight.pose, least)
    again &= ~find_repeats(flight.pose, _EQUAL_POSES)
    frozen = _frozen(flight, noise, digits)
    turned = _turned_over(flight)
    usable = ~(unknown | again | frozen | turned)
    standing = find_standing(flight, usable)
    usable &= ~standing
    own = _measure_noise(flight.time[usable], flight.pose[usable])
    own = np.clip(own, noise, 3.0 * noise)
    track = Track(flight.time, flight.pose, own)
    sticks_out, displaced, touched = find_one_motion(track, usable)
    return {
        "is not a number": unknown,
        _AGAIN: again,
        "does not change while the glider moves: frozen": frozen,
        "its attitude jumps, as where markers are taken for others": turned,
        "lies still, or is held": standing,
        "departs from the motion around it": sticks_out,
        "the track jumps and stays displaced": displaced,
        "it touches something: its velocity jumps": touched,
    }


def _turned_over(flight: Flight) -> np.ndarray:
    """Rows (n,) between jumps of the attitude that no body can turn by.

    The longest stretch without a jump is right, and those that continue it.
    """
    rows = np.arange(len(flight.time))
    if flight.attitude is None:
        return np.zeros(len(rows), dtype=bool)
    _, roll, yaw = flight.attitude.T
    axes = body_axes(flight.pose[:, 2], roll, yaw)

    def is_jump(one: np.ndarray, other: np.ndarray) -> np.ndarray:
        """Whether the body turns by more than `_TURN` from rows to others."""
        cosine = 0.5 * (np.einsum("kij,kij->k", axes[one], axes[other]) - 1.0)
        return cosine < np.cos(_TURN)

    jumps = is_jump(rows[:-1], rows[1:]) & (np.diff(flight.time) < _TURN / _TURNING)
    parts = np.split(rows, np.flatnonzero(jumps) + 1)
    longest = max(range(len(parts)), key=lambda k: len(parts[k]))
    turned = np.ones(len(rows), dtype=bool)
    for inner, outer, side in ((0, -1, parts[longest:]), (-1, 0, parts[longest::-1])):
        last = parts[longest][[inner]]
        for part in side:
            if part is parts[longest] or not is_jump(last, part[[inner]])[0]:
                turned[part], last = False, part[[outer]]
    return turned


def _measure_noise(time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Standard deviations (k,) of the noise of columns (n, k)."""
    differences, _ = fourth_differences(time, values)
    return robust_std(differences) if len(differences) else np.zeros(values.shape[1])


def find_stale(time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Rows (n,) of a recording (n, k) that repeat the one before, but move on."""
    fresh = ~find_repeats(values, 2)
    noise = _measure_noise(time[fresh], values[fresh])
    digits = _last_digits([values[fresh]])
    return _repeated(time, values, np.maximum(_SURELY * noise, _QUANTA * digits))


def _last_digits(logs: Sequence[np.ndarray]) -> np.ndarray:
    """The last digit of columns (k,) of logs (n, k) without repeats.

    All differences are multiples of it; of a fast motion the second ones are small.
    """
    steps = [np.diff(log, order, axis=0) for log in logs for order in (1, 2)]
    sizes = np.round(np.abs(np.concatenate(steps)), _DECIMALS)
    return np.min(sizes, axis=0, where=sizes > 0.0, initial=np.inf)


def _repeated(time: np.ndarray, values: np.ndarray, least: np.ndarray) -> np.ndarray:
    """Rows (n,) that repeat the one before where a column moves by more than `least`.

    A camera that measures again measures another number, but for its last digit and
    noise: equal rows of a body that moves by several of these are the last pose, sent
    again. A slow body, in coarse digits, repeats what was measured.
    """
    stale = np.zeros(len(time), dtype=bool)
    for first, last in stretches(find_repeats(values, 2)):
        for k, own in enumerate(least):
            if _moves_on(time, values[:, k], first - 1, last, own):
                stale[first : last + 1] = True
    return stale


def _frozen(flight: Flight, noise: np.ndarray, digits: np.ndarray) -> np.ndarray:
    """Rows (n,) that repeat the row before while the glider moves.

    One column alone must have been about to move, or be noisier than its digits by so
    much that equal numbers cannot be.
    """
    same = np.diff(flight.pose, axis=0, prepend=np.nan) == 0.0
    least = np.maximum(_SURELY * noise, _QUANTA * digits)
    frozen = find_repeats(flight.pose, _EQUAL_POSES)
    for k in range(3):
        noisy = noise[k] > _NOISY * digits[k]
        for first, last in stretches(same[:, k]):
            rows = flight.time, flight.pose[:, k], first - 1, last
            long = last - first + 2 >= _EQUAL_NUMBERS
            if long and (noisy or _moves_on(*rows, least[k])):
                frozen[first : last + 1] = True
    return frozen


def _moves_on(
    time: np.ndarray, values: np.ndarray, first: int, last: int, least: float
) -> bool:
    """Whether a column (n,) moves by more than `least` while equal, by its neighbors.

    It must catch up, then.
    """
    following = values[last + 1 : last + 2]
    if not np.all(np.abs(following - values[last]) > least):
        return False
    for rows in (
        slice(max(first - _REACH, 0), first + 1),
        slice(last + 1, last + _REACH),
    ):
        known = np.isfinite(values[rows])
        own = time[rows][known]
        beside = values[rows][known]
        if len(own) >= 4:
            slope = np.polyfit(own - own[0], beside, 1)[0]
            if abs(slope) * (time[last] - time[first]) > least:
                return True
    return False


def _elevator_faults(
    campaign: Campaign, flight: Flight, noise: float
) -> dict[str, np.ndarray]:
    """Rows (n,) of the elevator that stick out or are frozen, by the reason."""
    if flight.elevator is None or flight.command is None:
        return {}
    angle = flight.elevator
    steps = np.diff(flight.time)
    rate = campaign.elevator_rate_limit or float(np.max(np.abs(flight.command)))
    sticks_out = np.zeros(len(angle), dtype=bool)
    before = angle[:-2]
    here = angle[1:-1]
    after = angle[2:]
    high = np.maximum(before, after)
    low = np.minimum(before, after)
    over = np.maximum(here - high, low - here)
    # A turn of the servo within a step sticks out by a step at full rate.
    turn = rate * np.minimum(steps[:-1], steps[1:])
    sticks_out[1:-1] = over > _SURELY * np.sqrt(2.0) * noise + turn
    frozen = np.zeros(len(angle), dtype=bool)
    commanded = elevator_path(flight.time, flight.command, flight.time)
    angles = np.concatenate([np.asarray(f.elevator) for f in campaign.flights])
    stops = campaign.elevator_limits or (np.min(angles), np.max(angles))
    for first, last in stretches(np.diff(angle, prepend=np.nan) == 0.0):
        if last - first + 2 < _EQUAL_NUMBERS:
            continue
        value = angle[first]
        moved = np.ptp(commanded[first - 1 : last + 1])
        at_stop = min(abs(abs(value) - abs(stop)) for stop in stops) < _NEAR_STOP
        if moved > max(_MIN_COMMANDED, _SURELY * noise) and not at_stop:
            frozen[first : last + 1] = True
    return {
        "departs from the motion around it": sticks_out,
        "does not change while commands move it: frozen": frozen & ~sticks_out,
    }


def find_standing(flight: Flight, usable: np.ndarray) -> np.ndarray:
    """Rows (n,) that lie still or slide until they do, before the throw or landed."""
    standing = np.zeros(len(usable), dtype=bool)
    rows = np.flatnonzero(usable)
    if len(rows) < 3:
        return standing
    time = flight.time[rows]
    place = flight.pose[rows, :2]
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
