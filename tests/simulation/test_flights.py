"""One flight is taken out of many, and its commands turn its elevator."""

import numpy as np
import pytest

from glider.compiled.actuators import elevator_path
from glider.simulation.flown_flights import hooked
from glider.simulation.fly import fly
from tests.helpers.flights import NO_HOOK, NOMINAL, PROBLEM, QUICK, policy

STARTS = PROBLEM.draw_launches(
    4, np.random.default_rng(0), height=0.3, speed=0.5, pitch=0.15
)


def fly_with_paths(problem=NO_HOOK, **options):
    return fly(NOMINAL, policy(), STARTS, problem=problem, keep_paths=True, **options)


def test_a_flight_is_its_row_and_its_commands_turn_its_elevator():
    flights = fly_with_paths(command_rate=50.0)
    assert len(flights) == 4
    servo, times = NOMINAL.parameters.servo, flights.times
    hold = round(0.02 / times[1])
    begins = times[:-1:hold]
    offset, gain = policy().sample(begins)
    wanted = offset - np.sum(gain * flights.paths[:, :-1:hold], axis=2)
    commands = np.clip(wanted, -servo.rate, servo.rate)
    assert np.any(np.abs(wanted) > servo.rate)  # The limit was at work.
    for b in range(4):
        flight = flights.flight(b)
        np.testing.assert_array_equal(flight.states, flights.paths[b])
        np.testing.assert_array_equal(flight.times, times)
        assert flight.miss == pytest.approx(flights.miss[b], abs=1e-5)
        assert not flight.perched and not flights.perched[b]
        tape = begins, commands[b]
        start = flight.states[0, 3]
        path = elevator_path(*tape, times, servo, start=start)
        # To what a Runge-Kutta step of 2 ms makes of the law's kink.
        np.testing.assert_allclose(flight.states[:, 3], path, atol=1e-3)


@pytest.mark.parametrize("rate", [None, 50.0])
def test_a_quick_servo_perches_as_none(rate):
    near, quick = (
        fly(
            model, policy(), STARTS, command_rate=rate, problem=NO_HOOK, keep_paths=True
        )
        for model in (NOMINAL, QUICK)
    )
    assert np.max(quick.miss) < 0.3
    np.testing.assert_allclose(quick.miss, near.miss, atol=0.01)
    np.testing.assert_array_equal(quick.times, near.times)
    np.testing.assert_allclose(quick.paths[..., :2], near.paths[..., :2], atol=0.02)
    np.testing.assert_array_equal(quick.ends, quick.paths[:, -1])


@pytest.mark.parametrize("late", [-0.003, -1e-16, 0.0, 1e-16, 0.003])
def test_a_flight_ends_at_the_wire_and_its_times_stay_apart(late):
    """Where the hook takes the glider at a step, a hair off it, and between steps."""
    times = np.linspace(0.0, 0.1, 11)
    states = np.zeros((11, 7))
    states[:, 0] = 2.0 * (times - times[5] - late)
    states[:, 2], states[:, 4] = -0.8, 2.0
    flight = hooked(times, states, PROBLEM)
    assert flight.perched
    assert flight.times[-1] == pytest.approx(times[5] + late)
    assert np.all(np.diff(flight.times) > 1e-6)
    assert flight.states[-1] == pytest.approx([0.0, 0.0, -0.8, 0.0, 2.0, 0.0, 0.0])
    assert len(flight.times) == len(flight.states)


def test_a_flight_without_a_path_is_refused():
    many = fly(NOMINAL, policy(), STARTS, command_rate=50.0)
    assert many.paths is None
    with pytest.raises(ValueError, match="paths"):
        many.flight(0)
