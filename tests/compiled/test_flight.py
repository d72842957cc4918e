"""The loop that flies gliders: its steps, tables, states that are kept."""

import numpy as np
import pytest

from glider.compiled.flight import Feedback, Steps, fly_batch, make_feedback, make_tape
from glider.compiled.runge_kutta import BLOCK
from glider.physics.effects import PROFILE_DRAG
from glider.physics.model import GliderModel
from tests.helpers.physics import random_states
from tests.helpers.second_flight import advance, rates_of

MODEL = GliderModel(effects=(PROFILE_DRAG(cd0=0.02),))
COUNT = BLOCK + 3
STEPS = Steps(8, 0.004)


def table_of_each(rng, hold):
    """A feedback of COUNT gliders, each with gains of its own."""
    rows = 2 * STEPS.number + 1 if hold == 0 else -(-STEPS.number // hold)
    offset = rng.uniform(-5.0, 5.0, (COUNT, rows))
    return Feedback(offset, rng.normal(size=(COUNT, rows, 7)), hold)


@pytest.mark.parametrize("order", [1, 4])
def test_gliders_fly_as_with_steps_of_numpy(order):
    rng = np.random.default_rng(2)
    states = random_states(COUNT)
    command = rng.uniform(-20.0, 20.0, COUNT)
    flown = fly_batch(
        MODEL,
        states,
        STEPS._replace(order=order),
        make_tape(command[:, None], STEPS.number),
    ).states
    for j in range(COUNT):
        x = states[[j]]

        def rates(y, since, j=j):
            return rates_of(MODEL, y, command[[j]])

        for k in range(STEPS.number):
            step = STEPS.length
            x = advance(rates, x, step) if order == 4 else x + step * rates(x, 0.0)
            np.testing.assert_allclose(flown[j, k + 1], x[0], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("hold", [0, 3])
def test_each_glider_follows_its_own_table(hold):
    """As it does alone."""
    states = random_states(COUNT)
    feedback = table_of_each(np.random.default_rng(3), hold)
    many = fly_batch(MODEL, states, STEPS, feedback).states
    for j in (0, BLOCK - 1, BLOCK, COUNT - 1):
        alone = feedback._replace(offset=feedback.offset[[j]], gain=feedback.gain[[j]])
        one = fly_batch(MODEL, states[[j]], STEPS, alone).states
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
