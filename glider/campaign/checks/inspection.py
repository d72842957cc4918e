"""All checks of a campaign in their order: what is kept, corrected and excluded."""

import dataclasses
import functools
from collections.abc import Callable

import numpy as np

from glider.campaign.checks.clocks import check_clocks, check_rates, find_unrelated
from glider.campaign.checks.fall import check_fall
from glider.campaign.checks.forces import calc_heading, fit_forces, join, usable_motion
from glider.campaign.checks.frame import check_frame, check_tail
from glider.campaign.checks.masks import (
    ALL,
    ExcludedRows,
    Masks,
    find_repeats,
    name_rows,
)
from glider.campaign.checks.planarity import find_rolled
from glider.campaign.checks.rows import find_faults, find_hand
from glider.campaign.checks.travel import check_travel
from glider.campaign.logs import Campaign, Flight
from glider.errors import InputError

_MIN_ROWS = 20  # Usable rows of a flight, as the reader expects.
_MIN_SPAN = 0.15  # Time that they span [s].
_MIN_DENSITY = 0.5
"""Share of usable rows between the first and the last of a flight, repeats apart."""
_MIN_SHARE = 0.5  # Of flights that must be kept: else the campaign is at fault.
_MAX_FAULTY = 0.6  # Share of the rows of an elevator: the rest is no better.
_ROLLED = "by roll and yaw its wing is more than half out of the plane of flight"
_HELD = "a hand still pushes the glider"
_BEYOND = "pose: beyond a gap whose commands are not known"
_UNRELATED = "its elevator does not follow its commands, unlike in most flights"


@dataclasses.dataclass(frozen=True, kw_only=True)
class Inspection:
    """A campaign after all checks: flights that fly, and rows that count."""

    campaign: Campaign  #: Without the excluded flights; axes turned where necessary.
    masks: dict[str, Masks]  #: Of the flights that are kept, by name.
    excluded: tuple[ExcludedRows, ...]  #: Rows and whole flights, by file.
    warnings: tuple[str, ...]  #: Axes that were turned, rates that are off, gaps.


def inspect(campaign: Campaign) -> Inspection:
    """Checks a campaign before anything is traced; refuses one of no use."""
    kept = _Kept(campaign)
    kept.drop(_find_copies(kept.campaign), least=0.0)
    faults = find_faults(kept.campaign)
    kept.masks.update(faults.masks)
    kept.excluded += faults.excluded
    check_clocks(kept.campaign, kept.masks)
    off_rates = check_rates(kept.campaign)
    kept.drop(_find_servoless(kept.campaign, kept.masks))
    kept.mask(functools.partial(find_hand, gravity=None), _HELD)
    kept.drop_short()
    kept.drop(_find_tail_first(kept.campaign, kept.masks))
    kept.campaign, warnings = check_frame(kept.campaign, kept.masks)
    kept.mask(functools.partial(find_hand, gravity=campaign.gravity), _HELD)
    kept.drop_short()
    kept.mask(find_rolled, _ROLLED)
    kept.drop_short(f": {_ROLLED}")
    # Until here poses counted, whatever the servo did.
    kept.mask(lambda flight, _: kept.masks[flight.name].beyond, _BEYOND)
    kept.drop_short(f" ({_BEYOND})")
    kept.drop(dict.fromkeys(find_unrelated(kept.campaign, kept.masks), _UNRELATED))
    for check in (check_fall, check_travel, check_tail):
        warnings += check(kept.campaign, kept.masks)
    names = sorted(flight.name for flight in kept.campaign.flights)
    return Inspection(
        campaign=kept.campaign,
        masks={name: kept.masks[name] for name in names},
        excluded=tuple(sorted(kept.excluded, key=lambda rows: rows.file)),
        warnings=warnings + off_rates + faults.warnings,
    )


