"""Angles that are logged with the other sign, found before anything else."""

import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence

import numpy as np

from glider.campaign.checks.masks import Masks
from glider.campaign.logs import Campaign, Flight
from glider.campaign.turning import Signs, turn
from glider.physics.effects import ANGLE_SIGN
from glider.sysid.constants import CLEAR, FEW_FLIGHTS
from glider.sysid.likelihood.model_fit import error_flights, fit_model, grams_of
from glider.sysid.likelihood.outliers import COARSE_SCALES
from glider.sysid.likelihood.task import Task, start_of
from glider.sysid.replay.record import measure_noise, prepare
from glider.sysid.replay.vehicle import Vehicle


def find_signs(
    campaign: Campaign,
    flights: Sequence[Flight],
    masks: Mapping[str, Masks],
    vehicle: Vehicle,
) -> Signs:
    """Compares the ways in which the angles may have been logged.

    A wrong sign turns forces round, as no small effect does: the best set of signs must
    beat the logged one by `CLEAR` in the median flight, with effects fitted that look
    like a wrong sign. It cannot gain more than ½ Σ e² of the logged one: a small
    residual ends the search.

    Args:
        campaign: as it was logged.
        flights: of the campaign; the first few are compared.
        masks: excluded rows by a flight's name.
        vehicle: of the campaign.

    Returns:
        the signs by which the logs are turned, with their evidence [nats] and the share
        of the squared residual that they explain; the logged ones have neither.
    """
    few = flights[:FEW_FLIGHTS]
    library = vehicle.space.kinds
    kinds = tuple(k for k in vehicle.kinds if ANGLE_SIGN.kind in library[k].like)

    def costs(signs: Signs) -> np.ndarray:
        """Half the square of each flight's whitened errors under some signs [nats]."""
        turned = tuple(turn(flight, signs) for flight in few)
        # The noise depends on the signs, too.
        noise = measure_noise(dataclasses.replace(campaign, flights=turned), masks)
        records = prepare(turned, campaign, noise, vehicle.space, masks)
        task = Task(records=records, vehicle=vehicle, kinds=vehicle.kinds, functions={})
        model = dataclasses.replace(
            start_of(task, noise),
            kinds=kinds,
            free=task.free(kinds),
            scales=COARSE_SCALES,
        )
        fitted = fit_model(task, model, iterations=2, free_scales=())
        return 0.5 * grams_of(error_flights(task, fitted), COARSE_SCALES).ravel()

    logged = costs(Signs())
    best = Signs()
    most = CLEAR
    if np.median(logged) < most:
        return best

    angles = ["pitch"]
    if campaign.elevator == "servo":
        angles += ["elevator", "command"]
    for option in itertools.product((1, -1), repeat=len(angles)):
        signs = Signs(**dict(zip(angles, option, strict=True)))
        if signs.are_right:
            continue
        gain = float(np.median(logged - costs(signs)))
        if gain >= most:
            best = signs
            most = gain

    if best.are_right:
        return best

    # A gain of n/2 ln(1 / (1 - R²)) in n numbers, four in each row, is a share of R².
    numbers = 4 * np.mean([len(flight.time) for flight in few])
    share = float(1.0 - math.exp(-2.0 * most / numbers))
    return dataclasses.replace(best, evidence=most * len(few), share=share)
