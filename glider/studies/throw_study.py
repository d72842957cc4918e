"""A closed loop of throws: propose one, fly it, weigh the rivals again."""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from glider.campaign.logs import Campaign, Flight
from glider.campaign.motion_capture import MotionCapture
from glider.errors import InputError
from glider.experiments.explanations import explain
from glider.experiments.findings import Findings
from glider.experiments.proposal import Proposal, propose, read_task
from glider.experiments.throws import Range, Throw, log_of, missed
from glider.physics.effects import KINDS
from glider.physics.model import GliderModel
from glider.sysid.fit.simulate import (
    CampaignPlan,
    layout_for,
    measured,
    simulate_campaign,
    theta_of,
)

RIVALS = ("servo_lag", "command_delay")
"""Effects that look alike while they are small."""

LATE = 0.002
"""By how much the hidden glider's servo is late [s]."""

ENOUGH = 0.95
"""Probability at which the loop ends."""

Progress = Callable[[str], None]


@dataclasses.dataclass(frozen=True, kw_only=True)
class ThrowStudy:
    """How rivals were told apart.

    Attributes:
        truth: effect of the hidden glider.
        given: flights at the start.
        probabilities: of each explanation, before the first throw and after each.
        proposals: of one throw each, in the order in which they were flown.
        flights: the logs of all flights, those given first.
    """

    truth: str
    given: int
    probabilities: tuple[dict[str, float], ...]
    proposals: tuple[Proposal, ...]
    flights: tuple[Flight, ...]

    @property
    def found(self) -> str:
        """The most probable explanation at the end."""
        last = self.probabilities[-1]
        return max(last, key=lambda name: last[name])

    def key_figures(self) -> dict[str, Any]:
        """Returns what came out, for a file."""
        return {
            "truth": self.truth,
            "found": self.found,
            "throws": len(self.proposals),
            "probabilities": list(self.probabilities),
            "promised": [p.chance_then for p in self.proposals],
        }

    def describe(self) -> str:
        """Returns what came out, a line for each throw."""
        lines = [f"{self.given} flights: {_told(self.probabilities[0])}"]
        for proposal, after in zip(self.proposals, self.probabilities[1:], strict=True):
            lines.append(
                f"one throw more, promised {proposal.chance_then:.2f}: {_told(after)}"
            )
        lines.append(f"the hidden effect was {self.truth}")
        return "\n".join(lines)


def _told(probabilities: dict[str, float]) -> str:
    return ", ".join(f"{name} {p:.2f}" for name, p in probabilities.items())


def tell_rivals_apart(
    truth: str,
    *,
    given: int = 4,
    most: int = 6,
    seed: int = 0,
    progress: Progress = lambda text: None,
) -> ThrowStudy:
    """Flies throws that are proposed until one of RIVALS has probability ENOUGH.

    Args:
        truth: of RIVALS, the hidden glider's.
        given: random flights at the start.
        most: throws at most.
        seed: of all that is random.
        progress: called with a line of text as the work goes on.

    Raises:
        InputError: the truth is none of RIVALS.
    """
    if truth not in RIVALS:
        raise InputError(f"'{truth}' is given; one of {', '.join(RIVALS)} is needed.")
    rng = np.random.default_rng(seed)
    [coefficient] = KINDS[truth].coefficients
    hidden = GliderModel(effects=(KINDS[truth](**{coefficient.name: LATE}),))
    campaign = simulate_campaign(hidden, CampaignPlan(flights=given), rng)
    guess = GliderModel(effects=(KINDS[RIVALS[0]](time_constant=LATE),))
    findings = Findings(
        model=guess, kinds=RIVALS[:1], rivals={RIVALS[0]: RIVALS[1:]}, combinations=()
    )
    probabilities: list[dict[str, float]] = []
    proposals: list[Proposal] = []
    with threadpool_limits(limits=1, user_api="blas"):
        while True:
            progress(f"weighing {len(campaign.flights)} flights")
            known, task, noise = read_task(campaign, findings)
            explanations = explain(task, noise, findings)
            probabilities.append({e.name: e.probability for e in explanations})
            if explanations[0].probability >= ENOUGH or len(proposals) == most:
                break
            proposal = propose(
                known,
                task,
                noise,
                explanations,
                launches=1,
                seed=seed,
                progress=progress,
            )
            proposals.append(proposal)
            flight = fly_throw(hidden, proposal.throws[0], proposal.place, rng)
            campaign = _with_flight(campaign, flight)
    return ThrowStudy(
        truth=truth,
        given=given,
        probabilities=tuple(probabilities),
        proposals=tuple(proposals),
        flights=campaign.flights,
    )


def fly_throw(
    model: GliderModel, throw: Throw, place: Range, rng: np.random.Generator
) -> Flight:
    """Returns the log of a throw by a glider, its launch missed as hands miss it."""
    thrown = missed(throw, place.limits, rng)
    flight = log_of(
        thrown, place, layout_for(model), theta_of(model), model.residual_field
    )
    return measured(flight, MotionCapture(rate=place.pose_rate), rng)


def _with_flight(campaign: Campaign, flight: Flight) -> Campaign:
    name = f"flight_{len(campaign.flights):03d}.csv"
    named = dataclasses.replace(flight, name=name)
    return dataclasses.replace(campaign, flights=(*campaign.flights, named))