class _Kept:
    """What is kept of a campaign, and what was excluded so far."""

    def __init__(self, campaign: Campaign) -> None:
        self.campaign = campaign
        self.masks: dict[str, Masks] = {}
        self.excluded: list[ExcludedRows] = []

    def drop(self, reasons: dict[str, str], least: float = _MIN_SHARE) -> None:
        """Excludes flights by name; refuses a campaign of which too few remain."""
        flights = self.campaign.flights
        kept = tuple(flight for flight in flights if flight.name not in reasons)
        if len(kept) < least * len(flights):
            name, why = next(iter(reasons.items()))
            raise InputError(
                f"{self.campaign.path}: {len(reasons)} of {len(flights)} flights "
                f"cannot be used, {name} for one: {why}."
            )
        self.campaign = dataclasses.replace(self.campaign, flights=kept)
        self.excluded += [ExcludedRows(n, ALL, why) for n, why in reasons.items()]

    def mask(self, find: Callable[[Flight, np.ndarray], np.ndarray], why: str) -> None:
        """Excludes the rows that `find` finds in each flight, given its usable ones."""
        for flight in self.campaign.flights:
            mask = self.masks[flight.name]
            found = find(flight, mask.usable) & mask.usable
            if found.any():
                both = dataclasses.replace(mask, pose=mask.pose | found)
                self.masks[flight.name] = both
                self.excluded.append(ExcludedRows(flight.name, name_rows(found), why))

    def drop_short(self, cause: str = "") -> None:
        """Excludes flights of which too few rows are kept, or too scattered ones."""
        reasons = {}
        for flight in self.campaign.flights:
            rows = np.flatnonzero(self.masks[flight.name].usable)
            time = flight.time[rows]
            fresh = ~find_repeats(flight.pose, 2)
            if len(time) < _MIN_ROWS or time[-1] - time[0] < _MIN_SPAN:
                reasons[flight.name] = (
                    f"only {len(time)} rows of it show a flight; expected at least "
                    f"{_MIN_ROWS} over {_MIN_SPAN} s{cause}"
                )
            elif len(rows) < _MIN_DENSITY * np.sum(fresh[rows[0] : rows[-1] + 1]):
                reasons[flight.name] = "most of its rows are faulty"
        self.drop(reasons)


def _find_copies(campaign: Campaign) -> dict[str, str]:
    """Flights whose poses are those of an earlier one, row by row, with the reason."""
    first: dict[bytes, str] = {}
    flights = campaign.flights
    pairs = [(f.name, first.setdefault(f.pose.tobytes(), f.name)) for f in flights]
    return {name: f"the same rows as {other}" for name, other in pairs if other != name}


def _find_servoless(campaign: Campaign, masks: dict[str, Masks]) -> dict[str, str]:
    """Flights whose elevator is faulty in most rows, with the reason."""
    usable = [(f.name, masks[f.name], masks[f.name].usable) for f in campaign.flights]
    shares = {n: np.mean(m.elevator[rows]) for n, m, rows in usable if rows.any()}
    return {
        name: f"{100 * share:.0f} % of the rows of its elevator are faulty"
        for name, share in shares.items()
        if share > _MAX_FAULTY
    }


def _find_tail_first(campaign: Campaign, masks: dict[str, Masks]) -> dict[str, str]:
    """Flights that go the other way, or tail first, unlike most others."""
    motions = {f.name: usable_motion(f, masks) for f in campaign.flights}
    motions = {name: m for name, m in motions.items() if len(m.time)}
    if not motions:
        return {}
    onward = {n: float(np.mean(m.velocity[:, 0])) >= 0.0 for n, m in motions.items()}
    ahead = {
        sign: {n: calc_heading(m, sign) >= 0.0 for n, m in motions.items()}
        for sign in (1, -1)
    }
    if all(len(set(g.values())) == 1 for g in (onward, *ahead.values())):
        return {}
    sign = fit_forces(join(list(motions.values()))).sign
    reasons: dict[str, str] = {}
    for group, why in ((ahead[sign], "tail first"), (onward, "the other way along x")):
        most = sum(group.values()) * 2 >= len(group)
        for name in (name for name, value in group.items() if value != most):
            reasons.setdefault(name, f"it flies {why}, unlike most flights")
    return reasons
