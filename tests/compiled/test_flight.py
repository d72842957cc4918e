"""The loop that flies gliders: tables, gliders that differ, states that are kept."""

import numpy as np
import pytest

from glider.compiled.flight import Feedback, Steps, fly_batch, make_feedback, make_tape
from glider.compiled.runge_kutta import BLOCK
from glider.physics.confidence import glider_at, numbers_at
from glider.physics.effects import PROFILE_DRAG
from glider.physics.model import GliderModel
from tests.helpers.physics import random_states
from tests.helpers.second_flight import advance, rates_of

MODEL = GliderModel(effects=(PROFILE_DRAG(cd0=0.02),))
NAMES = ("mass", "profile_drag.cd0")
COUNT = BLOCK + 3
STEPS = Steps(8, 0.004)


@pytest.fixture(scope="module")
def deviations():
    rng = np.random.default_rng(1)
    return rng.uniform(-1.0, 1.0, (COUNT, 2)) * [0.02, 0.01]


def table_of_each(rng, hold):
    """A feedback of COUNT gliders, each with gains of its own."""
    rows = 2 * STEPS.number + 1 if hold == 0 else -(-STEPS.number // hold)
    offset = rng.uniform(-5.0, 5.0, (COUNT, rows))
    return Feedback(offset, rng.normal(size=(COUNT, rows, 7)), hold)


@pytest.mark.parametrize("order", [1, 4])
def test_gliders_that_differ_fly_in_their_own_wind_and_time(deviations, order):
    """Against NumPy's steps, and with the numbers of each."""
    rng = np.random.default_rng(2)
    states = random_states(COUNT)
    command = rng.uniform(-20.0, 20.0, COUNT)
    wind = rng.normal(size=(COUNT, 2))
    pace = rng.uniform(0.0, 2.0, COUNT)
    flown = fly_batch(
        MODEL,
        states,
        STEPS._replace(order=order),
        make_tape(command[:, None], STEPS.number),
        numbers=numbers_at(MODEL, NAMES, deviations),
        wind=wind,
        pace=pace,
    ).states
    for j in range(COUNT):
        own = glider_at(MODEL, NAMES, deviations[j])
        x = states[[j]]

        def rates(y, since, own=own, j=j):
            return rates_of(own, y, command[[j]], wind[[j]])

        for k in range(STEPS.number):
            step = pace[j] * STEPS.length
            x = advance(rates, x, step) if order == 4 else x + step * rates(x, 0.0)
            np.testing.assert_allclose(flown[j, k + 1], x[0], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("hold", [0, 3])
@pytest.mark.parametrize("differs", [False, True])
def test_each_glider_follows_its_own_table(deviations, hold, differs):
    """As it does alone."""
    states = random_states(COUNT)
    feedback = table_of_each(np.random.default_rng(3), hold)
    numbers = numbers_at(MODEL, NAMES, deviations) if differs else None
    many = fly_batch(MODEL, states, STEPS, feedback, numbers=numbers).states
    for j in (0, BLOCK - 1, BLOCK, COUNT - 1):
        model = glider_at(MODEL, NAMES, deviations[j]) if differs else MODEL
        alone = feedback._replace(offset=feedback.offset[[j]], gain=feedback.gain[[j]])
        one = fly_batch(model, states[[j]], STEPS, alone).states
        np.testing.assert_allclose(many[j], one[0], rtol=1e-9, atol=1e-9)
    assert np.ptp(many[:, -1, 3]) > 0.05


def test_one_launch_flies_under_many_tapes():
    state = random_states(1)
    tape = make_tape(np.linspace(-9.0, 9.0, COUNT)[:, None], STEPS.number)
    many = fly_batch(MODEL, state, STEPS, tape).states
    each = fly_batch(MODEL, np.repeat(state, COUNT, axis=0), STEPS, tape).states
    np.testing.assert_array_equal(many, each)
    assert len(many) == COUNT


def test_states_are_kept_after_every_so_many_steps():
    states = random_states(3)
    feedback = make_feedback(lambda t: (np.sin(40.0 * t), np.ones((len(t), 7))), STEPS)
    every = fly_batch(MODEL, states, STEPS, feedback).states
    for kept in (2, 3, STEPS.number):
        some = fly_batch(MODEL, states, STEPS._replace(every=kept), feedback).states
        np.testing.assert_array_equal(some, every[:, ::kept])
