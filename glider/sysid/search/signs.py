"""Is an angle logged with the other sign? The first question to a new log."""

import dataclasses
import math
from collections.abc import Mapping, Sequence

from glider.campaign.logs import (
    Campaign,
    Flight,
)
from glider.sysid.checks.masks import Masks
from glider.sysid.likelihood.model_fit import fit_model, start_of
from glider.sysid.likelihood.scales import Scales
from glider.sysid.likelihood.task import make_task
from glider.sysid.replay.noise import measure_noise
from glider.sysid.replay.record import prepare
from glider.sysid.replay.signs import Signs, turn
from glider.sysid.replay.vehicle import Vehicle

LEAST_GAIN = 20.0
"""Log-likelihood for each flight by which other signs must be better [nats]: a wrong
sign turns forces round."""

ROUGHLY = Scales(
    position=0.01, pitch=0.02, elevator=0.05, air=0.3, moment=5.0, servo=0.02
)
"""Scales under which signs are compared: whatever else is wrong may not cost much."""

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
    campaign: Campaign,
    flights: Sequence[Flight],
    masks: Mapping[str, Masks],
    vehicle: Vehicle,
) -> Signs:
    """Compares the ways in which the angles may have been logged.

    A wrong sign turns forces round: no small effect of the library comes near.
    So the best set of signs must beat the logged one by `LEAST_GAIN`, each with
    `COMPANIONS` fitted.
    """
    few = tuple(flights[:FLIGHTS])
    options = _WITH_SERVO if campaign.elevator == "servo" else ((-1, 1, 1),)
    logged = _cost(campaign, few, masks, vehicle, Signs())
    best, lowest = Signs(), logged
    for pitch, elevator, command in options:
        signs = Signs(pitch=pitch, elevator=elevator, command=command)
        cost = _cost(campaign, few, masks, vehicle, signs)
        if cost < lowest:
            best, lowest = signs, cost
    rows = 4 * sum(len(f.time) for f in few)
    if best.are_right or logged - lowest < LEAST_GAIN * len(few):
        return Signs()
    return dataclasses.replace(
        best,
        evidence=float(logged - lowest),
        share=float(1.0 - math.exp(-2.0 * (logged - lowest) / rows)),
    )


def _cost(
    campaign: Campaign,
    flights: tuple[Flight, ...],
    masks: Mapping[str, Masks],
    vehicle: Vehicle,
    signs: Signs,
) -> float:
    """Returns the negative log-likelihood under some signs [nats]."""
    turned = tuple(turn(f, signs) for f in flights)
    # Its noise depends on the signs.
    noise = measure_noise(dataclasses.replace(campaign, flights=turned), masks)
    records = prepare(turned, campaign, noise, vehicle.layout, masks)
    task = make_task(records, vehicle, vehicle.kinds)
    model = start_of(task, noise, with_curves=False)
    kinds = tuple(kind for kind in COMPANIONS if kind in vehicle.kinds)
    model = dataclasses.replace(
        model, kinds=kinds, free=task.free(kinds), scales=ROUGHLY
    )
    return fit_model(task, model, iterations=2, free_scales=()).cost
