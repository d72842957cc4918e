"""Tasks of a fit from campaigns, as the pipeline makes them."""

import numpy as np

from glider.campaign.logs import Campaign
from glider.physics.effects import KINDS, Effect
from glider.physics.model import GliderModel
from glider.simulation.campaigns import CampaignPlan
from glider.sysid.likelihood.model_fit import fit_model
from glider.sysid.likelihood.task import FitResult, Task
from tests.helpers.known_truth import begin, task_of


def fly(*effects, seed: int = 0, **plan) -> Campaign:
    """Returns a campaign of a glider with undeclared effects, in still air."""
    model = GliderModel(effects=effects)
    return CampaignPlan(**plan).simulate(model, np.random.default_rng(seed))


def fit_kinds(campaign: Campaign, *kinds: str, masks=None) -> tuple[Task, FitResult]:
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
