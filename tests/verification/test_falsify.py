"""Flights do not leave the shipped funnels, and leave those that promise too much."""

import dataclasses

import numpy as np
import pytest

from glider.errors import InputError
from glider.physics.effects import DYNAMIC_STALL, SERVO_LAG
from glider.physics.model import GliderModel
from glider.verification.funnel.funnel import load_funnel
from glider.verification.proof.interval_proof import prove_interval
from glider.verification.trials import (
    ESCAPE_LEVEL,
    boundary_states,
    falsify_funnel,
    fly_inside,
)
from tests.helpers.funnels import UNPROVEN
from tests.verification.points import sphere_points


def test_no_flight_from_the_boundary_leaves_the_funnel(funnel):
    levels = falsify_funnel(funnel, 400, np.random.default_rng(0))
    assert levels.shape == (400,)
    assert levels.max() <= 1.0 + 1e-6


def test_flights_leave_a_funnel_that_promises_too_much(funnel):
    """Three times as wide, it asks for more than the servo can do."""
    wide = dataclasses.replace(funnel, S=funnel.S / 9.0, slopes=funnel.slopes / 9.0)
    levels = falsify_funnel(wide, 400, np.random.default_rng(0))
    assert np.sum(levels > ESCAPE_LEVEL) > 20


def test_without_the_servos_limits_in_it_a_funnel_does_not_hold():
    """It was made for a servo of wider travel and a higher rate."""
    funnel = load_funnel(UNPROVEN / "strong_servo.npz")
    own = falsify_funnel(funnel, 200, np.random.default_rng(2))
    assert own.max() <= ESCAPE_LEVEL
    nominal = GliderModel()
    real = falsify_funnel(funnel, 4000, np.random.default_rng(2), model=nominal)
    assert np.sum(real > ESCAPE_LEVEL) > 4
    flight = dataclasses.replace(funnel.nominal, model=nominal)
    limited = dataclasses.replace(funnel, nominal=flight)
    assert "servo" in prove_interval(limited.between(100, 101), remainder=False).fault


def test_flights_from_inside_end_in_the_goal(funnel):
    paths = fly_inside(funnel, 20, np.random.default_rng(2))
    levels = funnel.level(funnel.nominal.times, paths)
    assert np.all(levels <= 1.0)
    goal = np.array(funnel.settings.goal)
    ends = paths[:, -1] - funnel.nominal.states[-1]
    assert np.all(np.sum((ends / goal) ** 2, axis=1) <= 1.0)


def test_boundary_states_are_on_the_boundary(funnel):
    states = boundary_states(funnel, 40, sphere_points(10, 7))
    assert funnel.level(funnel.nominal.times[40], states) == pytest.approx(1.0)


def pad(array, width=0.0):
    """Returns arrays (T, n) or (T, n, n) with another row and column, of zeros."""
    grown = np.pad(array, [(0, 0)] + [(0, 1)] * (array.ndim - 1))
    if array.ndim == 3:
        grown[:, -1, -1] = width
    return grown


@pytest.mark.parametrize("effects", [(), (DYNAMIC_STALL(time_constant=0.05),)])
def test_a_glider_without_the_funnels_states_is_refused(funnel, effects):
    """It would be fed back another state, or none."""
    lagging = GliderModel(effects=(SERVO_LAG(time_constant=0.03),))
    nominal = funnel.nominal
    flight = dataclasses.replace(
        nominal,
        model=lagging,
        states=lagging.initial_state(nominal.states.T).T,
        gains=pad(nominal.gains),
        bends=pad(nominal.bends),
    )
    larger = dataclasses.replace(
        funnel, nominal=flight, S=pad(funnel.S, 1.0), slopes=pad(funnel.slopes)
    )
    rng = np.random.default_rng(0)
    assert falsify_funnel(larger, 8, rng).size == 8
    with pytest.raises(InputError, match=r"glider's states is .*\.servo_rate first"):
        falsify_funnel(larger, 8, rng, model=GliderModel(effects=effects))
