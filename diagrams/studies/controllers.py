"""Three controllers over the same launches: TVLQR, MPPI and MPC by collocation."""

import dataclasses

import numpy as np

from diagrams.loops import closed_loop
from diagrams.loops import estimated_loop
from diagrams.simulate import simulate_flights
from diagrams.studies.rehearsal import COMMAND_RATE
from diagrams.wiring import tape_rows
from glider.control.mpc import ModelPredictiveController, ReplanResult
from glider.control.mppi import MppiController, replanning_cost, sequence_of
from glider.control.tvlqr_drake import tracking_regulator
from glider.estimation.perching import CAPTURE, LAUNCH_STD, perching_ekf
from glider.estimation.running import make_prior
from glider.paths import models_path
from glider.physics.model import GliderModel
from glider.planning.dircol import Progress, plan
from glider.planning.problem import PerchingProblem, load_problem
from glider.simulation.flown_flights import Perches

AFTER = 0.2
"""Time that a flight goes on after the plan's end [s]: who plans anew may come later
than the plan."""

CONTROLLERS = ("TVLQR", "MPPI", "MPC")
"""Names of the controllers."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Race:
    """The same launches of one glider under each controller."""

    flights: dict[str, Perches]
    """Flights by the controller's name."""

    seconds: np.ndarray
    """Times that planning anew by collocation took [s]."""

    failures: int
    """How many of these plans failed."""


def race(
    truth: GliderModel,
    model: GliderModel,
    problem: PerchingProblem,
    starts: np.ndarray,
    *,
    seed: int = 0,
    unsure: float | None = None,
    progress: Progress | None = None,
) -> Race:
    """Flies launches of a glider under three controllers made with a model of it.

    All command at COMMAND_RATE, from the states as they are or from what a filter with
    that model makes of motion capture; who plans anew does so with the goal and the
    weights of models/problems/replanning.yaml.

    Args:
        truth: the glider that flies.
        model: what is believed of it.
        problem: of the plan that TVLQR follows and MPPI starts from.
        starts: (B, 7) launch states.
        seed: of MPPI and of motion capture's noise, which is the same for each
            controller.
        unsure: how many times LAUNCH_STD the filter believes a launch to err; None
            for no filter.
        progress: told what is being done.

    Raises:
        PlanningError: where the model cannot do what the problem asks.
    """
    say = progress or (lambda text: None)
    planned = plan(model, problem, progress=lambda text: say(f"plan: {text}"))
    replanning = load_problem(models_path("problems", "replanning.yaml"))
    cost = replanning_cost(model, replanning, COMMAND_RATE)
    sequence = sequence_of(planned, cost.step, cost.steps)
    noise = None
    if unsure is not None:
        ekf = perching_ekf(model)
        prior = make_prior(ekf, planned.states[0], unsure * np.array(LAUNCH_STD))
        rng = np.random.default_rng(seed)
        noise = CAPTURE.draw(rng, len(starts), tape_rows(CAPTURE.rate))
    made: list[ReplanResult] = []
    mpc = ModelPredictiveController(model, replanning, COMMAND_RATE, made.append)
    systems = {
        "TVLQR": (tracking_regulator(model, planned), COMMAND_RATE),
        "MPPI": (MppiController(cost, sequence, seed=seed), None),
        "MPC": (mpc, None),
    }
    flights = {}
    for name, (system, rate) in systems.items():
        say(f"fly by {name}")
        if unsure is None:
            loop = closed_loop(truth, system, planned=model, command_rate=rate)
        else:
            loop = estimated_loop(truth, system, ekf, prior, command_rate=rate)
        flights[name] = simulate_flights(
            loop,
            starts,
            planned.duration + AFTER,
            problem=problem,
            capture_noise=noise,
            progress=progress,
        )
    return Race(
        flights=flights,
        seconds=np.array([again.seconds for again in made]),
        failures=sum(again.failed for again in made),
    )
