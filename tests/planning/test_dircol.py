"""The planner solves the article's problem, checks itself and fails honestly."""

import pickle

import numba
import numpy as np
import pytest
from pydrake.autodiffutils import ExtractGradient, ExtractValue, InitializeAutoDiff
from pydrake.solvers import SnoptSolver
from scipy.integrate import solve_ivp

from glider.compiled import jacobian
from glider.errors import InputError
from glider.physics.effects import KINDS
from glider.physics.effects.field import FieldData
from glider.physics.model import GliderModel
from glider.physics.parameters import GliderParameters
from glider.planning import dircol
from glider.planning.dircol import LOOSE, PlanningError, path_defects, plan
from glider.planning.guess import straight_line, swoop
from glider.planning.problem import PerchingProblem
from glider.planning.transcription import Dynamics, transcribe, violated
from tests.helpers.physics import PARAMETERS, nose_up_dynamics


def test_the_article_s_problem_has_the_known_minimum(article_plan):
    """The figures of reference-facts, fault 2; there from a plain Drake program."""
    assert article_plan.cost == pytest.approx(194.0462, abs=1e-3)
    assert article_plan.duration == pytest.approx(0.8795, abs=1e-4)
    assert len(article_plan.times) == 41
    assert [(a.knots, a.guess) for a in article_plan.attempts] == [
        (25, "a straight line over 1.12 s"),
        (41, "the plan on fewer knots"),
    ]


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
    found = plan(model, PerchingProblem(z_limits=[-1.0, 0.12]), knots=(7,))
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


def test_defects_are_seen_between_the_knots(article_plan):
    """Collocation points are met; between them a finer mesh comes closer."""
    assert article_plan.max_defect < 1e-5
    coarse = plan(GliderModel(), PerchingProblem(), knots=(15,))
    assert coarse.max_defect < 1e-5
    assert coarse.path_defect > 10.0 * article_plan.path_defect


@pytest.mark.parametrize("knot", [1, 20, 39], ids=["early", "middle", "late"])
def test_a_shifted_knot_shows_in_the_defect_of_the_path(article_plan, knot):
    """A cubic that makes up 1 cm in h is at most 1.5 / h times 1 cm too fast."""
    states = article_plan.states.copy()
    states[knot, 0] += 0.01
    defects = path_defects(
        Dynamics(GliderModel()),
        article_plan.times,
        states,
        article_plan.slopes,
        article_plan.inputs,
    ).max(axis=(0, 1))
    expected = 1.5 * 0.01 / article_plan.times[1]
    assert defects[0] == pytest.approx(expected, rel=0.05)
    assert np.all(np.isfinite(defects))


def test_the_trajectories_pass_through_the_knots(article_plan):
    k = 17
    t = article_plan.times[k]
    path = article_plan.state_trajectory
    np.testing.assert_allclose(path.value(t)[:, 0], article_plan.states[k], atol=1e-12)
    assert article_plan.input_trajectory.value(t)[0, 0] == pytest.approx(
        article_plan.inputs[k]
    )
    dynamics = Dynamics(GliderModel())
    slope = path.MakeDerivative().value(t)[:, 0]
    expected = dynamics.evaluate(article_plan.states[k], article_plan.inputs[k])
    np.testing.assert_allclose(slope, expected, atol=1e-9)


