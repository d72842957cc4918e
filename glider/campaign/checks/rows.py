"""Rows of a log that show no flight: frozen, standing, sticking out, displaced.

Nothing here knows where down is or what a glider does: only that it moves smoothly,
and that cameras have noise. Rows are excluded, never corrected.
"""

import dataclasses

import numpy as np

from glider.campaign.checks.masks import ExcludedRows, Masks, name_rows, stretches
from glider.campaign.checks.motion import robust_std
from glider.campaign.checks.smoothness import Track, find_one_motion, fourth_differences
from glider.campaign.checks.standing import find_standing
from glider.campaign.logs import Campaign, Flight

_EQUAL_POSES = 3  # Equal rows of x, z and pitch together that are frozen.
_EQUAL_NUMBERS = 5  # Equal rows of one column that may be frozen.
_SURELY = 6.0  # Standard deviations by which a frozen column should have moved.
_QUANTA = 5.0  # Digits of the log by which it should have.
_NOISY = 10.0  # Ratio of noise to digits: five equal rows have odds of 1e-6.
_REACH = 6  # Rows beside a frozen stretch from which its slope is taken.
_LONG_STEP = 3.0  # Median steps above which a step is reported as a gap.
_UNCOMMANDED = 0.05
"""Gap over which a flight with a servo is cut [s]: the commands in it are lost as well,
and two of them at 50 Hz turn the elevator by 0.5 rad."""
_MIN_COMMANDED = 0.1  # Angle that commands move while an elevator is frozen [rad].
_NEAR_STOP = 0.02  # An elevator this close to its stop may rest there [rad].


@dataclasses.dataclass(frozen=True, kw_only=True)
class Faults:
    """What is wrong with rows of a campaign."""

    masks: dict[str, Masks]  # By the name of the flight.
    excluded: tuple[ExcludedRows, ...]
    warnings: tuple[str, ...]


def find_faults(campaign: Campaign) -> Faults:
    """Finds rows that are frozen, stick out or are displaced; reports gaps.

    The noise is measured on all flights: one bad flight does not hide itself. For false
    alarms see `smoothness.THRESHOLD`; a row that sticks out by 4 noises or less passes.
    """
    noise, digits = _measure_noise(campaign), _measure_digits(campaign)
    elevator_noise = _measure_elevator_noise(campaign)
    masks, excluded, warnings = {}, [], []
    for flight in campaign.flights:
        of_pose = _pose_faults(flight, noise, digits)
        of_servo = _elevator_faults(campaign, flight, elevator_noise)
        pose = np.logical_or.reduce(list(of_pose.values()))
        elevator = np.logical_or.reduce([np.zeros_like(pose), *of_servo.values()])
        masks[flight.name] = Masks(pose=pose, elevator=elevator)
        for what, faults in (("pose", of_pose), ("elevator", of_servo)):
            excluded += [
                ExcludedRows(
                    file=flight.name, rows=name_rows(flags), why=f"{what}: {why}"
                )
                for why, flags in faults.items()
                if flags.any()
            ]
        warnings += _describe_gaps(flight)
    return Faults(masks=masks, excluded=tuple(excluded), warnings=tuple(warnings))


def pieces_with_commands(time: np.ndarray) -> np.ndarray:
    """The piece that each row is in (n,): gaps that hide commands are cut."""
    steps = np.diff(time)
    is_gap = steps > max(_UNCOMMANDED, _LONG_STEP * float(np.median(steps)))
    return np.concatenate([[0], np.cumsum(is_gap)])


def _pose_faults(
    flight: Flight, noise: np.ndarray, digits: np.ndarray
) -> dict[str, np.ndarray]:
    """Faulty rows (n,) of the pose, by the reason."""
    unknown = ~np.all(np.isfinite(flight.pose), axis=1)
    frozen = _frozen(flight, noise, digits)
    usable = ~(unknown | frozen)
    standing = find_standing(flight, usable)
    usable &= ~standing
    own = np.clip(_flight_noise(flight, usable), noise, 3.0 * noise)
    track = Track(time=flight.time, pose=flight.pose, noise=own)
    verdict = find_one_motion(track, usable)
    usable &= ~(verdict.sticks_out | verdict.displaced)
    return {
        "is not a number": unknown,
        "does not change while the glider moves: frozen": frozen,
        "lies still, or is held": standing,
        "departs from the motion around it": verdict.sticks_out,
        "the track jumps and stays displaced": verdict.displaced,
        "beyond a gap whose commands are not known": _cut_off(flight, usable),
    }


def _measure_noise(campaign: Campaign) -> np.ndarray:
    """Standard deviations (3,) of x, z, pitch; the median of the flights'."""
    each = [_flight_noise(f, np.isfinite(f.pose).all(axis=1)) for f in campaign.flights]
    return np.median(each, axis=0)


def _flight_noise(flight: Flight, usable: np.ndarray) -> np.ndarray:
    differences, _ = fourth_differences(flight.time[usable], flight.pose[usable])
    return robust_std(differences) if len(differences) else np.zeros(3)


