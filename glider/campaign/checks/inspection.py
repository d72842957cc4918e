"""All checks of a campaign in their order: what is left, turned, set aside and told."""

import dataclasses
from collections.abc import Callable

import numpy as np

from glider.campaign.checks.clocks import check_clocks, find_strangers
from glider.campaign.checks.frame import (
    calc_heading,
    check_frame,
    fit_forces,
    join,
    usable_motion,
)
from glider.campaign.checks.masks import ALL, ExcludedRows, Masks, name_rows
from glider.campaign.checks.planarity import find_rolled
from glider.campaign.checks.rates import check_rates
from glider.campaign.checks.rows import find_faults
from glider.campaign.checks.standing import find_hand
from glider.campaign.logs import Campaign, Flight
from glider.errors import InputError
from glider.physics.parameters import GliderParameters

_MIN_ROWS = 20  # Usable rows of a flight, as the reader asks for.
_MIN_SPAN = 0.15  # Time that they span [s].
_MAX_FAULTY = 0.6  # Share of the rows of an elevator: the rest is no better.
_ROLLED = "by roll and yaw its wing is more than half out of the plane of flight"
_HELD = "a hand still pushes the glider"
_STRANGER = "its elevator does not follow its commands, unlike in most flights"
_MIN_DENSITY = 0.5  # Share of usable rows between the first and the last of a flight.
_MIN_SHARE = 0.5  # Of flights that must be left: else the campaign is at fault.


@dataclasses.dataclass(frozen=True, kw_only=True)
class Inspection:
    """A campaign after all checks: flights that fly, and rows that count."""

    campaign: Campaign  # Axes turned where they were; flights set aside left out.
    masks: dict[str, Masks]  # Of the flights that are left, by name.
    set_aside: tuple[ExcludedRows, ...]  # Rows and whole flights, by file.
    warnings: tuple[str, ...]  # What was turned, and gaps.


def inspect(campaign: Campaign) -> Inspection:
    """Checks a campaign before anything is traced in it.

    Raises:
        InputError: it cannot be used; one sentence says why.
    """

    def thrown(flight: Flight, usable: np.ndarray) -> np.ndarray:
        return find_hand(flight, usable, None)

    campaign, told = _drop_copies(campaign)
    faults = find_faults(campaign)
    masks = dict(faults.masks)
    told += faults.set_aside
    check_clocks(campaign, masks)
    off_rates = check_rates(campaign)
    campaign, torn = _drop_servoless(campaign, masks)
    told += torn
    told += _mask(campaign, masks, thrown, _HELD)
    campaign, short = _drop_short(campaign, masks)
    told += short
    campaign, odd = _drop_tail_first(campaign, masks)
    told += odd
    campaign, warnings = check_frame(campaign, masks)
    gravity = campaign.vehicle.get("gravity", GliderParameters().gravity)

    def held(flight: Flight, usable: np.ndarray) -> np.ndarray:
        return find_hand(flight, usable, gravity)

    told += _mask(campaign, masks, held, _HELD)
    campaign, short = _drop_short(campaign, masks)
    told += short
    told += _mask(campaign, masks, find_rolled, _ROLLED)
    campaign, short = _drop_short(campaign, masks, _ROLLED)
    told += short
    odd_clocks = dict.fromkeys(find_strangers(campaign, masks), _STRANGER)
    campaign, odd = _drop(campaign, odd_clocks)
    names = {f.name for f in campaign.flights}
    return Inspection(
        campaign=campaign,
        masks={name: masks[name] for name in sorted(names)},
        set_aside=tuple(sorted(told + odd, key=lambda s: s.file)),
        warnings=warnings + off_rates + faults.warnings,
    )


def _drop_copies(campaign: Campaign) -> tuple[Campaign, tuple[ExcludedRows, ...]]:
    """Sets aside flights whose poses are those of an earlier one, row by row."""
    seen: dict[bytes, str] = {}
    reasons = {}
    for flight in campaign.flights:
        earlier = seen.setdefault(flight.pose.tobytes(), flight.name)
        if earlier != flight.name:
            reasons[flight.name] = f"the same rows as {earlier}"
    return _drop(campaign, reasons, least=0.0)