def test_compiled_defects_equal_drake_s():
    """Values and gradients, at a path that meets neither's constraint."""
    rng = np.random.default_rng(1)
    programs = [
        transcribe(Dynamics(GliderModel(), fast), PerchingProblem(), 5)
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
    model = GliderModel(parameters=unturned)
    told = []
    with pytest.raises(PlanningError) as caught:
        plan(
            model,
            PerchingProblem(),
            knots=(6, 11),
            progress=told.append,
            structured=False,
        )
    error = caught.value
    assert error.violations["position at the wire"] > 0.1
    assert "position at the wire by" in str(error)
    assert {"SNOPT", "IPOPT"} <= {attempt.solver for attempt in error.attempts}
    assert len({attempt.guess for attempt in error.attempts}) > 3
    assert len(told) == len(error.attempts) + 1
    line = error.attempts[0].guess
    assert [(a.guess, a.tolerance) for a in error.attempts[:3]] == [
        *[(line, dircol.TOLERANCE)] * 2,
        (line, LOOSE),
    ]
    assert "on 6 and 11 knots" in str(error)  # Fewer alone are no reason to give up.


def test_the_most_knots_are_tried_where_fewer_do_not_arrive(monkeypatch):
    def find_faults(program, result, tolerance):
        return () if len(program.GetSampleTimes(result)) == 5 else ("pitch",)

    monkeypatch.setattr(dircol, "violated", find_faults)
    found = plan(GliderModel(), PerchingProblem(), knots=(4, 5), structured=False)
    assert len(found.times) == 5
    assert [a.knots for a in found.attempts if a.solved] == [5]
    assert found.attempts[0].knots == 4


@pytest.mark.parametrize(
    ("violations", "words"),
    [
        ({"pitch at the wire": 0.25}, "violates pitch at the wire by 0.25"),
        ({}, "no flight within the limits was found at all"),
    ],
)
def test_a_failure_survives_a_journey(article_plan, violations, words):
    error = PlanningError(violations, article_plan.attempts)
    again = pickle.loads(pickle.dumps(error))
    assert str(again) == str(error)
    assert words in str(again)
    assert vars(again) == vars(error)


def test_a_solver_s_word_is_not_enough(monkeypatch):
    faults = iter([("defect of segment 0",)])
    monkeypatch.setattr(dircol, "violated", lambda *_: next(faults, ()))
    found = plan(GliderModel(), PerchingProblem(), knots=(7,), structured=False)
    assert [(a.solver, a.solved) for a in found.attempts] == [
        ("SNOPT", False),
        ("IPOPT", True),
    ]
    assert found.attempts[0].status.startswith("SolutionFound")


def test_what_a_result_violates_is_named():
    model, problem = GliderModel(), PerchingProblem()
    program = transcribe(Dynamics(model), problem, 5)
    line = straight_line(model, problem)
    program.SetInitialTrajectory(line.inputs, line.states)
    result = SnoptSolver().Solve(program.prog())
    assert violated(program, result, 1e-6) == ()
    values = result.get_x_val().copy()
    values[program.prog().FindDecisionVariableIndex(program.state(2)[1])] += 0.01
    result.set_x_val(values)
    assert violated(program, result, 1e-6) == (
        "defect of segment 1",
        "defect of segment 2",
    )
    assert violated(program, result, 0.1) == ()


def test_a_swoop_dips_and_its_speeds_are_its_path_s():
    guess = swoop(GliderModel(), PerchingProblem(), 0.3, 0.8)
    assert guess.states.value(0.4)[1, 0] == pytest.approx(0.05 - 0.3)
    z = [guess.states.value(t)[1, 0] for t in (0.0, 0.1)]
    assert z[1] < z[0]
    zdot = guess.states.value(0.0)[5, 0]
    assert zdot == pytest.approx(-0.3 * np.pi / 0.8)
    assert guess.states.end_time() == pytest.approx(0.8)


@pytest.mark.slow
def test_a_plant_with_a_state_of_its_own_is_planned_for():
    lag = KINDS["servo_lag"](time_constant=0.04)
    found = plan(GliderModel(effects=(lag,)), PerchingProblem())
    assert found.states.shape == (41, 8)
    assert found.state_names[-1] == "servo_lag.servo_rate"
    assert found.cost > 200.0  # The servo's lag has its price.
    assert found.states[0, 7] == 0.0


def test_a_formula_that_does_not_compile_is_planned_for_too(monkeypatch):
    """As Drake does it on the plain plant; a real one takes a long time to fail."""

    class Uncompilable:
        def over(self, *_):
            return self

        def directional(self, *_):
            raise numba.core.errors.TypingError("a dict of mixed values")

    reference = plan(GliderModel(), PerchingProblem(), knots=(5,), fast=False)
    monkeypatch.setattr(jacobian, "LOOPS", Uncompilable())
    dynamics = Dynamics(GliderModel())
    assert dynamics.fast
    transcribe(dynamics, PerchingProblem(), 5)
    assert not dynamics.fast
    found = plan(GliderModel(), PerchingProblem(), knots=(5,))
    assert found.cost == pytest.approx(reference.cost, rel=1e-9)
    assert found.max_defect < 1e-5


def test_the_plain_slopes_are_the_compiled_ones():
    model = GliderModel(effects=(KINDS["servo_lag"](time_constant=0.03),))
    x, u = np.array([-2.0, 0.2, -0.4, 0.3, 6.0, 0.5, -1.0, 2.0]), 1.5
    fast, plain = (Dynamics(model, fast) for fast in (True, False))
    for ours, theirs in zip(fast.linearize(x, u), plain.linearize(x, u), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(fast.evaluate(x, u), plain.evaluate(x, u), rtol=1e-10)


def test_a_time_varying_plant_is_refused():
    field = FieldData(
        kind="unexplained",
        variables=["t"],
        centers=[[0.2], [0.6]],
        widths=[0.2],
        weights={"wind_x": [0.1, 0.2]},
    )
    with pytest.raises(InputError, match="depends on time"):
        plan(GliderModel(field=field), PerchingProblem())


def test_a_mass_in_grams_is_refused():
    model = GliderModel(parameters=GliderParameters(mass=80.0))
    with pytest.raises(InputError, match=r"'mass' and 'pitch_inertia'.*in grams"):
        plan(model, PerchingProblem())


def test_a_launch_outside_its_own_limits_is_refused():
    launch = [-3.8, 0.1, 0.0, 0.0, 7.0, 0.0, 0.0]
    with pytest.raises(InputError, match=r"x is -3\.8; expected .* from -3\.5 to 1"):
        plan(GliderModel(), PerchingProblem(launch=launch))


@pytest.mark.parametrize("knots", ["41", 41, [], [2], [41.5], None])
def test_knots_that_are_no_numbers_of_them_are_refused(knots):
    with pytest.raises(InputError, match=r"'knots' is .*; expected a list of one"):
        plan(GliderModel(), knots=knots)
