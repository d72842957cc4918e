"""Our own solver of the transcription finds what Drake's find, and says when not."""

import dataclasses

import numba
import numpy as np
import pytest
from pydrake.autodiffutils import ExtractGradient, InitializeAutoDiff
from pydrake.planning import DirectCollocationConstraint

from glider.compiled import collocation, stages
from glider.compiled.collocation import LOOPS as POINTS
from glider.compiled.collocation import PathDynamics
from glider.compiled.interior_point import _make_scratch
from glider.errors import InputError
from glider.physics.effects import KINDS
from glider.physics.effects.free_functions import FreeFunction
from glider.physics.model import GliderModel
from glider.planning.dircol import PlanningError, plan
from glider.planning.guess import straight_line
from glider.planning.problem import PerchingProblem
from glider.planning.structured import can_perch, make_program, solve_structured
from glider.systems.plant import GliderPlant
from tests.helpers.optimality import check_optimality

MODEL, PROBLEM = GliderModel(), PerchingProblem()
LAGGING = GliderModel(effects=(KINDS["servo_lag"](time_constant=0.04),))
BLOWN = GliderModel(
    free_functions=(
        FreeFunction(
            kind="unexplained",
            variables=["x"],
            centers=[[-2.0], [-1.0]],
            widths=[0.7],
            weights={"wind_x": [-0.4, 0.5], "wind_z": [0.2, 0.1]},
        ),
    )
)


@pytest.mark.parametrize(
    "model",
    [MODEL, LAGGING, pytest.param(BLOWN, marks=pytest.mark.nightly)],
    ids=["flat", "lag", "field"],
)
def test_a_plan_is_a_minimum_of_drake_s_own_program(model):
    found = plan(model, PROBLEM, knots=(15, 21))
    assert [a.solver for a in found.attempts] == ["interior point"] * 2
    checked = check_optimality(model, PROBLEM, found)
    assert checked.violation < 1e-6
    assert checked.slope < 1e-8
    assert checked.cost == pytest.approx(found.cost, rel=1e-9)


def test_a_path_that_is_none_is_seen(article_plan):
    """A knot of the article's plan moved, and a command: no flight, and no minimum."""
    states = article_plan.states.copy()
    states[20, 0] += 1e-3
    moved = dataclasses.replace(article_plan, states=states)
    assert check_optimality(MODEL, PROBLEM, moved).violation > 1e-2
    dearer = plan(MODEL, dataclasses.replace(PROBLEM, rate_cost=150.0))
    checked = check_optimality(MODEL, PROBLEM, dearer)
    assert checked.violation < 1e-6
    assert checked.slope > 1e-5


def _collocated(model, w):
    """Returns a path that is no flight, its defects' sum and its dynamics."""
    knots = (w.size - 1) // (model.num_states + 1)
    dynamics = PathDynamics(model, knots)
    dynamics.collocate(w)
    return dynamics


def _no_flight(model, rng, knots=6):
    points = rng.normal(size=(knots, model.num_states + 1)) * 0.3
    points[:, 4] += 6.0
    return np.append(points.ravel(), 0.03)


@pytest.mark.parametrize("model", [MODEL, LAGGING], ids=["flat", "lag"])
def test_defects_are_drake_s(model):
    """Drake multiplies them by 3 / (2 h)."""
    path = _collocated(model, _no_flight(model, np.random.default_rng(0))).path
    plant = GliderPlant(model)
    constraint = DirectCollocationConstraint(plant, plant.CreateDefaultContext())
    at = path.points
    for k, defect in enumerate(path.defects):
        ends = at[k, :-1], at[k + 1, :-1], at[k, -1:], at[k + 1, -1:]
        expected = constraint.Eval(np.concatenate([[0.03], *ends]))
        np.testing.assert_allclose(defect * 1.5 / 0.03, expected, atol=1e-9)


def _linearize(model, point):
    """Slopes of the plain formulas at a point of state and command, by AutoDiffXd."""
    z = InitializeAutoDiff(point)[:, 0]
    derivatives = model.chain.derivatives
    rates = derivatives(0.0, z[:-1], z[-1], 0.0, 0.0, model.numbers)
    return ExtractGradient(np.array(rates))


