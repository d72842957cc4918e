"""One statement of the problem, read by every planner and by the proof."""

import dataclasses
import pickle

import numpy as np
import pytest
from pydrake.solvers import SnoptSolver

from glider import perching_program, plan
from glider.errors import InputError
from glider.physics.model import GliderModel
from glider.planning.constraints import constraints_of, find_violations
from glider.planning.dircol import PlanningError
from glider.planning.path import POINTS, Path
from glider.planning.problem import Obstacle, PerchingProblem

MODEL = GliderModel()
POLE = PerchingProblem.load("perching_pole")
PIN = Obstacle(center=[-1.3, 0.06], radius=0.04)


def clearances(path, obstacle):
    """Distances of a path's dense points from an obstacle's edge."""
    x, z = np.moveaxis(path.between, -1, 0)[:2]
    radius = obstacle.radius + obstacle.clearance
    return np.hypot(x - obstacle.center[0], z - obstacle.center[1]) - radius


def path_of(found):
    return Path(MODEL, found.times, found.states, found.inputs)


def test_they_are_the_problem_s_and_the_servo_s():
    constraints = constraints_of(PerchingProblem(), MODEL.parameters.servo)
    assert [(b.name, b.low, b.high) for b in constraints.path] == [
        ("x", -3.5, 1.0),
        ("z", -1.0, 1.0),
        ("pitch", -np.pi / 2, np.pi / 2),
        ("elevator", -0.4463, 0.9473),
    ]
    assert [(b.name, b.low, b.high) for b in constraints.arrival] == [
        ("x at the wire", 0.0, 0.0),
        ("z at the wire", 0.0, 0.0),
        ("pitch at the wire", -1.0, -np.pi / 6),
        ("xdot at the wire", -2.0, 2.0),
        ("zdot at the wire", -2.0, 2.0),
    ]
    assert constraints.command.high == -constraints.command.low == 13.0


@pytest.mark.parametrize(
    ("state", "value", "words"),
    [
        ((20, 1), 1.2, "z by 0.2 m"),
        ((-1, 2), -1.5, "pitch at the wire by 0.5 rad"),
        ((-1, 0), 0.6, "x at the wire by 0.6 m"),
    ],
)
def test_what_a_path_violates_is_named_with_its_unit(article_plan, state, value, words):
    constraints = constraints_of(PerchingProblem(), MODEL.parameters.servo)
    states = article_plan.states.copy()
    states[state] = value
    path = Path(MODEL, article_plan.times, states, article_plan.inputs)
    found = find_violations(constraints, path)
    assert words in [f"{violation.name} by {violation.size}" for violation in found]
    amounts = [violation.amount for violation in found]
    assert amounts == sorted(amounts, reverse=True)
    kept = find_violations(constraints, path_of(article_plan))
    assert all(violation.amount < 1e-6 for violation in kept)


@pytest.mark.parametrize(
    ("center", "radius", "clearance"),
    [
        ((-1.75, 0.2), 0.2, 0.0),
        ((-1.75, 0.2), 0.12, 0.08),
        ((-1.0, 0.1), 0.1, 0.0),
        ((-0.5, 0.25), 0.05, 0.0),
        ((-1.3, 0.06), 0.04, 0.0),
    ],
    ids=["middle", "clearance", "late", "small", "pin"],
)
def test_a_plan_keeps_clear_of_an_obstacle_between_knots(
    article_plan, center, radius, clearance
):
    obstacle = Obstacle(center=list(center), radius=radius, clearance=clearance)
    assert clearances(path_of(article_plan), obstacle).min() < 0.0
    found = plan(MODEL, PerchingProblem(obstacles=[obstacle]))
    assert {a.solver for a in found.attempts} == {"interior point"}
    assert clearances(path_of(found), obstacle).min() > -1e-6
    assert found.cost > article_plan.cost
    assert found.max_defect < 1e-5


def test_two_obstacles_are_passed_at_once():
    below = Obstacle(center=[-1.0, -0.3], radius=0.1)
    problem = dataclasses.replace(POLE, obstacles=[*POLE.obstacles, below])
    found = plan(MODEL, problem)
    for obstacle in problem.obstacles:
        assert clearances(path_of(found), obstacle).min() > -1e-6


def test_an_obstacle_that_is_not_in_the_way_changes_nothing(article_plan):
    far = Obstacle(center=[-1.0, -0.7], radius=0.1)
    found = plan(MODEL, PerchingProblem(obstacles=[far]))
    assert found.cost == pytest.approx(article_plan.cost, abs=1e-6)
    np.testing.assert_allclose(found.states, article_plan.states, atol=1e-4)


