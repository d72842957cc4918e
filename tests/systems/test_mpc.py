"""Planning again at each command: perches, holds its commands, survives a failure."""

import dataclasses

import numpy as np
import pytest
from pydrake.planning import DirectCollocation
from pydrake.solvers import SnoptSolver
from pydrake.systems.analysis import Simulator

from diagrams.loops import closed_loop
from diagrams.simulate import simulate_flights
from glider.control.mpc import _LAST, Replanner
from glider.errors import InputError
from glider.paths import models_path
from glider.physics.effects.free_functions import FreeFunction
from glider.physics.model import GliderModel
from glider.physics.parameters import GliderParameters
from glider.planning.dircol import PlanningError
from glider.planning.problem import PerchingProblem
from glider.systems.mpc import ModelPredictiveController
from glider.systems.plant import GliderPlant
from tests.helpers.flights import LAGGING, NOMINAL, PROBLEM

REPLANNING = PerchingProblem.load(models_path("problems", "replanning.yaml"))
LAUNCH = np.array(REPLANNING.launch)


def controller(model=NOMINAL, **options):
    return ModelPredictiveController(model, REPLANNING, **options)


def state_and_outputs(system, state, time, begin=0.0):
    """Returns what a controller goes by, its command and its timing."""
    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    system.GetInputPort("state").FixValue(context, state)
    context.SetTime(begin)
    simulator.Initialize()
    simulator.AdvanceTo(time)
    return (
        context.get_abstract_state(0).get_value(),
        system.GetOutputPort("elevator_rate").Eval(context)[0],
        system.GetOutputPort("timing").Eval(context),
    )


@pytest.mark.parametrize("model", [NOMINAL, LAGGING], ids=["flat", "lag"])
def test_launches_three_times_as_wide_perch(model):
    """Of a glider whose effects have states too, which an observer runs."""
    starts = LAUNCH + np.array(
        [[0, 0.12, 0.06, 0, 0.3, 0, 0], [0, -0.12, -0.06, 0, -0.3, 0, 0]]
    )
    made = []
    diagram = closed_loop(model, controller(model, watch=made.append), planned=model)
    flights = simulate_flights(diagram, starts, 1.1, problem=PROBLEM)
    assert flights.perched == 2
    assert max(flights.misses) < 5e-3
    assert made[-1].failures == 0
    assert [again.plans for again in made[:3]] == [1, 2, 3]


def test_commands_are_held_between_plans():
    known, first, timing = state_and_outputs(controller(), LAUNCH, 0.001)
    _, later, _ = state_and_outputs(controller(), LAUNCH, 0.019)
    assert first == later == known.command(0.0, 0.02)
    assert timing[0] == 1 and timing[1] == 0
    assert timing[3] >= timing[2] > 0.0
    known, third, timing = state_and_outputs(controller(), LAUNCH, 0.041)
    assert timing[0] == 3
    assert third != first
    assert known.begin == pytest.approx(0.04)


def test_a_plan_that_fails_leaves_the_last_one():
    system = controller()
    expected = system.CreateDefaultContext().get_abstract_state(0).get_value()
    too_low = LAUNCH.copy()
    too_low[1] = 2.0 * REPLANNING.z_limits[0]
    known, command, timing = state_and_outputs(system, too_low, 0.09)
    np.testing.assert_array_equal(known.flight.states, expected.flight.states)
    assert known.begin == 0.0
    assert command == expected.command(0.08, 0.02)
    assert timing[0] == timing[1] == 5
    assert known.failed


def test_the_end_of_a_plan_is_flown_as_it_is():
    replanner = Replanner(NOMINAL, REPLANNING)
    known = replanner.plan_first()
    end = known.flight.times[-1]
    again = replanner.plan_again(known, end - 0.9 * _LAST, LAUNCH)
    assert again.flight is known.flight and again.plans == 0
    assert known.command(end - 0.03, 0.02) != 0.0
    assert known.command(end, 0.02) == 0.0


@pytest.mark.parametrize("begin", [2.0, 2.006])
def test_a_flight_at_any_time_is_planned_for(begin):
    """On the clock's ticks and between them."""
    known, command, timing = state_and_outputs(controller(), LAUNCH, 0.041)
    later, again, counts = state_and_outputs(
        controller(), LAUNCH, begin + 0.041, begin=begin
    )
    ticks = 3 if begin == 2.0 else 2  # Until the first, the first plan's command.
    assert timing[0] == 3 and counts[0] == ticks
    if ticks == 3:
        assert again == pytest.approx(command, rel=1e-6)
        np.testing.assert_allclose(later.flight.states, known.flight.states, atol=1e-6)


def test_a_flight_may_begin_farther_along_the_plan():
    system = controller()
    first = system.CreateDefaultContext().get_abstract_state(0).get_value().flight
    k = len(first.times) // 4
    known, *_ = state_and_outputs(system, first.states[k], 5.001, begin=5.0)
    rest = first.times[-1] - first.times[k]
    assert known.flight.times[-1] == pytest.approx(rest, rel=0.1)


@pytest.mark.parametrize("model", [NOMINAL, LAGGING], ids=["flat", "lag"])
def test_plans_from_one_state_end_at_the_minimum_of_drake_s_program(model):
    """Of its direct collocation with the problem's cost and no place to arrive at."""
    problem = dataclasses.replace(REPLANNING, rate_cost=1.0)
    state = model.initial_state(problem.launch)
    state[:3] += [0.05, -0.03, 0.04]
    replanner = Replanner(model, problem)
    known = replanner.begin(replanner.plan_first(), 0.0, state)
    for _ in range(8):
        known = replanner.plan_again(known, known.begin, state)
    assert known.failures == 0
    found = known.flight
    knots = len(found.times)
    plant = GliderPlant(model)
    context = plant.CreateDefaultContext()
    dc = DirectCollocation(plant, context, knots, 0.5 / knots, 1.5 / knots)
    dc.AddEqualTimeIntervalsConstraints()
    dc.prog().AddBoundingBoxConstraint(state, state, dc.initial_state())
    dc.AddRunningCost(problem.rate_cost * dc.input()[0] ** 2)
    weights = np.diag(problem.goal_weights)
    final = dc.final_state()[:7]
    dc.prog().AddQuadraticErrorCost(weights, np.array(problem.goal), final)
    dc.SetInitialTrajectory(found.input_trajectory, found.state_trajectory)
    solver = SnoptSolver()
    dc.prog().SetSolverOption(solver.id(), "Major optimality tolerance", 1e-4)
    result = solver.Solve(dc.prog())
    assert result.is_success()
    assert found.cost == pytest.approx(result.get_optimal_cost(), rel=1e-6)
    np.testing.assert_allclose(found.states, dc.GetStateSamples(result).T, atol=1e-3)


def test_what_cannot_be_planned_for_is_refused():
    with pytest.raises(InputError, match="command rate is nan"):
        controller(command_rate=np.nan)
    gust = FreeFunction(
        kind="unexplained",
        variables=["t"],
        centers=[[0.5]],
        widths=[0.2],
        weights={"wind_z": [0.3]},
    )
    with pytest.raises(InputError, match="depends on time"):
        controller(GliderModel(free_functions=(gust,)))
    unturned = GliderParameters(elevator_limits=[-0.9473, 0.4463])
    with pytest.raises(PlanningError, match="violates"):
        controller(GliderModel(parameters=unturned))
