"""Controllers of the station: from the predicted state to a rate of the elevator."""

import dataclasses
from pathlib import Path
from typing import Protocol

import numpy as np

from diagrams.station.proposed import Tape, tape_plan
from diagrams.station.scenario import Scenario
from glider.control.mpc import ModelPredictiveController
from glider.control.mppi import SETTINGS, replanning_cost, sequence_of, shifted
from glider.control.tvlqr import TrackingPolicy, tracking_policy
from glider.physics.model import GliderModel
from glider.planning.dircol import plan
from glider.planning.plan import Plan
from glider.planning.problem import PerchingProblem
from glider.planning.sampling import mppi_step

REPLANNING = "replanning"
"""Problem of models/problems whose weights MPC and MPPI have."""

GRID = 0.001
"""Spacing of the table of gains [s]."""

LATEST = 0.3
"""Share of the plan in which a flight may begin: later states pass the wire."""


class Controller(Protocol):
    """A law of the elevator's rate; times are the plan's [s]."""

    lead: float  #: Time that a command takes to compute [s].

    def start(self, time: float) -> None:
        """Begins at a time of the plan."""

    def command(self, time: float, state: np.ndarray) -> float:
        """Rate [rad/s] to hold from a time on, for the state (n,) then."""


class Tracking:
    """Follows the plan: u = offset - gain x, from a table."""

    lead = 0.0

    def __init__(self, policy: TrackingPolicy) -> None:
        self._count = round(policy.duration / GRID)
        times = np.linspace(0.0, policy.duration, self._count + 1)
        self._offset, self._gain = policy.sample(times)
        self._scale = self._count / policy.duration

    def start(self, time: float) -> None:
        """Nothing to do."""

    def command(self, time: float, state: np.ndarray) -> float:
        """See `Controller`; after the plan's end the last gains stay."""
        row = min(max(round(time * self._scale), 0), self._count)
        return float(self._offset[row] - self._gain[row] @ state)


class Replanning:
    """Plans again at each command, by collocation."""

    lead = 0.004

    def __init__(
        self, model: GliderModel, problem: PerchingProblem, rate: float
    ) -> None:
        self._mpc = ModelPredictiveController(model, problem, rate)
        self._period = 1.0 / rate
        context = self._mpc.CreateDefaultContext()
        self._known = self._first = context.get_abstract_state(0).get_value()

    def start(self, time: float) -> None:
        """Goes back to the first plan."""
        self._known = self._first

    def command(self, time: float, state: np.ndarray) -> float:
        """See `Controller`."""
        self._known = self._mpc.plan_again(self._known, time, state)
        return self._known.command(time, self._period)


class Sampling:
    """Draws sequences of commands at each command, and weighs their flights."""

    lead = 0.006

    def __init__(
        self, model: GliderModel, planned: Plan, problem: PerchingProblem, rate: float
    ) -> None:
        self._cost = replanning_cost(model, problem, rate)
        self._first = sequence_of(planned, self._cost.step, self._cost.steps)
        self.start(0.0)

    def start(self, time: float) -> None:
        """Goes back to the plan's commands, and to the same random numbers."""
        self._mean, self._rng = self._first, np.random.default_rng(0)
        for _ in range(int(time / self._cost.step)):
            self._mean = shifted(self._mean)

    def command(self, time: float, state: np.ndarray) -> float:
        """See `Controller`."""
        mean, _, _ = mppi_step(self._cost, state, self._mean, self._rng, SETTINGS)
        self._mean = shifted(mean)
        return float(mean[0])


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Guidance:
    """A plan, where on it a flight begins, and what follows it."""

    model: GliderModel
    problem: PerchingProblem
    plan: Plan
    policy: TrackingPolicy
    controller: Controller

    def state_at(self, time: float) -> np.ndarray:
        """State (n,) of the plan at a time [s]."""
        return self.plan.state_trajectory.value(time)[:, 0]

    def nearest(self, state: np.ndarray) -> float:
        """Time of the plan [s] from which a state (n,) costs least to bring back.

        The cost-to-go x̃ᵀ S x̃ + 2 x̃ᵀ s of the tracking feedback is the distance.
        """
        policy = self.policy
        count = int(np.searchsorted(policy.times, LATEST * policy.duration))
        away = state - self.plan.state_trajectory.vector_values(policy.times[:count]).T
        costs = np.einsum("ti,tij,tj->t", away, policy.cost[:count], away)
        costs += 2.0 * np.sum(away * policy.cost_slope[:count], axis=1)
        return float(policy.times[np.argmin(costs)])


def make_guidance(scenario: Scenario) -> Guidance:
    """Plans as a scenario says, and makes its controller (compiles once)."""
    model, problem = scenario.load_model(), scenario.load_problem()
    if scenario.commands is None:
        planned = plan(model, problem)
    else:
        planned = tape_plan(model, problem.launch, Path(scenario.commands))
    policy = tracking_policy(model, planned)
    rate = scenario.command_rate or scenario.sensors.rate
    goal = dataclasses.replace(
        PerchingProblem.load(REPLANNING),
        launch=problem.launch,
        wire=problem.wire,
        hook=problem.hook,
    )
    controller: Controller
    if scenario.commands is not None:
        controller = Tape(planned, 1.0 / rate, model.parameters.servo.rate)
    elif scenario.controller == "mpc":
        controller = Replanning(model, goal, rate)
    elif scenario.controller == "mppi":
        controller = Sampling(model, planned, goal, rate)
    else:
        controller = Tracking(policy)
    return Guidance(
        model=model, problem=problem, plan=planned, policy=policy, controller=controller
    )
