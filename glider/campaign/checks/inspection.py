"""All checks of a campaign in their order: what is kept, corrected and excluded."""

import dataclasses
import functools
import math
from collections.abc import Callable

import numpy as np

from glider.campaign.checks.forces import Motions, check_fall, measure_motions
from glider.campaign.checks.frame import check_frame, check_tail
from glider.campaign.checks.masks import (
    ALL,
    ExcludedRows,
    Inspection,
    Masks,
    find_repeats,
    name_rows,
)
from glider.campaign.checks.planarity import find_rolled
from glider.campaign.checks.rates import check_commands, check_rates
from glider.campaign.checks.rows import find_faults, find_hand
from glider.campaign.checks.servo import check_follows, check_travel, measure_elevators
from glider.campaign.checks.stamps import find_even_times
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
    """Checks a campaign before anything is traced; refuses one of no use."""
    campaign, of_stamps = _with_even_times(campaign)
    kept = _Kept(campaign)
    kept.drop(_find_copies(kept.campaign), least=0.0)
    faults = find_faults(kept.campaign)
    kept.masks.update(faults.masks)
    kept.excluded += faults.excluded
    check_follows(kept.campaign, measure_elevators(kept.campaign, kept.masks))
    off_rates = check_rates(kept.campaign)
    kept.drop(_find_servoless(kept.campaign, kept.masks))
    kept.mask(functools.partial(find_hand, gravity=campaign.gravity), _PUSHED)
    check_frame(kept.campaign, kept.motions())
    kept.mask(find_rolled, _ROLLED)
    # Until here poses counted, whatever the servo did.
    kept.mask(lambda flight, _: kept.masks[flight.name].beyond, _BEYOND)
    motions = kept.motions()
    warnings = check_fall(kept.campaign, motions)
    check_commands(kept.campaign)
    elevators = measure_elevators(kept.campaign, kept.masks)
    warnings += check_travel(kept.campaign, elevators)
    warnings += check_tail(kept.campaign, motions)
    names = sorted(flight.name for flight in kept.campaign.flights)
    return Inspection(
        campaign=kept.campaign,
        masks={name: kept.masks[name] for name in names},
        excluded=tuple(sorted(kept.excluded, key=lambda rows: rows.file)),
        warnings=campaign.notes + warnings + of_stamps + off_rates + faults.warnings,
    )


def _with_even_times(campaign: Campaign) -> tuple[Campaign, tuple[str, ...]]:
    """Restores even steps of flights whose stamps jitter, and warns of them."""
    logs = [(flight.time, flight.pose[:, :2]) for flight in campaign.flights]
    found, words = find_even_times(logs, campaign.pose_rate)
    if not words:
        return campaign, ()
    flights = []
    for flight, even in zip(campaign.flights, found, strict=True):
        time = flight.time if even is None else even.at(flight.time)
        flights.append(dataclasses.replace(flight, time=time))
    jitter = max(0.0 if even is None else even.jitter for even in found)
    error = math.hypot(campaign.servo.clock_std, jitter)
    servo = dataclasses.replace(campaign.servo, clock_std=error)
    return dataclasses.replace(campaign, flights=tuple(flights), servo=servo), (words,)


class _Kept:
    """What is kept of a campaign, and what was excluded so far."""

    def __init__(self, campaign: Campaign) -> None:
        self.campaign = campaign
        self.masks: dict[str, Masks] = {}
        self.excluded: list[ExcludedRows] = []

    def motions(self) -> Motions:
        """Motions of the flights that are kept, over their usable rows."""
        return measure_motions(self.campaign.flights, self.masks)

    def drop(self, reasons: dict[str, str], least: float = _MIN_SHARE) -> None:
        """Excludes flights by name; refuses a campaign of which too few remain."""
        flights = self.campaign.flights
        kept = tuple(flight for flight in flights if flight.name not in reasons)
        if len(kept) < least * len(flights):
            name, why = next(iter(reasons.items()))
            self.campaign.refuse(
                f"{len(reasons)} of {len(flights)} flights "
                f"cannot be used, {name} for one: {why}."
            )
        self.campaign = dataclasses.replace(self.campaign, flights=kept)
        self.excluded += [ExcludedRows(n, ALL, why) for n, why in reasons.items()]

    def mask(self, find: Callable[[Flight, np.ndarray], np.ndarray], why: str) -> None:
        """Excludes the rows that `find` finds in each flight, given its usable ones.

        Also flights of which too few rows are kept, or too scattered ones.
        """
        reasons = {}
        for flight in self.campaign.flights:
            mask = self.masks[flight.name]
            found = find(flight, mask.usable) & mask.usable
            cause = ""
            if found.any():
                mask.pose[found] = True
                self.excluded.append(ExcludedRows(flight.name, name_rows(found), why))
                cause = f" ({why})"
            rows = np.flatnonzero(mask.usable)
            span = np.ptp(flight.time[rows]) if len(rows) else 0.0
            if len(rows) < _MIN_ROWS or span < _MIN_SPAN:
                reasons[flight.name] = (
                    f"only {len(rows)} rows of it show a flight; expected at least "
                    f"{_MIN_ROWS} over {_MIN_SPAN} s{cause}"
                )
                continue
            fresh = ~find_repeats(flight.pose, 2)
            if len(rows) < _MIN_DENSITY * np.sum(fresh[rows[0] : rows[-1] + 1]):
                reasons[flight.name] = "most of its rows are faulty"
        self.drop(reasons)


def _find_copies(campaign: Campaign) -> dict[str, str]:
    """Flights whose poses are those of an earlier one, row by row, with the reason."""
    first: dict[bytes, str] = {}
    reasons = {}
    for flight in campaign.flights:
        other = first.setdefault(flight.pose.tobytes(), flight.name)
        if other != flight.name:
            reasons[flight.name] = f"the same rows as {other}"
    return reasons


def _find_servoless(campaign: Campaign, masks: dict[str, Masks]) -> dict[str, str]:
    """Flights whose elevator is faulty in most rows, with the reason."""
    reasons = {}
    for flight in campaign.flights:
        mask = masks[flight.name]
        share = np.mean(mask.elevator[mask.usable]) if mask.usable.any() else 0.0
        if share > _MAX_FAULTY:
            words = f"{100 * share:.0f} % of the rows of its elevator are faulty"
            reasons[flight.name] = words
    return reasons
