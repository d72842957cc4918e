"""Sampling again at each command: commands follow from the seed and are held."""

import dataclasses

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from glider.control.mppi import SETTINGS, replanning_cost, shifted
from glider.physics.model import GliderModel
from glider.planning.problem import PerchingProblem
from glider.planning.sampling import mppi_step
from glider.systems.mppi import MppiController

REPLANNING = PerchingProblem.load("replanning")
LAUNCH = np.array(REPLANNING.launch)
FEW = dataclasses.replace(SETTINGS, samples=40)


def small_controller(seed=0):
    return MppiController(GliderModel(), REPLANNING, steps=20, settings=FEW, seed=seed)


def held_at_first(sequence):
    """Returns the state of a controller whose first update has shifted a sequence."""
    return np.concatenate([[0.0], sequence[:-1], [0.0]])


def outputs_of(controller, state, times, sequence=None):
    simulator = Simulator(controller)
    context = simulator.get_mutable_context()
    controller.GetInputPort("state").FixValue(context, state)
    if sequence is not None:
        context.SetDiscreteState(held_at_first(sequence))
    found = []
    for time in times:
        simulator.AdvanceTo(time)
        context = simulator.get_context()
        found.append(controller.GetOutputPort("elevator_rate").Eval(context)[0])
    return np.array(found)


def test_commands_follow_from_the_seed_and_are_held():
    times = [0.001, 0.015, 0.021, 0.039, 0.041]
    first = outputs_of(small_controller(), LAUNCH, times)
    np.testing.assert_array_equal(first[[0, 2]], first[[1, 3]])
    assert len(np.unique(first)) == 3
    np.testing.assert_array_equal(outputs_of(small_controller(), LAUNCH, times), first)
    assert not np.any(outputs_of(small_controller(seed=1), LAUNCH, times) == first)


def test_the_first_command_is_that_of_one_step_of_mppi():
    """From the measured state, about the sequence that was given."""
    sequence = np.linspace(1.0, 2.0, 20)
    cost = replanning_cost(GliderModel(), REPLANNING, steps=20)
    state = LAUNCH + np.array([0.5, -0.1, 0.1, 0.2, -1.0, 0.3, 0.5])
    rng = np.random.default_rng([0, 0])
    expected, _, _ = mppi_step(cost, state, sequence, rng, FEW)
    [found] = outputs_of(small_controller(), state, [0.001], sequence)
    assert found == expected[0]
    rng = np.random.default_rng([0, 1])
    expected, _, _ = mppi_step(cost, state, shifted(expected), rng, FEW)
    [found] = outputs_of(small_controller(), state, [0.021], sequence)
    assert found == expected[0]


def test_the_first_commands_are_those_of_a_plan(article_plan):
    controller = MppiController(GliderModel(), REPLANNING, article_plan)
    held = controller.CreateDefaultContext().get_discrete_state_vector().CopyToVector()
    middle = article_plan.input_trajectory.value(0.03)[0, 0]
    assert held[2] == pytest.approx(middle)


def test_a_later_start_begins_with_the_command_of_that_time():
    sequence = np.arange(1.0, 81.0)
    controller = MppiController(GliderModel(), REPLANNING, steps=len(sequence))
    for k in range(len(sequence)):
        context = controller.CreateDefaultContext()
        context.SetDiscreteState(held_at_first(sequence))
        context.SetTime(0.02 * k)
        controller.ExecuteInitializationEvents(context)
        held = context.get_discrete_state_vector().CopyToVector()[:-1]
        assert shifted(held)[0] == (k + 1.0 if k < len(sequence) - 1 else 0.0)
