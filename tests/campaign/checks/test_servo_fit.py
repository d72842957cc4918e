"""A servo is found in measured elevators, and so is what no servo explains."""

import dataclasses

import numpy as np
import pytest

from glider.campaign.checks.masks import masks_of
from glider.campaign.checks.servo import command_tape
from glider.campaign.checks.servo_fit import identify_servo
from glider.compiled.actuators import elevator_path
from glider.physics.servo import Servo
from tests.helpers.tasks import fly

NOISE = 0.004  # Of the measured angle [rad].


@pytest.fixture(scope="module")
def campaign():
    return fly(flights=8)


def moved(campaign, path):
    """Returns the campaign with elevators of other servos, and their true angles.

    `path` takes the times of a command tape, its commands, and times of rows.
    """
    rng = np.random.default_rng(7)
    flights = []
    true = []
    for flight in campaign.flights:
        tape = command_tape(flight, masks_of(flight, {}), campaign.switch_rate)
        angle = path(tape.switches, tape.commands, flight.time)
        true.append(angle)
        noisy = angle + NOISE * rng.standard_normal(len(angle))
        flights.append(dataclasses.replace(flight, elevator=noisy))
    return dataclasses.replace(campaign, flights=tuple(flights)), true


def follow(limits, **servo):
    """Returns the path of a servo with limits."""

    def path(switches, commands, time):
        return elevator_path(switches, commands, time, limits, **servo)

    return path


@pytest.mark.parametrize(
    "servo",
    [
        {},
        {"time_constant": 0.04},
        {"delay": 0.02},
        {"delay": 0.01, "time_constant": 0.02},
    ],
    ids=["as specified", "lag", "delay", "both"],
)
def test_effects_of_a_servo_are_left_to_be_traced(campaign, servo):
    own, _ = moved(campaign, follow(campaign.limits, **servo))
    assert identify_servo(own, {}) == (own, ())


def test_a_stop_that_is_nearer_is_found(campaign):
    low, high, rate = campaign.limits
    high = 0.6 * max(f.elevator.max() for f in campaign.flights)
    own, _ = moved(campaign, follow(Servo(low, high, rate)))
    found, [words] = identify_servo(own, {})
    assert found.elevator_limits == (low, pytest.approx(high, abs=0.003))
    assert found.elevator_rate_limit == rate
    assert f"and {found.limits.high:.3g} rad and turns by {rate:.3g} rad/s" in words
    assert all(flight.departure is None for flight in found.flights)


def test_a_stop_that_nobody_specified_is_used(campaign):
    high = 0.6 * max(f.elevator.max() for f in campaign.flights)
    told = dataclasses.replace(campaign, elevator_limits=None)
    own, _ = moved(told, follow(campaign.limits._replace(low=-np.inf, high=high)))
    found, [words] = identify_servo(own, {})
    assert "its own limits are used" in words
    assert found.limits.high == pytest.approx(high, abs=0.003)


def test_a_stop_that_is_farther_is_found(campaign):
    reached = max(f.elevator.max() for f in campaign.flights)
    narrow = (campaign.elevator_limits[0], 0.6 * reached)
    told = dataclasses.replace(campaign, elevator_limits=narrow)
    own, _ = moved(told, follow(campaign.limits))
    found, [words] = identify_servo(own, {})
    assert found.limits.high > reached - 0.02
    assert "its own limits are used" in words


def test_a_slower_servo_is_found(campaign):
    fastest = max(np.abs(f.command).max() for f in campaign.flights)
    limits = campaign.limits._replace(rate=0.5 * fastest)
    own, _ = moved(campaign, follow(limits))
    found, [words] = identify_servo(own, {})
    assert found.elevator_rate_limit == pytest.approx(limits.rate, rel=0.02)
    assert found.elevator_limits == campaign.elevator_limits
    assert "rad/s at most" in words


def lose(limits, share=0.04):
    """Returns the path behind commands of which the log lacks some."""
    rng = np.random.default_rng(3)

    def path(switches, commands, time):
        given = commands + 5.0 * (rng.random(len(commands)) < share)
        return elevator_path(switches, given, time, limits)

    return path


def lag_upward(switches, commands, time):
    """Lags by 50 ms where the elevator turns faster upward, else by 5 ms."""
    step = 2.5e-4
    fine = np.arange(time[0], time[-1] + step, step)
    held = np.searchsorted(switches, fine, side="right") - 1
    angle = np.zeros(len(fine))
    rate = 0.0
    for k, command in enumerate(commands[np.clip(held, 0, None)][:-1]):
        lag = 0.05 if command > rate else 0.005
        rate += (command - rate) * step / lag
        angle[k + 1] = angle[k] + rate * step
    return np.interp(time, fine, angle)


def test_lost_commands_are_a_departure(campaign):
    own, true = moved(campaign, lose(campaign.limits))
    found, [words] = identify_servo(own, {})
    assert "departs from its commands" in words
    errors = []
    stds = set()
    for flight, angle in zip(found.flights, true, strict=True):
        if flight.departure is None:  # It lost none.
            continue
        stds.add(flight.departure.std)
        tape = command_tape(flight, masks_of(flight, {}), campaign.switch_rate)
        path = elevator_path(
            tape.switches,
            tape.commands,
            flight.time,
            campaign.limits,
            start=flight.departure.rest,
        )
        errors.append(path + flight.departure.angle - angle)
    [std] = stds
    assert 0.6 * std < np.sqrt(np.mean(np.square(errors))) < 1.1 * std < 1.5 * NOISE


def test_a_lag_of_one_way_is_a_departure(campaign):
    own, _ = moved(campaign, lag_upward)
    found, [words] = identify_servo(own, {})
    assert "departs from its commands" in words
    for flight in found.flights:
        assert np.std(flight.departure.angle) > 2.0 * NOISE


def test_one_odd_flight_leaves_the_others_alone(campaign):
    own, _ = moved(campaign, follow(campaign.limits))
    first, *others = own.flights
    off = first.elevator + 0.03 * (first.time > 0.3)
    flights = (dataclasses.replace(first, elevator=off), *others)
    found, [words] = identify_servo(dataclasses.replace(own, flights=flights), {})
    assert f"in {first.name}" in words
    assert [flight.departure is None for flight in found.flights] == [
        False,
        *[True] * 7,
    ]


def test_angles_that_were_not_measured_show_no_servo(campaign):
    own, _ = moved(campaign, lose(campaign.limits))
    for log in ({"angle": "reconstructed"}, {"command": "reconstructed"}):
        told = dataclasses.replace(own, servo=dataclasses.replace(own.servo, **log))
        assert identify_servo(told, {}) == (told, ())