def test_an_obstacle_close_to_the_launch_is_avoided():
    """The plan without it passes 0.1 mm inside, between the launch and a middle."""
    near = Obstacle(center=[-3.42305, 0.06952], radius=0.03)
    found = plan(MODEL, PerchingProblem(obstacles=[near]), knots=(25,))
    assert [attempt.solver for attempt in found.attempts] == ["interior point"]
    assert clearances(path_of(found), near).min() > -1e-6


def test_an_obstacle_that_cannot_be_avoided_is_named():
    """A wall across the whole height."""
    wall = Obstacle(center=[-1.75, 0.0], radius=1.2)
    problem = PerchingProblem(obstacles=[wall])
    with pytest.raises(PlanningError, match="'clearance of the obstacle' the most, by"):
        plan(MODEL, problem, knots=(15,))


def test_drake_s_program_has_the_obstacle_too(article_plan):
    [pole] = POLE.obstacles
    pole = dataclasses.replace(pole, clearance=0.0)
    problem = dataclasses.replace(POLE, obstacles=[pole])
    dc = perching_program(MODEL, problem, knots=21)
    result = SnoptSolver().Solve(dc.prog())
    assert result.is_success()
    own = plan(MODEL, problem, knots=(21,))
    assert result.get_optimal_cost() == pytest.approx(own.cost, rel=0.02)
    times = dc.GetSampleTimes(result)
    states = dc.GetStateSamples(result).T
    path = Path(MODEL, times, states, dc.GetInputSamples(result)[0])
    x, z = path.between[[0, POINTS // 2]].T[:2]
    distances = np.hypot(x - pole.center[0], z - pole.center[1])
    assert distances.min() > pole.radius - 1e-5


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{center: [-1.0], radius: 0.1}", ("'obstacles[0].center'", "2 finite")),
        ("{center: [-1.0, 0.0], radius: 0.0}", ("'obstacles[0].radius'", "positive")),
        (
            "{center: [-1.0, 0.0], radius: 0.1, clearance: -0.1}",
            ("'obstacles[0].clearance'", "not negative"),
        ),
        ("{center: [0.1, 0.0], radius: 0.2}", ("'obstacles[0].center'", "the wire")),
        ("{center: [-1.0, 0.0]}", ("radius",)),
    ],
)
def test_an_obstacle_that_cannot_be_is_refused(tmp_path, text, words):
    path = tmp_path / "odd.yaml"
    path.write_text(f"obstacles: [{text}]\n")
    with pytest.raises(InputError) as caught:
        PerchingProblem.load(path)
    for word in ("odd.yaml", *words):
        assert word in str(caught.value)


@pytest.mark.parametrize(
    ("obstacles", "words"),
    [
        (None, "'obstacles' is None; expected a list of Obstacle"),
        (PIN, "'obstacles' is Obstacle.*; expected a list of Obstacle"),
        ([{"center": [-1.0, 0.0], "radius": 0.1}], r"'obstacles\[0\]' is {center: "),
        ([PIN, None], r"'obstacles\[1\]' is None; expected an Obstacle"),
        ([dataclasses.replace(PIN, center=5)], r"center' is 5; expected 2 finite"),
        ([dataclasses.replace(PIN, center=None)], r"center' is None; expected 2"),
        ([dataclasses.replace(PIN, center="ab")], r"center' is 'ab'; expected 2"),
        ([dataclasses.replace(PIN, radius=None)], r"radius' is None; expected a pos"),
    ],
)
def test_what_is_no_obstacle_is_refused_in_python_too(obstacles, words):
    with pytest.raises(InputError, match=words):
        PerchingProblem(obstacles=obstacles)


def test_constraints_pickle():
    again = pickle.loads(pickle.dumps(constraints_of(POLE, MODEL.parameters.servo)))
    state = MODEL.initial_state(POLE.launch)
    [inequality] = constraints_of(POLE).inequalities
    assert again.inequalities[0].formula(state) == inequality.formula(state)


def test_a_path_that_is_not_finite_violates_most(article_plan):
    constraints = constraints_of(POLE, MODEL.parameters.servo)
    states = article_plan.states.copy()
    states[20, 1] = np.nan
    path = Path(MODEL, article_plan.times, states, article_plan.inputs)
    found = find_violations(constraints, path)
    infinite = {v.name for v in found if v.amount == np.inf}
    assert {"z", "clearance of the obstacle", "dynamics of z"} <= infinite
    assert found[0].amount == np.inf


def test_a_launch_in_an_obstacle_is_refused():
    obstacle = Obstacle(center=[-3.4, 0.1], radius=0.2)
    with pytest.raises(InputError, match="the launch's clearance of the obstacle is"):
        plan(MODEL, PerchingProblem(obstacles=[obstacle]))
