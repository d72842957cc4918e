"""The planner solves the article's problem, checks itself and fails honestly."""

import pickle

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from glider.compiled.kernel import UncompilableError
from glider.errors import InputError
from glider.physics.effects import KINDS
from glider.physics.effects.free_functions import FreeFunction
from glider.physics.model import GliderModel
from glider.physics.parameters import GliderParameters
from glider.planning import dircol, path
from glider.planning.constraints import Violation
from glider.planning.dircol import PlanningError, can_perch, plan
from glider.planning.path import Path
from glider.planning.problem import PerchingProblem
from glider.systems import plant
from tests.helpers.physics import PARAMETERS, nose_up_dynamics


def test_the_article_s_problem_has_the_known_minimum(article_plan):
    """The figures of reference-facts, fault 2; there from a plain Drake program."""
    assert article_plan.cost == pytest.approx(194.0462, abs=1e-3)
    assert article_plan.duration == pytest.approx(0.8795, abs=1e-4)
    assert len(article_plan.times) == 41
    assert article_plan.seconds > 0.0


def test_a_plan_keeps_what_the_problem_asks(article_plan):
    problem, vehicle = PerchingProblem(), GliderParameters()
    states = article_plan.states
    np.testing.assert_allclose(states[0], problem.launch, atol=1e-9)
    np.testing.assert_allclose(states[-1, :2], problem.wire, atol=1e-6)
    low, high = vehicle.elevator_limits
    assert low - 1e-6 <= states[:, 3].min() <= states[:, 3].max() <= high + 1e-6
    assert np.abs(article_plan.inputs).max() <= vehicle.elevator_rate_limit + 1e-6
    assert np.abs(states[-1, 4:6]).max() <= problem.final_speed_limit + 1e-6
    assert -1.0 - 1e-6 <= states[-1, 2] <= -np.pi / 6 + 1e-6


def test_limits_that_bind_are_met():
    """Without them this flight climbs to 0.27 m at up to 4.8 rad/s."""
    slow = GliderParameters(elevator_rate_limit=4.5)
    model = GliderModel(parameters=slow)
    found = plan(model, PerchingProblem(z_limits=[-1.0, 0.12]), knots=7)
    assert found.states[:, 1].max() == pytest.approx(0.12, abs=1e-6)
    assert np.abs(found.inputs).max() == pytest.approx(4.5, abs=1e-6)


def test_a_plan_is_a_flight_of_an_independent_glider(article_plan):
    """An oracle that shares no code with the dynamics, integrated finely."""
    tape = article_plan.input_trajectory

    def rates(t, x):
        return nose_up_dynamics(x, tape.value(t)[0, 0], PARAMETERS)

    flight = solve_ivp(
        rates,
        (0.0, article_plan.duration),
        article_plan.states[0],
        rtol=1e-9,
        atol=1e-9,
        max_step=0.01,
    )
    assert np.hypot(*flight.y[:2, -1]) < 0.002


@pytest.mark.parametrize("knot", [1, 20, 39], ids=["early", "middle", "late"])
def test_a_shifted_knot_shows_in_the_defects_of_the_path(article_plan, knot):
    states = article_plan.states.copy()
    parts = states, article_plan.inputs
    assert Path(GliderModel(), article_plan.times, *parts).defects.max() < 1e-6
    states[knot, 0] += 0.01
    path = Path(GliderModel(), article_plan.times, *parts)
    assert path.defects[:, 0].max() == pytest.approx(0.01, rel=0.05)


def test_the_trajectories_pass_through_the_knots(article_plan):
    k = 17
    t = article_plan.times[k]
    path = article_plan.state_trajectory
    np.testing.assert_allclose(path.value(t)[:, 0], article_plan.states[k], atol=1e-12)
    assert article_plan.input_trajectory.value(t)[0, 0] == pytest.approx(
        article_plan.inputs[k]
    )
    slope = path.MakeDerivative().value(t)[:, 0]
    expected = nose_up_dynamics(
        article_plan.states[k], article_plan.inputs[k], PARAMETERS
    )
    np.testing.assert_allclose(slope, expected, atol=1e-9)


