"""One statement of the problem, read by every planner and by the proof."""

import numpy as np
import pytest

from glider.physics.model import GliderModel
from glider.planning.constraints import constraints_of, find_violations
from glider.planning.path import Path
from glider.planning.problem import PerchingProblem

MODEL = GliderModel()


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


def test_a_path_that_is_not_finite_violates_most(article_plan):
    constraints = constraints_of(PerchingProblem(), MODEL.parameters.servo)
    states = article_plan.states.copy()
    states[20, 1] = np.nan
    path = Path(MODEL, article_plan.times, states, article_plan.inputs)
    found = find_violations(constraints, path)
    infinite = {v.name for v in found if v.amount == np.inf}
    assert {"z", "dynamics of z"} <= infinite
    assert found[0].amount == np.inf
