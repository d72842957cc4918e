"""Four flights of a glider whose servo is a little late: by a lag, or by a delay?"""

import dataclasses
import functools

import numpy as np
import pytest

from glider.campaign.logs import Campaign, ServoLog
from glider.experiments import throw_search
from glider.experiments.explanations import Explanation, Findings, explain
from glider.experiments.proposal import Proposal, propose, read_task
from glider.experiments.throws import Throw
from glider.physics.effects import KINDS
from glider.physics.model import GliderModel
from glider.physics.state import ELEVATOR
from glider.simulation.campaigns import CampaignPlan
from glider.sysid.likelihood.task import Task
from glider.sysid.replay.record import Noise, Record

LATE = GliderModel(effects=(KINDS["servo_lag"](time_constant=0.002),))
DELAYED = GliderModel(effects=(KINDS["command_delay"](delay=0.002),))

Posterior = tuple[Campaign, Task, Noise, tuple[Explanation, ...]]


@functools.cache
def late_posterior() -> Posterior:
    """Returns campaign, task, noise and explanations."""
    rng = np.random.default_rng(1)
    campaign = CampaignPlan(flights=4).simulate(LATE, rng)
    clocks = ServoLog(clock_std=0.0, command_std=0.0)  # Else 2 ms may be theirs.
    campaign = dataclasses.replace(campaign, servo=clocks)
    findings = Findings(models=(LATE, DELAYED))
    campaign, _, task, noise = read_task(campaign, findings)
    return campaign, task, noise, explain(task, noise, findings)


def flown_throw(record: Record) -> Throw:
    """Returns a flown flight as a throw, from its smoothed log."""
    nodes = record.nodes[0]
    return Throw(
        launch=np.append(nodes[:ELEVATOR], [record.rest, *nodes[4:7]]),
        times=record.switch_times,
        commands=record.commands,
        duration=float(record.time[-1]),
    )


@functools.cache
def late_proposal() -> Proposal:
    """Returns two throws that are proposed for them, after half a search."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(throw_search, "_ROUNDS", throw_search._ROUNDS // 2)
        return propose(*late_posterior(), traced=LATE, launches=2)
