"""Flights that reach a stall, after many that do not."""

import dataclasses
from unittest import mock

import numpy as np

from glider.campaign.logs import Campaign
from glider.physics.effects import KINDS
from glider.physics.model import GliderModel
from glider.simulation import campaigns
from glider.simulation.campaigns import CampaignPlan, random_commands

STALLING = GliderModel(
    effects=(KINDS["attached_lift"](slope=3.0, stall_angle=0.26, fade=0.05),)
)

_FAST = (-3.5, 0.1, 0.0, 0.0, 8.0, 0.0, 0.0)
_ALIKE = (0.05, 0.12, 0.03, 0.0, 0.15, 0.1, 0.1)


def shallow_and_deep(shallow: int, deep: int) -> Campaign:
    """Returns fast flights with little elevator, then slower ones with all of it."""

    def gentle(*args):
        return 0.15 * random_commands(*args)

    calm = CampaignPlan(flights=shallow, launch=_FAST, launch_spread=_ALIKE)
    with mock.patch.object(campaigns, "random_commands", gentle):
        campaign = calm.simulate(STALLING, np.random.default_rng(1))
    rest = CampaignPlan(flights=deep).simulate(STALLING, np.random.default_rng(2))
    flights = [
        dataclasses.replace(flight, name=f"flight_{i:03d}.csv")
        for i, flight in enumerate([*campaign.flights, *rest.flights])
    ]
    return dataclasses.replace(campaign, flights=tuple(flights))
