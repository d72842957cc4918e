"""All checks of a campaign in their order: what is kept, corrected and excluded.

An `Inspection` passes from check to check. Each excludes rows in its masks, or flights
of its campaign, and refuses a campaign of which too little remains.
"""

import dataclasses
import math
from collections.abc import Callable

import numpy as np

from glider.campaign.checks.fall import check_fall
from glider.campaign.checks.forces import measure_motions
from glider.campaign.checks.frame import check_frame, check_tail
from glider.campaign.checks.masks import (
    ALL,
    ExcludedRows,
    Inspection,
    find_repeats,
    name_rows,
)
from glider.campaign.checks.planarity import find_rolled
from glider.campaign.checks.rates import check_commands, check_rates
from glider.campaign.checks.rows import find_faults, find_hand
from glider.campaign.checks.servo import check_follows, measure_elevators
from glider.campaign.checks.stamps import find_even_times
from glider.campaign.checks.travel import check_travel
from glider.campaign.logs import Campaign, Flight

_MIN_ROWS = 20  # Usable rows of a flight, as the reader expects.
_MIN_SPAN = 0.15  # Time that they span [s].
_MIN_DENSITY = 0.5
"""Share of usable rows between the first and the last of a flight, repeats apart."""
_MIN_SHARE = 0.5  # Of flights that must be kept: else the campaign is at fault.
_MAX_FAULTY = 0.6  # Share of the rows of an elevator: the rest is no better.
_ROLLED = "by roll and yaw its wing is more than half out of the plane of flight"
_PUSHED = "a hand still pushes the glider"
_BEYOND = "pose: beyond a gap whose commands are not known"


def inspect(campaign: Campaign) -> Inspection:
    """Checks a campaign before anything is traced.

    The order matters: each check relies on what those before it have excluded.

    Returns:
        The flights that remain, their masks sorted by name, and all that was found.

    Raises:
        InputError: the campaign is of no use, with the reason.
    """
    campaign, of_stamps = _with_even_times(campaign)
    found = find_faults(campaign)
    found = _drop(found, _find_copies(campaign))
    check_follows(found.campaign, measure_elevators(found.campaign, found.masks))
    off_rates = check_rates(found.campaign)
    found = _drop(found, _find_servoless(found))
    gravity = campaign.gravity
    found = _exclude(found, lambda f, usable: find_hand(f, usable, gravity), _PUSHED)
    check_frame(found.campaign, measure_motions(found.campaign.flights, found.masks))
    found = _exclude(found, find_rolled, _ROLLED)

    # Until here poses counted, whatever the servo did.
    masks = found.masks
    found = _exclude(found, lambda flight, _: masks[flight.name].beyond, _BEYOND)
    kept = found.campaign
    motions = measure_motions(kept.flights, masks)
    warnings = check_fall(kept, motions)
    check_commands(kept)
    warnings += check_travel(kept, measure_elevators(kept, masks))
    check_tail(kept, motions)

    names = sorted(flight.name for flight in kept.flights)
    return Inspection(
        campaign=kept,
        masks={name: masks[name] for name in names},
        excluded=tuple(sorted(found.excluded, key=lambda rows: rows.file)),
        warnings=campaign.notes + warnings + of_stamps + off_rates + found.warnings,
    )


def _with_even_times(campaign: Campaign) -> tuple[Campaign, tuple[str, ...]]:
    """Restores even steps of flights whose stamps jitter, and warns of them.

    The servo's columns have these stamps, too: the largest jitter adds to the standard
    error of their times.

    Returns:
        The campaign, and the sentence on it if any flight has other times.
    """
    logs = [(flight.time, flight.pose[:, :2]) for flight in campaign.flights]
    found, words = find_even_times(logs, campaign.pose_rate)
    if not words:
        return campaign, ()
    flights = list(campaign.flights)
    jitter = 0.0
    for i, even in enumerate(found):
        if even is not None:
            time = even.at(flights[i].time)
            flights[i] = dataclasses.replace(flights[i], time=time)
            jitter = max(jitter, even.jitter)
    error = math.hypot(campaign.servo.clock_std, jitter)
    servo = dataclasses.replace(campaign.servo, clock_std=error)
    return dataclasses.replace(campaign, flights=tuple(flights), servo=servo), (words,)


def _drop(found: Inspection, reasons: dict[str, str]) -> Inspection:
    """Excludes whole flights, and refuses a campaign of which too few remain.

    Args:
        found: what is excluded so far.
        reasons: why flights are excluded, by their names.
    """
    campaign = found.campaign
    flights = campaign.flights
    kept = tuple(flight for flight in flights if flight.name not in reasons)
    if len(kept) < _MIN_SHARE * len(flights):
        name, why = next(iter(reasons.items()))
        campaign.refuse(
            f"{len(reasons)} of {len(flights)} flights cannot be used, {name} for one: "
            f"{why}."
        )
    whole = tuple(ExcludedRows(name, ALL, why) for name, why in reasons.items())
    return dataclasses.replace(
        found,
        campaign=dataclasses.replace(campaign, flights=kept),
        excluded=found.excluded + whole,
    )


def _exclude(
    found: Inspection, find: Callable[[Flight, np.ndarray], np.ndarray], why: str
) -> Inspection:
    """Excludes rows of each flight, and flights of which too few rows remain.

    Those that remain must be long enough, and not be scattered among faulty ones; rows
    that repeat the one before do not count as faulty.

    Args:
        found: what is excluded so far; its masks change.
        find: finds flags of rows (n,) of a flight, given its usable rows (n,).
        why: the reason.
    """
    reasons = {}
    excluded = []
    for flight in found.campaign.flights:
        mask = found.masks[flight.name]
        flags = find(flight, mask.usable) & mask.usable
        cause = ""
        if flags.any():
            mask.pose[flags] = True
            excluded.append(ExcludedRows(flight.name, name_rows(flags), why))
            cause = f" ({why})"

        rows = np.flatnonzero(mask.usable)
        if len(rows) < _MIN_ROWS or np.ptp(flight.time[rows]) < _MIN_SPAN:
            reasons[flight.name] = (
                f"only {len(rows)} rows of it show a flight; expected at least "
                f"{_MIN_ROWS} over {_MIN_SPAN} s{cause}"
            )
            continue

        fresh = ~find_repeats(flight.pose, 2)
        measured = np.sum(fresh[rows[0] : rows[-1] + 1])
        if len(rows) < _MIN_DENSITY * measured:
            reasons[flight.name] = "most of its rows are faulty"
    found = dataclasses.replace(found, excluded=found.excluded + tuple(excluded))
    return _drop(found, reasons)


def _find_copies(campaign: Campaign) -> dict[str, str]:
    """Flights whose poses are those of an earlier one, row by row, with the reason."""
    first: dict[bytes, str] = {}
    reasons = {}
    for flight in campaign.flights:
        other = first.setdefault(flight.pose.tobytes(), flight.name)
        if other != flight.name:
            reasons[flight.name] = f"the same rows as {other}"
    return reasons


def _find_servoless(found: Inspection) -> dict[str, str]:
    """Flights whose elevator is faulty in most usable rows, with the reason."""
    reasons = {}
    for flight in found.campaign.flights:
        mask = found.masks[flight.name]
        is_faulty = mask.elevator[mask.usable]
        share = np.sum(is_faulty) / max(len(is_faulty), 1)
        if share > _MAX_FAULTY:
            words = f"{100 * share:.0f} % of the rows of its elevator are faulty"
            reasons[flight.name] = words
    return reasons
