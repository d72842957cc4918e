"""What a station flies: a plan, and the autopilot that follows it."""

import dataclasses
from pathlib import Path

import numpy as np
from pydrake.systems.framework import Diagram, System

from diagrams.programs.station.autopilot import make_autopilot
from diagrams.programs.station.proposed import TapePlayer, tape_plan
from diagrams.programs.station.scenario import Scenario
from glider.control.tvlqr import TrackingPolicy, tracking_policy
from glider.physics.model import GliderModel
from glider.planning.dircol import plan
from glider.planning.plan import Plan
from glider.planning.problem import PerchingProblem
from glider.systems.mpc import ModelPredictiveController
from glider.systems.mppi import MppiController
from glider.systems.regulator import policy_regulator

_REPLANNING = "replanning"
"""Problem of models/problems whose weights MPC and MPPI have."""

_LATEST = 0.3
"""Share of the plan in which a flight may begin: later states pass the wire."""

_LEADS = {"mpc": 0.006, "mppi": 0.012}
"""Time that a command takes to compute [s]: a little above the medians of bench_latency
on two cores, 5.0 and 10.4 ms."""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Guidance:
    """A plan, where on it a flight begins, and the autopilot that follows it."""

    model: GliderModel
    problem: PerchingProblem
    plan: Plan
    policy: TrackingPolicy
    autopilot: Diagram  #: See `make_autopilot`.
    lead: float = 0.0  #: Time that a command takes to compute [s].

    def state_at(self, time: float) -> np.ndarray:
        """State (n,) of the plan at a time [s]."""
        return self.plan.state_trajectory.value(time)[:, 0]

    def nearest(self, state: np.ndarray) -> float:
        """Time of the plan [s] from which a state (n,) costs least to bring back.

        The cost-to-go x̃ᵀ S x̃ + 2 x̃ᵀ s of the tracking feedback is the distance.
        """
        policy = self.policy
        count = int(np.searchsorted(policy.times, _LATEST * policy.duration))
        away = state - self.plan.state_trajectory.vector_values(policy.times[:count]).T
        costs = np.einsum("ti,tij,tj->t", away, policy.cost[:count], away)
        costs += 2.0 * np.sum(away * policy.cost_slope[:count], axis=1)
        return float(policy.times[np.argmin(costs)])


def make_guidance(scenario: Scenario, controller: System | None = None) -> Guidance:
    """Plans as a scenario says, and makes its autopilot (compiles once).

    Args:
        scenario: what to fly.
        controller: in place of the scenario's; see `make_autopilot`.
    """
    model = scenario.load_model()
    problem = scenario.load_problem()
    if scenario.commands is None:
        planned = plan(model, problem)
    else:
        planned = tape_plan(model, problem.launch, Path(scenario.commands))
    policy = tracking_policy(model, planned)
    lead = 0.0
    if controller is None:
        controller = _controller_of(scenario, model, problem, planned, policy)
        lead = _LEADS.get(scenario.controller, 0.0)
    return Guidance(
        model=model,
        problem=problem,
        plan=planned,
        policy=policy,
        autopilot=make_autopilot(model, scenario.sensors, scenario.filter, controller),
        lead=lead,
    )


def _controller_of(
    scenario: Scenario,
    model: GliderModel,
    problem: PerchingProblem,
    planned: Plan,
    policy: TrackingPolicy,
) -> System:
    """The controller that a scenario names."""
    rate = scenario.command_rate or scenario.sensors.rate
    if scenario.commands is not None:
        return TapePlayer(planned, 1.0 / rate, model.parameters.servo.rate)
    if scenario.controller == "tvlqr":
        return policy_regulator(policy)
    goal = dataclasses.replace(
        PerchingProblem.load(_REPLANNING),
        launch=problem.launch,
        wire=problem.wire,
        hook=problem.hook,
    )
    if scenario.controller == "mpc":
        return ModelPredictiveController(model, goal, rate)
    return MppiController(model, goal, planned, command_rate=rate)
