"""A goal for the hook holds only states that the hook takes, and nearly all it may."""

import dataclasses

import numpy as np
import pytest

from glider.errors import InputError
from glider.paths import models_path
from glider.planning.problem import Hook, PerchingProblem
from glider.verification.funnel.funnel import load_funnel
from glider.verification.funnel.settings import hook_goal
from glider.verification.proof.purpose import hook_faults
from tests.verification.points import sphere_points

AXES = (0.9, 0.9, 0.9, 0.39, 9.0, 9.0, 2.0)
PROBLEM = PerchingProblem(wire=[0.1, -0.2], hook=Hook(reach=0.04, speed_limit=3.0))
END = np.array([0.11, -0.19, -0.8, 0.3, 0.5, -1.6, 2.0])


@pytest.fixture(scope="module")
def held():
    return load_funnel(models_path("funnels", "head_wind_hook.npz"))


def takes(problem, states):
    miss = np.linalg.norm(states[:, :2] - problem.wire, axis=1)
    return problem.hook.takes(miss, states)


def test_the_hook_takes_every_state_of_its_goal():
    goal = np.array(hook_goal(AXES, END, PROBLEM))
    assert np.all(takes(PROBLEM, END + sphere_points(20000, 7) * goal))
    assert tuple(goal[[3, 6]]) == (0.39, 2.0)


@pytest.mark.parametrize(
    ("axes", "toward"),
    [([0, 1], END[:2] - PROBLEM.wire), ([4, 5], END[4:6]), ([2], np.array([-1.0]))],
)
def test_a_goal_that_is_wider_in_any_way_is_too_wide(axes, toward):
    """At the worst point: straight away from the wire, faster, steeper."""
    goal = np.array(hook_goal(AXES, END, PROBLEM))
    worst = np.zeros(7)
    worst[axes] = toward / np.linalg.norm(toward)
    assert takes(PROBLEM, (END + worst * goal)[None])[0]
    assert not takes(PROBLEM, (END + worst * 1.001 * goal)[None])[0]


@pytest.mark.parametrize(
    ("state", "value", "words"),
    [
        (0, 0.2, "distance from the wire of 0.1005"),
        (4, 3.0, "speed of 3.4"),
        (2, -0.3, "pitch of -0.3"),
        (2, -1.2, "pitch of -1.2"),
    ],
)
def test_there_is_none_where_the_hook_does_not_take_the_end(state, value, words):
    end = END.copy()
    end[state] = value
    with pytest.raises(InputError, match=words):
        hook_goal(AXES, end, PROBLEM)


def test_the_problem_of_the_hook_ends_in_the_middle_of_its_pitches():
    problem = PerchingProblem.load(models_path("problems", "perching_hook.yaml"))
    assert sum(problem.final_pitch_limits) == pytest.approx(
        sum(problem.hook.pitch_limits)
    )
    article = dataclasses.asdict(PerchingProblem())
    differs = {k for k, v in dataclasses.asdict(problem).items() if v != article[k]}
    assert differs == {"final_pitch_limits", "final_speed_limit"}


@pytest.mark.parametrize(
    ("name", "height"),
    [
        ("drawn_hook.npz", 0.17),
        ("head_wind_hook.npz", 0.13),
        ("wide_hook.npz", 0.19),
        ("held_head_wind_95_hook.npz", 0.14),
    ],
)
def test_the_hook_takes_the_last_set_of_the_funnels_that_ship(name, height):
    held = load_funnel(models_path("funnels", name))
    assert held.half_widths()[1] > height
    assert hook_faults(held, PerchingProblem()) == []
    spread = np.linalg.cholesky(np.linalg.inv(held.S[-1]))
    states = held.nominal.states[-1] + sphere_points(20000, 7) @ spread.T
    assert np.all(takes(PerchingProblem(), states))


@pytest.mark.parametrize(
    ("hook", "words"),
    [
        (Hook(reach=0.049), "0.049"),
        (Hook(speed_limit=2.7), "speed = 2.8 m/s; the hook accepts 0 to 2.7"),
        (
            Hook(pitch_limits=[-1.1, -0.35]),
            "pitch = -1.17 rad; the hook accepts -1.1 to",
        ),
        (
            Hook(pitch_limits=[-1.17, -0.6]),
            "pitch = -0.530001 rad; the hook accepts -1.17 to",
        ),
    ],
)
def test_what_a_hook_does_not_take_is_said(held, hook, words):
    (fault,) = hook_faults(held, PerchingProblem(hook=hook))
    assert words in fault
