"""Is an angle logged with the other sign? The first question to a new log."""

import dataclasses
from collections.abc import Sequence

from glider.campaign.logs import (
    Campaign,
    Flight,
)
from glider.sysid.fit.output_error import fit
from glider.sysid.replay.noise import (
    Noise,
    measure_noise,
)
from glider.sysid.replay.problem import Problem
from glider.sysid.replay.record import prepare
from glider.sysid.replay.signs import Signs, turn
from glider.sysid.replay.vehicle import Vehicle

COST_RATIO = 5.0
"""Ratio of the logged signs' error to the best ones' from which on a sign is wrong."""

FLIGHTS = 6
"""Number of flights to ask; a wrong sign shows in any."""

COMPANIONS = ("profile_drag", "pitch_offset")
"""Effects that are fitted under any signs: what nearly every glider has, lest their
absence look like a wrong sign."""

_WITH_SERVO = (
    (-1, 1, 1),
    (1, -1, -1),
    (-1, -1, -1),
    (1, -1, 1),
    (1, 1, -1),
    (-1, -1, 1),
    (-1, 1, -1),
)


def find_signs(
    campaign: Campaign, flights: Sequence[Flight], noise: Noise, vehicle: Vehicle
) -> Signs:
    """Compares the ways in which the angles may have been logged.

    A wrong sign turns forces round: no small effect of the library comes near.
    So the best set of signs must beat the logged one by `COST_RATIO`, each with
    `COMPANIONS` fitted.
    """
    few = tuple(flights[:FLIGHTS])
    options = _WITH_SERVO if campaign.elevator == "servo" else ((-1, 1, 1),)
    logged = _cost(campaign, few, noise, vehicle, Signs())
    best, lowest = Signs(), logged
    for pitch, elevator, command in options:
        signs = Signs(pitch=pitch, elevator=elevator, command=command)
        error = _cost(campaign, few, noise, vehicle, signs)
        if error < lowest:
            best, lowest = signs, error
    if best.are_right or lowest * COST_RATIO > logged:
        return Signs()
    rows = sum(4 * len(f.time) for f in few)
    return dataclasses.replace(
        best,
        evidence=float(0.5 * (logged - lowest) / max(lowest / rows, 1.0)),
        share=float(1.0 - lowest / logged),
    )


def _cost(
    campaign: Campaign,
    flights: tuple[Flight, ...],
    noise: Noise,
    vehicle: Vehicle,
    signs: Signs,
) -> float:
    turned = tuple(turn(f, signs) for f in flights)
    if campaign.elevator == "servo":  # Its noise depends on the signs.
        noise = measure_noise(dataclasses.replace(campaign, flights=turned))
    records = prepare(turned, campaign, noise, vehicle.layout)
    problem = Problem(records=records, noise=noise, trim_is_known=vehicle.trim_is_known)
    companions = [i for kind in COMPANIONS for i in vehicle.layout.slots_of(kind)]
    free = tuple(sorted({*vehicle.nuisance, *companions}))
    return fit(problem, vehicle.theta, free, iterations=8).cost
