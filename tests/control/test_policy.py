"""A plan with held commands is flown as it says, with its feedback or without."""

import dataclasses
import pickle

import numpy as np
import pytest

from glider.compiled.flight import fly_tapes
from glider.control.mppi import sequence_of
from glider.control.tvlqr import sample_plan
from glider.physics.model import GliderModel
from glider.physics.state import STATE_NAMES
from glider.simulation.fly import fly
from sampling_planners import held_plan
from tests.helpers.flights import LAGGING, NOMINAL, PROBLEM
from tests.helpers.held_policy import HeldPolicy

STEP = 0.02
INPUTS = np.array([1.0, 3.0, -2.0, 0.5, -4.0])


def plan_for(model: GliderModel):
    """Returns the flight of the commands from the launch, by the compiled tapes."""
    start = model.initial_state(PROBLEM.launch)
    finely = np.repeat(INPUTS, 10)[None]
    [path] = fly_tapes(model, start[None], finely, STEP / 10)
    return held_plan(model, STEP, path[::10], INPUTS, cost=0.0)


def fly_held(model, policy, start):
    return fly(
        model, policy, start[None], command_rate=policy.command_rate, keep_paths=True
    )


def test_without_gains_the_commands_are_replayed_wherever_the_glider_is():
    plan = plan_for(NOMINAL)
    policy = HeldPolicy(plan=plan)
    assert policy.command_rate == pytest.approx(1.0 / STEP)
    assert policy.duration == pytest.approx(0.1)
    aside = plan.states[0] + [0.1, 0.2, 0.1, -0.05, -1.0, 0.5, 1.0]
    flown, astray = (fly_held(NOMINAL, policy, x) for x in (plan.states[0], aside))
    for flights in (flown, astray):
        turned = np.diff(flights.paths[0, :51:10, STATE_NAMES.index("elevator")])
        np.testing.assert_allclose(turned, STEP * INPUTS, atol=1e-12)
    np.testing.assert_allclose(flown.paths[0, :51:10], plan.states, atol=1e-12)


def test_after_the_plan_the_elevator_stands_still():
    """With gains too: nobody is followed any more."""
    policy = HeldPolicy(plan=plan_for(NOMINAL), gains=np.full((5, 7), 0.5))
    start = policy.plan.states[0] + 0.01
    flights = fly_held(NOMINAL, policy, start)
    after = flights.times > policy.duration - 1e-9
    assert flights.times[-1] == pytest.approx(policy.duration + 0.1, abs=0.0021)
    elevator = flights.paths[0, :, STATE_NAMES.index("elevator")]
    assert np.ptp(elevator[~after]) > 0.01
    elevator = elevator[after]
    np.testing.assert_allclose(elevator, elevator[0], atol=1e-12)
    offset, gain = policy.sample(np.array([0.1, 0.11, 7.0]))
    np.testing.assert_array_equal(offset, 0.0)
    np.testing.assert_array_equal(gain, 0.0)


def test_the_feedback_is_the_plans_from_the_beginning_of_each_step():
    rng = np.random.default_rng(0)
    plan = plan_for(LAGGING)
    gains = rng.normal(size=(5, 8))
    policy = HeldPolicy(plan=plan, gains=gains)
    assert policy.state_names == STATE_NAMES  # The servo's own is not measured.
    times = plan.times[:-1, None] + STEP * np.array([0.0, 0.5, 0.99])
    offset, gain = policy.sample(times.ravel())
    assert gain.shape == (15, 7)
    x = rng.normal(size=7)
    error = x - plan.states[:-1, :7]
    wanted = INPUTS + np.sum(gains[:, :7] * error, axis=1)
    np.testing.assert_allclose(offset - gain @ x, np.repeat(wanted, 3), rtol=1e-12)


def test_a_held_policy_survives_a_journey():
    policy = HeldPolicy(plan=plan_for(NOMINAL), gains=np.ones((5, 7)))
    policy.plan.state_trajectory  # noqa: B018  Cached, and on Drake 1.51 no traveller.
    again = pickle.loads(pickle.dumps(policy))
    times = np.linspace(0.0, 0.2, 30)
    for ours, theirs in zip(policy.sample(times), again.sample(times), strict=True):
        np.testing.assert_array_equal(ours, theirs)


def test_a_held_plan_is_sampled_without_ramps():
    plan = plan_for(NOMINAL)
    times = np.array([0.0, 0.019, 0.03, 0.0999, 0.1])
    states, slopes, inputs = sample_plan(plan, times)
    np.testing.assert_array_equal(inputs, INPUTS[[0, 0, 1, 4, 4]])
    np.testing.assert_allclose(states[[0, -1]], plan.states[[0, -1]], atol=1e-12)
    np.testing.assert_allclose(slopes[0], plan.slopes[0], atol=1e-12)
    np.testing.assert_array_equal(sequence_of(plan, STEP, 7), [*INPUTS, 0.0, 0.0])
    ramped = dataclasses.replace(plan, inputs=np.append(INPUTS, 0.0))
    assert sample_plan(ramped, times)[2][2] == pytest.approx(0.5)
