"""Plans with one glider and flies another: what a model is worth in the air."""

import dataclasses

import numpy as np

from diagrams.loops import closed_loop
from diagrams.simulate import simulate_flights
from diagrams.wiring import tape_rows
from glider.campaign.logs import Campaign, campaign_of
from glider.campaign.motion_capture import MotionCapture
from glider.control.tvlqr_drake import tracking_regulator
from glider.physics.model import GliderModel
from glider.planning.dircol import Progress, plan
from glider.planning.plan import Plan
from glider.planning.problem import PerchingProblem
from glider.report.wording import headline
from glider.simulation.flown_flights import Perches
from glider.simulation.fly import AFTER
from glider.simulation.monte_carlo import LaunchSpread, draw_launches
from glider.sysid.pipeline import close_the_loop
from glider.sysid.result import Result

COMMAND_RATE = 50.0
"""Rate of the feedback's commands, held between [Hz]."""

CAPTURE = MotionCapture()
"""Motion capture that films the flights."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Rehearsal:
    """Flights of a glider under the plan and the feedback of a model."""

    plan: Plan
    """Plan made with the model, as is the feedback."""

    flights: Perches
    """Flights of the true glider."""

    campaign: Campaign
    """Logs of the flights, as motion capture has them."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Correction:
    """Worth of closing the loop: rehearsals before and after."""

    truth: GliderModel
    """Glider that flies."""

    before: Rehearsal
    """Rehearsal with its nominal model."""

    found: Result
    """Findings in the logs of those flights."""

    after: Rehearsal
    """Rehearsal with the model that was found."""

    def key_figures(self) -> dict[str, object]:
        """Returns effects, misses and successes, for a file."""
        return {
            "effect_true": name_effects(self.truth),
            "effect_found": [effect.kind for effect in self.found.effects],
            "before": self.before.flights.key_figures(),
            "after": self.after.flights.key_figures(),
            "launches": len(self.before.flights),
        }

    def describe(self) -> str:
        """Returns what was found, and how launches ended before and after."""
        return (
            f"{headline(self.found)}\n"
            f"planned nominal: {self.before.flights.describe()}\n"
            f"planned corrected: {self.after.flights.describe()}"
        )


def name_effects(model: GliderModel) -> str:
    """Returns the kinds of a model's effects, its field among them, or "nothing"."""
    kinds = [effect.kind.kind for effect in model.effects]
    kinds += [] if model.field is None else [model.field.kind]
    return " + ".join(kinds) or "nothing"


def rehearse(
    truth: GliderModel,
    model: GliderModel,
    problem: PerchingProblem,
    starts: np.ndarray,
    rng: np.random.Generator,
    progress: Progress | None = None,
) -> Rehearsal:
    """Plans and makes the feedback with a model, and flies the truth with both.

    The feedback gets the rigid body's states as they are and runs the model's own
    effect states beside; it commands at COMMAND_RATE. Motion capture adds noise.

    Args:
        truth: the glider that flies.
        model: what is believed of it.
        problem: what to fly.
        starts: (B, 7) launch states.
        rng: draws the noise of motion capture.
        progress: told what is being done.

    Raises:
        PlanningError: where the model cannot do what the problem asks.
    """
    say = progress or (lambda text: None)
    planned = plan(model, problem, progress=lambda text: say(f"plan: {text}"))
    say("feedback along the plan")
    regulator = tracking_regulator(model, planned)
    diagram = closed_loop(
        truth,
        regulator,
        planned=model,
        command_rate=COMMAND_RATE,
        motion_capture=CAPTURE.rate,
    )
    flights = simulate_flights(
        diagram,
        starts,
        planned.duration + AFTER,
        problem=problem,
        capture_noise=CAPTURE.draw(rng, len(starts), tape_rows(CAPTURE.rate)),
        progress=lambda text: say(f"fly: {text}"),
    )
    logs = [flight.log for flight in flights if flight.log is not None]
    campaign = campaign_of(
        "rehearsal", truth.parameters, logs, CAPTURE.rate, COMMAND_RATE
    )
    return Rehearsal(plan=planned, flights=flights, campaign=campaign)


def trace_model(
    truth: GliderModel,
    flights: int,
    rng: np.random.Generator,
    progress: Progress | None = None,
) -> Result:
    """Returns what the logs of perches planned with the nominal model tell of a glider.

    Args:
        truth: the glider that flies.
        flights: how many.
        rng: of the launches and of the noise of motion capture.
        progress: told what is being done.
    """
    problem, nominal = PerchingProblem(), GliderModel(parameters=truth.parameters)
    starts = draw_launches(problem, LaunchSpread(), flights, rng)
    flown = rehearse(truth, nominal, problem, starts, rng, progress)
    return close_the_loop(flown.campaign, progress=progress or (lambda text: None))
