"""Tasks of a fit from campaigns, as the pipeline makes them."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from glider.campaign.logs import Campaign
from glider.physics.effects import KINDS, Effect
from glider.physics.model import GliderModel
from glider.sysid.fit.simulate import CampaignPlan, simulate_campaign
from glider.sysid.likelihood.model_fit import Fitted, fit_model, start_of
from glider.sysid.likelihood.task import Task, make_task
from glider.sysid.replay.noise import Noise, measure_noise
from glider.sysid.replay.record import prepare
from glider.sysid.replay.theta import LIBRARY_LAYOUT, Layout
from glider.sysid.replay.vehicle import make_vehicle


def fly(*effects, seed: int = 0, **plan) -> Campaign:
    """Returns a campaign of a glider with undeclared effects, in still air."""
    model = GliderModel(effects=effects)
    return simulate_campaign(model, CampaignPlan(**plan), np.random.default_rng(seed))


def task_of(
    campaign: Campaign, layout: Layout = LIBRARY_LAYOUT, masks=None
) -> tuple[Task, Noise]:
    """Returns the task of a campaign with all kinds, and the noise of its channels."""
    vehicle, noise = make_vehicle(campaign, layout), measure_noise(campaign, masks)
    records = prepare(campaign.flights, campaign, noise, layout, masks)
    return make_task(records, vehicle, vehicle.kinds), noise


def begin(task: Task, noise: Noise, kinds: Sequence[str] = ()) -> Fitted:
    """Returns where a fit of kinds starts: at rest, shapes at their first guess."""
    start = start_of(task, noise, with_curves=False)
    theta = start.theta.copy()
    for kind in kinds:
        coefficients = task.layout.kinds[kind].coefficients
        for slot, c in zip(task.layout.slots_of(kind), coefficients, strict=True):
            theta[slot] = c.grid[0] if c.is_shape else c.default
    kinds = tuple(kinds)
    return dataclasses.replace(start, theta=theta, kinds=kinds, free=task.free(kinds))


def fit_kinds(campaign: Campaign, *kinds: str, masks=None) -> tuple[Task, Fitted]:
    """Fits kinds of the library to a campaign."""
    task, noise = task_of(campaign, masks=masks)
    return task, fit_model(task, begin(task, noise, kinds))


def typical(kind: str, size: float = 1.0) -> Effect:
    """Returns an effect of the library, its coefficients in their scales."""
    values = {
        c.name: c.default if c.is_shape and c.default else size * c.scale
        for c in KINDS[kind].coefficients
    }
    return KINDS[kind](**values)
