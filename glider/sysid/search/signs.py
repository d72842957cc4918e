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
    """
    few = flights[:FEW_FLIGHTS]
    library = vehicle.space.kinds
    kinds = tuple(k for k in vehicle.kinds if ANGLE_SIGN.kind in library[k].like)

    def costs(signs: Signs) -> np.ndarray:
        """Half the squares of the flights' errors under some signs, whitened [nats]."""
        turned = tuple(turn(f, signs) for f in few)
        # Its noise depends on the signs.
        noise = measure_noise(dataclasses.replace(campaign, flights=turned), masks)
        records = prepare(turned, campaign, noise, vehicle.space, masks)
        task = Task(records=records, vehicle=vehicle, kinds=vehicle.kinds, functions={})
        model = start_of(task, noise)
        model = dataclasses.replace(
            model, kinds=kinds, free=task.free(kinds), scales=COARSE_SCALES
        )
        fitted = fit_model(task, model, iterations=2, free_scales=())
        return 0.5 * grams_of(error_flights(task, fitted), COARSE_SCALES).ravel()

    logged = costs(Signs())
    best = Signs()
    most = CLEAR
    if np.median(logged) < CLEAR:
        return best
    angles = 3 if campaign.elevator == "servo" else 1
    names = ("pitch", "elevator", "command")[:angles]
    for option in itertools.product((1, -1), repeat=angles):
        signs = Signs(**dict(zip(names, option, strict=True)))
        gain = 0.0 if signs.are_right else float(np.median(logged - costs(signs)))
        if gain >= most:
            best = signs
            most = gain

    if best.are_right:
        return best
    rows = 4 * np.mean([len(f.time) for f in few])
    share = float(1.0 - math.exp(-2.0 * most / rows))
    return dataclasses.replace(best, evidence=most * len(few), share=share)
