"""Planning again at each command: perches, holds its commands, survives a failure."""

import dataclasses

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from diagrams.loops import closed_loop
from diagrams.simulate import simulate_flights
from glider.control import mpc
from glider.control.mpc import _LAST, Replanner
from glider.errors import InputError
from glider.paths import models_path
from glider.physics.effects.free_functions import FreeFunction
from glider.physics.model import GliderModel
from glider.planning import structured
from glider.planning.guess import straight_line
from glider.planning.problem import PerchingProblem
from glider.planning.structured import make_program, solve_structured
from glider.systems.mpc import ModelPredictiveController
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


def test_a_plan_that_fails_leaves_the_last_one(monkeypatch):
    system = controller()
    expected = system.CreateDefaultContext().get_abstract_state(0).get_value()
    whole = mpc.solve_structured

    def fail(*args, **options):
        return dataclasses.replace(whole(*args, **options), solved=False)

    monkeypatch.setattr(mpc, "solve_structured", fail)
    known, command, timing = state_and_outputs(system, LAUNCH, 0.09)
    np.testing.assert_array_equal(known.flight.knots, expected.flight.knots)
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
        np.testing.assert_allclose(later.flight.knots, known.flight.knots, atol=1e-6)


def test_a_flight_may_begin_farther_along_the_plan():
    system = controller()
    first = system.CreateDefaultContext().get_abstract_state(0).get_value().flight
    k = len(first.times) // 4
    known, *_ = state_and_outputs(system, first.knots[k, :7], 5.001, begin=5.0)
    rest = first.times[-1] - first.times[k]
    assert known.flight.times[-1] == pytest.approx(rest, rel=0.1)


def test_who_need_not_arrive_ends_where_it_is_cheapest():
    """Held to that place, and with all bounds open, a flight is the same."""
    problem = dataclasses.replace(REPLANNING, rate_cost=1.0)
    guess = straight_line(NOMINAL, problem, 1.1)
    free = solve_structured(NOMINAL, problem, 21, guess, arrive=False)
    assert free.solved
    assert np.all(free.optimum.pull == 0.0)
    end = free.knots[-1]
    held = dataclasses.replace(
        problem, wire=end[:2].tolist(), final_pitch_limits=[-1.5, 1.5]
    )
    held = dataclasses.replace(held, final_speed_limit=5.0)
    again = solve_structured(NOMINAL, held, 21, guess)
    assert again.cost == pytest.approx(free.cost, rel=1e-6)
    np.testing.assert_allclose(again.optimum.pull, 0.0, atol=1e-4)
    assert 0.0 < np.hypot(*end[:2]) < 0.05
    program = make_program(NOMINAL, problem, 5, arrive=False)
    low = program.bounds[0, :-1].reshape(5, 8)
    assert np.all(np.isinf(low[-1, [0, 1, 4, 5]])) and not program.is_held


def test_what_cannot_be_planned_for_is_refused(monkeypatch):
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
    whole = structured.solve_structured
    monkeypatch.setattr(
        structured,
        "solve_structured",
        lambda *a, **k: whole(*a, **(k | {"iterations": 2})),
    )
    with pytest.raises(InputError, match="status is 'out of steps"):
        controller()