def _drop_servoless(
    campaign: Campaign, masks: dict[str, Masks]
) -> tuple[Campaign, tuple[ExcludedRows, ...]]:
    """Sets aside flights whose elevator is faulty in most rows."""
    shares = {
        f.name: float(np.mean(masks[f.name].elevator[masks[f.name].usable]))
        for f in campaign.flights
        if masks[f.name].usable.any()
    }
    reasons = {
        name: f"{100 * share:.0f} % of the rows of its elevator are faulty"
        for name, share in shares.items()
        if share > _MAX_FAULTY
    }
    return _drop(campaign, reasons)


def _drop_short(
    campaign: Campaign, masks: dict[str, Masks], cause: str = ""
) -> tuple[Campaign, tuple[ExcludedRows, ...]]:
    """Sets aside flights of which too few rows are left, or too few here and there.

    Args:
        campaign: of the flights.
        masks: of their rows.
        cause: why rows were just set aside.
    """
    because = f": {cause}" if cause else ""
    reasons = {}
    for flight in campaign.flights:
        rows = np.flatnonzero(masks[flight.name].usable)
        time = flight.time[rows]
        if len(time) < _MIN_ROWS or time[-1] - time[0] < _MIN_SPAN:
            reasons[flight.name] = (
                f"only {len(time)} rows of it show a flight; at least {_MIN_ROWS} "
                f"over {_MIN_SPAN} s are needed{because}"
            )
        elif len(rows) < _MIN_DENSITY * (rows[-1] - rows[0] + 1):
            reasons[flight.name] = "most of its rows are faulty"
    return _drop(campaign, reasons)


def _drop_tail_first(
    campaign: Campaign, masks: dict[str, Masks]
) -> tuple[Campaign, tuple[ExcludedRows, ...]]:
    """Sets aside flights that go the other way, or tail first, unlike most others."""
    motions = {f.name: usable_motion(f, masks) for f in campaign.flights}
    motions = {name: m for name, m in motions.items() if len(m.time)}
    if not motions:
        return campaign, ()
    onward = {n: float(np.mean(m.velocity[:, 0])) >= 0.0 for n, m in motions.items()}
    either = [
        {n: calc_heading(m, sign) >= 0.0 for n, m in motions.items()}
        for sign in (1, -1)
    ]
    if all(len(set(group.values())) == 1 for group in (onward, *either)):
        return campaign, ()
    sign = fit_forces(join(list(motions.values()))).sign
    ahead = either[0] if sign == 1 else either[1]
    reasons: dict[str, str] = {}
    for group, why in ((ahead, "tail first"), (onward, "the other way along x")):
        most = sum(group.values()) * 2 >= len(group)
        for name, value in group.items():
            if value != most:
                reasons.setdefault(name, f"it flies {why}, unlike most flights")
    return _drop(campaign, reasons)


def _drop(
    campaign: Campaign, reasons: dict[str, str], least: float = _MIN_SHARE
) -> tuple[Campaign, tuple[ExcludedRows, ...]]:
    """Returns the campaign without the flights that have a reason to be set aside."""
    kept = tuple(f for f in campaign.flights if f.name not in reasons)
    if len(kept) < least * len(campaign.flights):
        name, why = next(iter(reasons.items()))
        raise InputError(
            f"{campaign.path}: {len(reasons)} of {len(campaign.flights)} flights "
            f"cannot be used, {name} for one: {why}."
        )
    told = tuple(ExcludedRows(file=n, rows=ALL, why=why) for n, why in reasons.items())
    return dataclasses.replace(campaign, flights=kept), told


def _mask(
    campaign: Campaign,
    masks: dict[str, Masks],
    find: Callable[[Flight, np.ndarray], np.ndarray],
    why: str,
) -> tuple[ExcludedRows, ...]:
    """Sets aside what `find` finds in each flight, in its masks too."""
    told = []
    for flight in campaign.flights:
        mask = masks[flight.name]
        found = find(flight, mask.usable) & mask.usable
        if found.any():
            masks[flight.name] = dataclasses.replace(mask, pose=mask.pose | found)
            told.append(ExcludedRows(file=flight.name, rows=name_rows(found), why=why))
    return tuple(told)