def test_limits_left_unturned_cannot_be_met_and_the_failure_says_so():
    """Fault 2 of the public sources: nose-up limits beside a nose-down pitch."""
    unturned = GliderParameters(elevator_limits=[-0.9473, 0.4463])
    model = GliderModel(parameters=unturned)
    told = []
    with pytest.raises(PlanningError) as caught:
        plan(model, PerchingProblem(), knots=11, progress=told.append)
    error = caught.value
    worst = error.violations[0]
    assert worst.amount > 0.01
    assert worst.amount == max(violation.amount for violation in error.violations)
    assert str(error).endswith(
        "0.4463] rad, are narrower than the default glider's). The path found "
        f"violates '{worst.name}' the most, by {worst.amount:.3g} {worst.unit}."
    )
    assert "SNOPT: InfeasibleConstraints (13)" in str(error)
    assert told == ["planning on 11 knots"]


def test_a_failure_survives_a_journey():
    violations = [Violation("pitch at the wire", 0.25, "rad")]
    error = PlanningError("InfeasibleConstraints (13)", violations)
    again = pickle.loads(pickle.dumps(error))
    assert str(again) == str(error)
    assert "violates 'pitch at the wire' the most, by 0.25 rad." in str(again)
    assert vars(again) == vars(error)


def test_drake_s_word_is_not_enough(monkeypatch):
    """A path that it calls a solution, moved off one."""
    solve = dircol.SnoptSolver.Solve

    def solve_and_move(solver, program, *args):
        result = solve(solver, program, *args)
        values = result.get_x_val().copy()
        values[len(values) // 2] += 0.01
        result.set_x_val(values)
        return result

    plan(GliderModel(), PerchingProblem(), knots=7)
    monkeypatch.setattr(dircol.SnoptSolver, "Solve", solve_and_move)
    with pytest.raises(PlanningError, match="SNOPT: SolutionFound"):
        plan(GliderModel(), PerchingProblem(), knots=7)


def test_a_formula_that_does_not_compile_is_planned_for(monkeypatch):
    """Compiling one takes a long time to fail, so a quick failure stands for it."""

    def fail(*args):
        raise UncompilableError("no such formula")

    compiled = plan(GliderModel(), PerchingProblem(), knots=15)
    for module in (plant, path):
        monkeypatch.setattr(module, "differentiate", fail)
    found = plan(GliderModel(), PerchingProblem(), knots=15)
    assert found.cost == pytest.approx(compiled.cost, rel=1e-7)


@pytest.mark.slow
def test_a_plant_with_a_state_of_its_own_is_planned_for():
    lag = KINDS["servo_lag"](time_constant=0.04)
    found = plan(GliderModel(effects=(lag,)), PerchingProblem())
    assert found.states.shape == (41, 8)
    assert found.state_names[-1] == "servo_lag.servo_rate"
    assert found.cost > 200.0  # The servo's lag has its price.
    assert found.states[0, 7] == 0.0


def test_a_time_varying_plant_is_refused():
    field = FreeFunction(
        kind="unexplained",
        variables=["t"],
        centers=[[0.2], [0.6]],
        widths=[0.2],
        weights={"wind_x": [0.1, 0.2]},
    )
    with pytest.raises(InputError, match="depends on time"):
        plan(GliderModel(free_functions=(field,)), PerchingProblem())


def test_a_mass_in_grams_is_refused():
    model = GliderModel(parameters=GliderParameters(mass=80.0))
    with pytest.raises(InputError, match=r"'mass' and 'pitch_inertia'.*in grams"):
        plan(model, PerchingProblem())


def test_a_launch_outside_its_own_limits_is_refused():
    launch = [-3.8, 0.1, 0.0, 0.0, 7.0, 0.0, 0.0]
    with pytest.raises(InputError, match=r"x is -3\.8; expected .* from -3\.5 to 1"):
        plan(GliderModel(), PerchingProblem(launch=launch))


@pytest.mark.parametrize("knots", ["41", [41], 2, 41.5, None])
def test_knots_that_are_no_numbers_of_them_are_refused(knots):
    with pytest.raises(InputError, match=r"'knots' is .*; expected a whole number"):
        plan(GliderModel(), knots=knots)


def test_slow_launches_cannot_perch():
    """From 4.8 m/s a flight does not reach the wire; from 6 m/s, level, it does."""
    launch = PerchingProblem().launch
    arrived = []
    for speed in (4.8, 7.0):
        launch[4] = speed
        arrived.append(can_perch(GliderModel(), PerchingProblem(), launch))
    assert arrived == [False, True]
    with pytest.raises(InputError, match=r"x is -3\.8"):
        can_perch(GliderModel(), PerchingProblem(), [-3.8, *launch[1:]])