def test_fine_slopes_are_exact_ones():
    """To a hundredth of what the solver asks for, of the sharpest effects too."""
    effects = (
        KINDS["stalled_downwash"](gradient=0.3, stall_angle=0.1, fade=0.01),
        KINDS["attached_lift"](slope=2.0, stall_angle=0.2, fade=0.02),
        KINDS["tail_wake"](loss=0.4, angle=0.05, width=0.04),
        KINDS["ground_effect"](strength=0.02, height=0.1),
    )
    model = GliderModel(effects=effects)
    along = _collocated(model, _no_flight(model, np.random.default_rng(0), 20))
    along.linearize(fine=True)
    worst = 0.0
    for point, slopes in zip(along.path.points, along.path.slopes, strict=True):
        expected = _linearize(model, point)
        worst = max(worst, np.abs(slopes - expected).max() / np.abs(expected).max())
    assert worst < 1e-8


def test_curvature_is_the_difference_of_slopes():
    rng = np.random.default_rng(1)
    w = _no_flight(LAGGING, rng)
    dynamics = _collocated(LAGGING, w)
    dynamics.linearize(fine=True)
    path = dynamics.path
    path.weights[:] = rng.normal(size=path.weights.shape)
    dynamics.curve()
    parts = path.points, path.weights, path.curvature
    for point, weights, curvature in zip(*parts, strict=True):
        for i, step in enumerate(1e-5 * np.eye(len(point))):
            moved = point + step, point - step
            forth, back = (_linearize(LAGGING, p) for p in moved)
            expected = weights @ (forth - back) / 2e-5
            np.testing.assert_allclose(
                curvature[i], expected, atol=2e-3 * np.abs(curvature).max()
            )


def test_slopes_of_the_lagrangian_are_its_differences():
    rng = np.random.default_rng(3)
    w = _no_flight(LAGGING, rng)
    multipliers = rng.normal(size=(5, LAGGING.num_states))
    dynamics = _collocated(LAGGING, w)
    dynamics.linearize(fine=True)
    scratch = _make_scratch(LAGGING.num_states, 6)
    scratch.lagrangian[:] = 0.0
    stages.weigh(w[-1], dynamics.path, multipliers, scratch)
    gradient = scratch.lagrangian
    for i in [*range(0, w.size, 5), w.size - 1]:
        values = []
        for side in (1e-5, -1e-5):
            moved = w.copy()
            moved[i] += side
            defects = _collocated(LAGGING, moved).path.defects
            values.append(np.sum(multipliers * defects))
        assert (values[0] - values[1]) / 2e-5 == pytest.approx(gradient[i], abs=1e-7)


def test_near_the_minimum_each_iteration_squares_the_error(article_plan):
    """So curvature and slopes belong together: from its own end, one step or two."""
    rough = solve_structured(
        MODEL, PROBLEM, 25, straight_line(MODEL, PROBLEM, 1.1), tolerance=1e-2
    )
    fine = solve_structured(MODEL, PROBLEM, 25, rough)
    assert fine.solved
    assert int(fine.status.split("(")[1].split()[0]) <= 8


def test_a_plan_is_made_again_on_the_way():
    """The rest of a plan is its own best continuation, so little is left to do."""
    first = solve_structured(MODEL, PROBLEM, 41, straight_line(MODEL, PROBLEM, 1.1))
    elapsed = 0.2
    names = range(first.num_states)
    state = [float(np.interp(elapsed, first.times, first.knots[:, i])) for i in names]
    later = dataclasses.replace(PROBLEM, launch=state, duration_limits=[0.1, 2.0])
    again = solve_structured(MODEL, later, 33, first, elapsed=elapsed)
    assert again.solved
    assert again.times[-1] == pytest.approx(first.times[-1] - elapsed, abs=2e-3)
    tape = np.interp(again.times + elapsed, first.times, first.knots[:, -1])
    np.testing.assert_allclose(again.knots[:, -1], tape, atol=0.1)


