"""The planner solves the article's problem, checks itself and fails honestly."""

import dataclasses
import itertools

import numpy as np
import pytest
from pydrake.autodiffutils import ExtractGradient, ExtractValue, InitializeAutoDiff
from scipy.integrate import solve_ivp

from glider.effects import KINDS
from glider.effects.field import FieldData
from glider.errors import InputError
from glider.linearization import Dynamics
from glider.model_file import GliderModel
from glider.parameters import GliderParameters
from glider.planning.dircol import PlanningError, plan
from glider.planning.multistart import find_minima
from glider.planning.plan import load_plan, save_plan
from glider.planning.problem import PerchingProblem
from glider.planning.transcription import transcribe
from glider.plant import GliderPlant
from tests.physics import PARAMETERS, nose_up_dynamics


def test_the_article_s_problem_has_the_known_minimum(article_plan):
    """The figures of reference-facts, fault 2; there from a plain Drake program."""
    assert article_plan.cost == pytest.approx(194.0462, abs=1e-3)
    assert article_plan.duration == pytest.approx(0.8795, abs=1e-4)
    assert len(article_plan.times) == 41


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


def test_the_audit_sees_between_the_knots(article_plan):
    """Collocation points are met; between them a finer mesh comes closer."""
    assert article_plan.max_defect < 1e-5
    coarse = plan(GliderPlant(), PerchingProblem(), knots=(15,))
    assert coarse.max_defect < 1e-5
    assert coarse.path_defect > 10.0 * article_plan.path_defect
    assert coarse.drift > 10.0 * article_plan.drift
    assert article_plan.drift < 1e-4


def test_the_trajectories_pass_through_the_knots(article_plan):
    k = 17
    t = article_plan.times[k]
    path = article_plan.state_trajectory
    np.testing.assert_allclose(path.value(t)[:, 0], article_plan.states[k], atol=1e-12)
    assert article_plan.input_trajectory.value(t)[0, 0] == pytest.approx(
        article_plan.inputs[k]
    )
    dynamics = Dynamics(GliderPlant())
    slope = path.MakeDerivative().value(t)[:, 0]
    expected = dynamics.evaluate(article_plan.states[k], article_plan.inputs[k])
    np.testing.assert_allclose(slope, expected, atol=1e-9)


def test_compiled_defects_equal_drake_s():
    """Values and gradients, at a path that meets neither's constraint."""
    rng = np.random.default_rng(1)
    programs = [
        transcribe(GliderPlant(fast=fast), PerchingProblem(), 5)
        for fast in (False, True)
    ]
    point = rng.normal(size=programs[0].prog().num_vars())
    point[:] = np.abs(point) * 0.3
    for k in range(5):  # At some airspeed.
        for program in programs:
            fast_forward = program.state(k)[4]
            index = program.prog().FindDecisionVariableIndex(fast_forward)
            point[index] = 6.0 + 0.1 * k
    values, gradients = [], []
    for program in programs:
        variables = InitializeAutoDiff(point)[:, 0]
        evaluated = {}
        for binding in program.prog().generic_constraints():
            name = binding.evaluator().get_description()
            if name.startswith("defect"):
                indices = program.prog().FindDecisionVariableIndices(
                    binding.variables()
                )
                evaluated[name] = binding.evaluator().Eval(variables[indices])
        assert len(evaluated) == 4
        defects = np.concatenate([evaluated[name] for name in sorted(evaluated)])
        values.append(ExtractValue(defects)[:, 0])
        gradients.append(ExtractGradient(defects))
    # Drake writes the defect with the other sign.
    sign = np.sign(values[0] @ values[1])
    np.testing.assert_allclose(values[1], sign * values[0], atol=1e-9)
    np.testing.assert_allclose(gradients[1], sign * gradients[0], atol=1e-7)


def test_limits_left_unturned_cannot_be_met_and_the_failure_says_so():
    """Fault 2 of the public sources: nose-up limits beside a nose-down pitch."""
    unturned = GliderParameters(elevator_limits=[-0.9473, 0.4463])
    plant = GliderPlant(GliderModel(parameters=unturned))
    told = []
    with pytest.raises(PlanningError) as caught:
        plan(plant, PerchingProblem(), knots=(11,), progress=told.append)
    error = caught.value
    assert error.violations["position at the wire"] > 0.1
    assert "position at the wire by" in str(error)
    assert {"SNOPT", "IPOPT"} <= {attempt.solver for attempt in error.attempts}
    assert len({attempt.guess for attempt in error.attempts}) > 3
    assert len(told) == len(error.attempts) + 1


@pytest.mark.slow
def test_a_plant_with_a_state_of_its_own_is_planned_for():
    lag = KINDS["servo_lag"](time_constant=0.04)
    plant = GliderPlant(GliderModel(effects=(lag,)))
    found = plan(plant, PerchingProblem())
    assert found.states.shape == (41, 8)
    assert found.state_names[-1] == "servo_lag.servo_rate"
    assert found.cost > 200.0  # The servo's lag has its price.
    assert found.states[0, 7] == 0.0
    assert found.drift < 1e-3


def test_a_time_varying_plant_is_refused():
    field = FieldData(
        kind="unexplained",
        variables=["t"],
        centers=[[0.2], [0.6]],
        widths=[0.2],
        weights={"wind_x": [0.1, 0.2]},
    )
    with pytest.raises(InputError, match="depends on time"):
        plan(GliderPlant(GliderModel(field=field)), PerchingProblem())


def test_a_launch_outside_its_own_limits_is_refused():
    launch = [-3.8, 0.1, 0.0, 0.0, 7.0, 0.0, 0.0]
    with pytest.raises(InputError, match=r"x = -3\.8.* -3\.5 and 1"):
        plan(GliderPlant(), PerchingProblem(launch=launch))


def test_distinct_minima_are_told_apart():
    """A fast, near launch has at least two ways to lose its speed."""
    launch = [-3.26, 0.13, -0.01, 0.0, 7.55, 0.0, 0.0]
    minima = find_minima(
        GliderPlant(),
        PerchingProblem(launch=launch),
        8,
        np.random.default_rng(0),
        knots=(15,),
    )
    costs = [minimum.plan.cost for minimum in minima]
    assert len(minima) >= 2
    assert costs == sorted(costs)
    assert sum(len(minimum.guesses) for minimum in minima) == 8
    for first, second in itertools.pairwise(minima):
        assert first.plan.cost != pytest.approx(second.plan.cost, rel=1e-5)


def test_a_plan_is_saved_and_loaded_unchanged(article_plan, tmp_path):
    save_plan(tmp_path / "plan.json", article_plan)
    loaded = load_plan(tmp_path / "plan.json")
    for field in dataclasses.fields(article_plan):
        np.testing.assert_equal(
            getattr(loaded, field.name), getattr(article_plan, field.name)
        )


@pytest.mark.parametrize("text", ["", "{}", "[1]", '{"times": [0, 1]}'])
def test_a_file_that_is_no_plan_is_refused(tmp_path, text):
    path = tmp_path / "plan.json"
    path.write_text(text)
    with pytest.raises(InputError, match="not a plan"):
        load_plan(path)