def _measure_digits(campaign: Campaign) -> np.ndarray:
    """The least change (3,) of x, z, pitch between rows of all flights."""
    changes = np.abs(
        np.concatenate([np.diff(f.pose, axis=0) for f in campaign.flights])
    )
    changes[~(changes > 0.0)] = np.inf
    return np.min(changes, axis=0)


def _measure_elevator_noise(campaign: Campaign) -> float:
    """Standard deviation of the elevator's sensor [rad]."""
    each = [
        robust_std(fourth_differences(f.time, f.elevator[:, None])[0])[0]
        for f in campaign.flights
        if f.elevator is not None
    ]
    return float(np.median(each)) if each else 0.0


def _frozen(flight: Flight, noise: np.ndarray, digits: np.ndarray) -> np.ndarray:
    """Rows (n,) that repeat the row before while the glider moves.

    One column alone must have been about to move, or be noisier than its digits by so
    much that equal numbers cannot be.
    """
    same = np.diff(flight.pose, axis=0, prepend=np.nan) == 0.0
    frozen = np.zeros(len(same), dtype=bool)
    for first, last in stretches(np.all(same, axis=1)):
        if last - first + 2 >= _EQUAL_POSES:
            frozen[first : last + 1] = True
    for k in range(3):
        noisy = noise[k] > _NOISY * digits[k]
        least = -1.0 if noisy else max(_SURELY * noise[k], _QUANTA * digits[k])
        for first, last in stretches(same[:, k]):
            long = last - first + 2 >= _EQUAL_NUMBERS
            if long and _missed(flight, k, first - 1, last) > least:
                frozen[first : last + 1] = True
    return frozen


def _missed(flight: Flight, column: int, first: int, last: int) -> float:
    """How far a column would have moved while it is equal, by its neighbors."""
    missed = [0.0]
    for rows in (
        slice(max(first - _REACH, 0), first + 1),
        slice(last + 1, last + _REACH),
    ):
        time, values = flight.time[rows], flight.pose[rows, column]
        if len(time) >= 4:
            slope = np.polyfit(time - time[0], values, 1)[0]
            missed.append(abs(slope) * (flight.time[last] - flight.time[first]))
    if last + 1 < len(flight.time) and len(missed) > 1:  # It must catch up, then.
        caught = abs(flight.pose[last + 1, column] - flight.pose[last, column])
        return float(min(caught, max(missed)))
    return float(max(missed))


def _elevator_faults(
    campaign: Campaign, flight: Flight, noise: float
) -> dict[str, np.ndarray]:
    """Rows (n,) of the elevator that stick out or are frozen, by the reason."""
    if flight.elevator is None or flight.command is None:
        return {}
    angle, steps = flight.elevator, np.diff(flight.time)
    rate = campaign.elevator_rate_limit or float(np.max(np.abs(flight.command)))
    sticks_out = np.zeros(len(angle), dtype=bool)
    before, here, after = angle[:-2], angle[1:-1], angle[2:]
    over = np.maximum(
        here - np.maximum(before, after), np.minimum(before, after) - here
    )
    # A turn of the servo within a step sticks out by a step at full rate.
    turn = rate * np.minimum(steps[:-1], steps[1:])
    sticks_out[1:-1] = over > _SURELY * np.sqrt(2.0) * noise + turn
    frozen = np.zeros(len(angle), dtype=bool)
    commanded = np.concatenate([[0.0], np.cumsum(flight.command[:-1] * steps)])
    angles = np.concatenate([np.asarray(f.elevator) for f in campaign.flights])
    stops = campaign.elevator_limits or (np.min(angles), np.max(angles))
    for first, last in stretches(np.diff(angle, prepend=np.nan) == 0.0):
        if last - first + 2 < _EQUAL_NUMBERS:
            continue
        value, moved = angle[first], np.ptp(commanded[first - 1 : last + 1])
        at_stop = min(abs(abs(value) - abs(stop)) for stop in stops) < _NEAR_STOP
        if moved > max(_MIN_COMMANDED, _SURELY * noise) and not at_stop:
            frozen[first : last + 1] = True
    return {
        "departs from the motion around it": sticks_out,
        "does not change while commands move it: frozen": frozen & ~sticks_out,
    }


def _cut_off(flight: Flight, usable: np.ndarray) -> np.ndarray:
    """Usable rows (n,) outside the longest piece that has all its commands."""
    if flight.command is None:
        return np.zeros(len(usable), dtype=bool)
    piece = pieces_with_commands(flight.time)
    longest = np.argmax(np.bincount(piece, weights=usable))
    return usable & (piece != longest)


def _describe_gaps(flight: Flight) -> list[str]:
    steps = np.diff(flight.time)
    usual = float(np.median(steps))
    return [
        f"{flight.name}: a gap of {round(steps[i] / usual) - 1} rows "
        f"({steps[i]:.3g} s) after row {i + 2}"
        for i in np.flatnonzero(steps > _LONG_STEP * usual)
    ]