def test_a_wire_out_of_reach_is_told_not_found():
    unreachable = dataclasses.replace(
        PROBLEM, wire=[0.9, 0.95], duration_limits=[0.1, 0.3]
    )
    guess = straight_line(MODEL, unreachable)
    found = solve_structured(MODEL, unreachable, 9, guess)
    assert not found.solved
    assert found.status.startswith(("stuck", "out of steps"))
    with pytest.raises(PlanningError) as caught:
        plan(MODEL, unreachable, knots=(5,))
    assert [a.solver for a in caught.value.attempts] == ["interior point", "SNOPT"]


def test_a_launch_that_just_misses_is_told_by_how_much():
    """The slowest of fifty launches, from which a flight misses the wire by 21 mm."""
    launch = [-3.362, 0.117, 0.087, 0.0, 6.005, 0.0, 0.0]
    slow = dataclasses.replace(PROBLEM, launch=launch, x_limits=[-4.0, 1.0])
    with pytest.raises(
        PlanningError, match=r"violates '.*' the most, by 0\.0\d+ "
    ) as caught:
        plan(MODEL, slow, knots=(15, 25))
    assert 1e-3 < caught.value.violations[0].amount < 0.03
    faster = dataclasses.replace(slow, launch=[*launch[:4], 6.6, 0.0, 0.0])
    assert plan(MODEL, faster, knots=(15, 25)).attempts[-1].solver == "interior point"


def test_bounds_are_the_problem_s_and_the_vehicle_s():
    program = make_program(MODEL, PROBLEM, 5)
    low, high = (bounds[:-1].reshape(5, 8) for bounds in program.bounds)
    assert np.all(np.isinf(low[0, :7])) and np.all(np.isinf(high[0, :7]))
    np.testing.assert_allclose(low[1:, 3], -0.4463)
    np.testing.assert_allclose(high[:, 7], 13.0)
    np.testing.assert_allclose((low[-1, 2], high[-1, 2]), (-1.0, -np.pi / 6))
    np.testing.assert_allclose(high[-1, 4:6], 2.0)
    np.testing.assert_allclose(program.bounds[:, -1], (0.1, 0.4))


def test_a_formula_that_does_not_compile_goes_to_drake(monkeypatch):
    """A real one takes a long time to fail."""

    def refuse(*_):
        raise numba.core.errors.TypingError("a dict of mixed values")

    reference = plan(MODEL, PROBLEM, knots=(5,))
    monkeypatch.setattr(POINTS.over(), "rates_at", refuse)
    found = plan(MODEL, PROBLEM, knots=(5,))
    assert [a.solver for a in found.attempts] == ["SNOPT"]
    assert found.cost == pytest.approx(reference.cost, rel=1e-7)


def test_only_the_dynamics_are_compiled_for_other_effects():
    """The solver's own code is the same for all: compiled once, then kept on disk."""
    plan(MODEL, PROBLEM, knots=(5,))
    own = [f for m in (collocation, stages) for f in vars(m).values()]
    own = [f for f in own if hasattr(f, "signatures")]
    before = [len(f.signatures) for f in own]
    assert len(own) > 10 and max(before) == 1
    plan(LAGGING, PROBLEM, knots=(5,))
    plan(BLOWN, PROBLEM, knots=(5,))
    assert [len(f.signatures) for f in own] == before


@pytest.mark.nightly
def test_slow_launches_cannot_perch_and_plan_agrees():
    launches = [[*PROBLEM.launch[:4], v, 0.0, 0.0] for v in (4.5, 5.0, 5.5, 6.5, 7, 8)]
    found = [can_perch(MODEL, PROBLEM, launch) for launch in launches]
    assert found == [False, False, False, True, True, True]
    slow, fast = (dataclasses.replace(PROBLEM, launch=launches[k]) for k in (2, 3))
    assert plan(MODEL, fast).attempts
    with pytest.raises(PlanningError):
        plan(MODEL, slow)
    with pytest.raises(InputError, match="field 'launch'"):
        can_perch(MODEL, PROBLEM, [0.0, 0.0, 0.0])
