"""A servo is found in measured elevators, and so is what no servo explains."""

import dataclasses
import re
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.bench_servo import FAULTS, simulate
from glider.campaign.checks.masks import masks_of
from glider.campaign.checks.servo import (
    CommandTape,
    Elevator,
    LateServo,
    command_tape,
    measure_elevators,
)
from glider.campaign.checks.servo_fit import identify_servo
from glider.campaign.checks.servo_forms import least_step, with_loads
from glider.compiled.actuators import elevator_path
from glider.physics.parameters import GliderParameters
from glider.physics.servo import Servo
from glider.report.wording import headline
from glider.sysid.pipeline import close_the_loop
from tests.helpers.tasks import fly

NOISE = 0.004  # Of the measured angle [rad].
LIMITS = GliderParameters().servo


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
    assert identify_servo(own, {}) == (own, (), None)


def test_a_stop_that_is_nearer_is_found(campaign):
    low, high, rate = campaign.limits
    high = 0.6 * max(f.elevator.max() for f in campaign.flights)
    own, _ = moved(campaign, follow(Servo(low, high, rate)))
    found, [words], _ = identify_servo(own, {})
    assert found.elevator_limits == (low, pytest.approx(high, abs=0.003))
    assert found.elevator_rate_limit == rate
    assert f"and {found.limits.high:.3g} rad and turns by {rate:.3g} rad/s" in words
    assert all(flight.departure is None for flight in found.flights)


def test_a_stop_that_nobody_specified_is_used(campaign):
    high = 0.6 * max(f.elevator.max() for f in campaign.flights)
    told = dataclasses.replace(campaign, elevator_limits=None)
    own, _ = moved(told, follow(campaign.limits._replace(low=-np.inf, high=high)))
    found, [words], _ = identify_servo(own, {})
    assert "its own limits are used" in words
    assert found.limits.high == pytest.approx(high, abs=0.003)


def test_a_stop_that_is_farther_is_found(campaign):
    reached = max(f.elevator.max() for f in campaign.flights)
    narrow = (campaign.elevator_limits[0], 0.6 * reached)
    told = dataclasses.replace(campaign, elevator_limits=narrow)
    own, _ = moved(told, follow(campaign.limits))
    found, [words], _ = identify_servo(own, {})
    assert found.limits.high > reached - 0.02
    assert "its own limits are used" in words


def test_a_slower_servo_is_found(campaign):
    fastest = max(np.abs(f.command).max() for f in campaign.flights)
    limits = campaign.limits._replace(rate=0.5 * fastest)
    own, _ = moved(campaign, follow(limits))
    found, [words], _ = identify_servo(own, {})
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


def test_lost_commands_are_a_departure(campaign):
    own, true = moved(campaign, lose(campaign.limits))
    found, [words], _ = identify_servo(own, {})
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


def uneven(**numbers):
    """Returns the path of a servo that is not even."""
    servo = LateServo(*LIMITS, **numbers)

    def path(switches, commands, time):
        tape = CommandTape(switches, commands, 0.0)
        return Elevator("", time, np.arange(len(time)), time, tape).follow(time, servo)

    return path


def hold_others(switches, commands, time):
    """Holds the command before, once in twenty times."""
    lost = np.zeros(len(commands), bool)
    lost[5::20] = True
    return elevator_path(switches, np.where(lost, np.roll(commands, 1), commands), time)


def round_commands(step):
    def path(switches, commands, time):
        return elevator_path(switches, step * np.round(commands / step), time, LIMITS)

    return path


@pytest.mark.parametrize(
    ("path", "words", "number", "error"),
    [
        (uneven(lag=0.028, skew=0.786), r"lags by ([\d.]+) ms turning up", 50.0, 2.0),
        (uneven(play=0.02), r"free play of ([\d.]+) ± [\d.]+ rad", 0.02, 0.002),
        (uneven(lag=0.02, slew=3.0), r"by ([\d.]+) ± [\d.]+ rad/s at most", 3.0, 0.1),
        (hold_others, r"loses about ([\d.]+) % of its commands", 4.7, 2.0),
        (round_commands(1.0), r"in steps of ([\d.]+) rad/s", 1.0, 0.01),
    ],
    ids=["one way", "play", "slew", "lost", "rounded"],
)
def test_what_makes_a_servo_uneven_is_named(campaign, path, words, number, error):
    own, true = moved(campaign, path)
    found, [sentence], change = identify_servo(own, {})
    assert change is None
    assert sentence.startswith("The servo ")
    [value] = re.findall(words, sentence)
    assert float(value) == pytest.approx(number, abs=error)
    for flight, angle in zip(found.flights, true, strict=True):
        departure = flight.departure
        assert departure.is_named
        assert departure.std < NOISE
        if "turning" in words:  # From a servo of a mean lag, which is yet to be traced.
            continue
        tape = command_tape(flight, masks_of(flight, {}), campaign.switch_rate)
        lag = 0.02 if "at most" in words else 0.0
        given = tape.switches, tape.commands, flight.time, LIMITS
        path = elevator_path(*given, start=departure.rest, time_constant=lag)
        assert np.std(path + departure.angle - angle) < 3.0 * departure.std


def swapped(campaign, before, since, at=4):
    """Returns the campaign with another servo from a flight on, by their numbers."""
    paths = [moved(campaign, path)[0].flights for path in (before, since)]
    flights = [
        dataclasses.replace(paths[i >= at][i], name=f"flight_{7 + i}.csv")
        for i in range(len(campaign.flights))
    ]
    flights.sort(key=lambda flight: flight.name)  # 10 comes before 7.
    return dataclasses.replace(campaign, flights=tuple(flights))


@pytest.mark.parametrize(
    ("since", "name", "old", "new"),
    [
        (follow(LIMITS._replace(high=0.3)), "upper stop", LIMITS.high, 0.3),
        (follow(LIMITS._replace(low=-0.1)), "lower stop", LIMITS.low, -0.1),
        (follow(LIMITS._replace(rate=5.0)), "rate limit", LIMITS.rate, 5.0),
        (follow(LIMITS, delay=0.02), "delay", 0.0, 0.02),
        (follow(LIMITS, time_constant=0.03), "lag", 0.0, 0.03),
        (follow(LIMITS._replace(high=0.6), time_constant=0.05), "lag", 0.0, 0.05),
    ],
    ids=["stop", "lower stop", "rate", "delay", "lag", "lag and stop"],
)
def test_a_servo_that_changes_is_dated(campaign, since, name, old, new):
    session = swapped(campaign, follow(LIMITS), since)
    found, _, change = identify_servo(session, {})
    assert (change.kind, change.coefficient) == ("servo", name)
    later = change.before + change.value
    assert change.before == pytest.approx(old, abs=0.002)
    assert later == pytest.approx(new, rel=0.03, abs=0.002)
    assert change.sentence == (
        f"At flight_11.csv the servo changes: its {name} is {later:.3f} {change.unit}, "
        f"before {change.before:z.3f} {change.unit}."
    )
    unlimited = dataclasses.replace(change, before=np.inf)
    assert unlimited.sentence.endswith("before not reached.")
    # Where either side has too few flights, all are replayed as they were measured.
    assert any(flight.departure is not None for flight in found.flights)


def test_a_limit_of_all_flights_is_no_change(campaign):
    """The flights before show no stop, as they are commanded less."""
    limits = LIMITS._replace(high=0.3)
    flights = [
        dataclasses.replace(f, command=0.2 * f.command) for f in campaign.flights[:4]
    ]
    mild = dataclasses.replace(campaign, flights=(*flights, *campaign.flights[4:]))
    session = swapped(mild, follow(limits), follow(limits, time_constant=0.03))
    _, _, change = identify_servo(session, {})
    assert (change.coefficient, change.flight) == ("lag", "flight_11.csv")


def test_a_limit_that_explains_all_flights_is_no_change():
    """The fit to all of them misses it, that to the first three finds it."""
    own = simulate(FAULTS["rate limit"], 41, 6).campaign
    _, _, change = identify_servo(own, {})
    assert change is None


@pytest.mark.parametrize("at", [1, 7])
def test_a_single_flight_with_another_servo_is_no_change(campaign, at):
    servos = [follow(LIMITS), follow(LIMITS, time_constant=0.04)]
    first, then = servos if at == 7 else servos[::-1]
    _, _, change = identify_servo(swapped(campaign, first, then, at), {})
    assert change is None


@pytest.mark.parametrize(
    "since", [hold_others, uneven(play=0.03), uneven(lag=0.03, skew=0.8)]
)
def test_a_servo_that_becomes_uneven_has_no_plain_one_since_then(campaign, since):
    session = swapped(campaign, follow(LIMITS), since)
    _, [sentence], change = identify_servo(session, {})
    assert change is None
    assert "departs from its commands" in sentence


@pytest.mark.parametrize("number", ["lag_by_load", "rate_by_load"])
def test_a_servo_that_weakens_under_load_is_named(campaign, number):
    own = campaign
    servo = {
        "lag_by_load": LateServo(*LIMITS, lag=0.01, lag_by_load=0.05),
        "rate_by_load": LateServo(*LIMITS._replace(rate=6.0), rate_by_load=0.7),
    }[number]

    def path(switches, commands, time):
        tape = CommandTape(switches, commands, 0.0)
        rows = np.arange(len(time))
        return Elevator("", time, rows, time, tape, next(loads)).follow(time, servo)

    for _ in range(4):  # The load is that of the elevator as it turns.
        elevators = measure_elevators(own, {})
        loads = iter([each.load for each in with_loads(own, {}, elevators)])
        own, _ = moved(campaign, path)
    _, [sentence], _ = identify_servo(own, {})
    kind = "lag" if "lag" in number else "rate limit"
    assert f"has a {kind} that" in sentence


def test_a_log_that_rounds_commands_is_named(campaign):
    own, _ = moved(campaign, follow(campaign.limits))
    flights = [
        dataclasses.replace(f, command=1.0 * np.round(f.command)) for f in own.flights
    ]
    told = dataclasses.replace(own, flights=tuple(flights))
    _, [sentence], _ = identify_servo(told, {})
    assert "a log that rounds commands, in steps of 1 rad/s" in sentence


def turn_finely(servo, switches, commands, time, load):
    """Turns an elevator of an uneven servo, by Euler's small steps."""
    step = 1e-5
    demanded = behind = shown = 0.0
    angles = []
    for now in np.arange(time[0], time[-1], step):
        force = load[np.searchsorted(time, now, side="right") - 1]
        command = commands[
            np.searchsorted(switches, now - servo.delay, side="right") - 1
        ]
        most = servo.rate * (1.0 - servo.rate_by_load * force)
        demanded += step * np.clip(command, -most, most) * (now >= servo.delay)
        side = 1.0 if demanded > behind else -1.0
        lag = servo.lag * (1.0 + side * servo.skew) + servo.lag_by_load * force
        behind += step * np.clip((demanded - behind) / lag, -servo.slew, servo.slew)
        shown = np.clip(shown, behind - servo.play / 2.0, behind + servo.play / 2.0)
        angles.append(shown)
    return np.interp(time, np.arange(time[0], time[-1], step) + step, angles)


@pytest.mark.parametrize(
    "numbers",
    [
        {"skew": 0.7},
        {"lag_by_load": 0.05},
        {"rate_by_load": 0.6},
        {"play": 0.03},
        {"slew": 3.0},
    ],
    ids=lambda numbers: next(iter(numbers)),
)
def test_an_uneven_servo_turns_as_its_numbers_say(numbers):
    time = np.arange(40) / 100.0
    switches = np.array([0.0, 0.1, 0.2, 0.3])
    tape = CommandTape(switches, np.array([4.0, -5.0, 2.0, -1.0]), 0.0)
    load = np.linspace(0.0, 1.0, len(time))
    servo = LateServo(*LIMITS._replace(rate=6.0), 0.01, 0.03)._replace(**numbers)
    each = Elevator("", time, np.arange(len(time)), time, tape, load)
    true = turn_finely(servo, tape.switches, tape.commands, time, load)
    assert each.follow(time, servo) == pytest.approx(true, abs=2e-3)
    assert np.max(np.abs(each.follow(time, servo.even) - true)) > 5e-3


def test_an_uneven_servo_without_numbers_is_even(campaign):
    """The fine steps are exact for one that only lags."""
    flight = campaign.flights[0]
    tape = command_tape(flight, masks_of(flight, {}), campaign.switch_rate)
    each = Elevator("", flight.time, np.arange(len(flight.time)), flight.time, tape)
    even = LateServo(*campaign.limits, 0.004, 0.03)
    path = each.follow(flight.time, even)
    nearly = each.follow(flight.time, even._replace(play=1e-9))
    assert nearly == pytest.approx(path, abs=1e-6)


def test_one_odd_flight_leaves_the_others_alone(campaign):
    own, _ = moved(campaign, follow(campaign.limits))
    first, *others = own.flights
    off = first.elevator + 0.03 * (first.time > 0.3)
    flights = (dataclasses.replace(first, elevator=off), *others)
    found, [words], _ = identify_servo(dataclasses.replace(own, flights=flights), {})
    assert f"in {first.name}" in words
    told = float(re.search(r"by ([\d.]+) mrad", words)[1])
    late = np.mean(first.time > 0.3)
    assert told == pytest.approx(30.0 * np.sqrt(late * (1.0 - late)), rel=0.15)
    assert [flight.departure is None for flight in found.flights] == [
        False,
        *[True] * 7,
    ]


def test_an_elevator_that_is_never_commanded_shows_no_servo(campaign):
    """It creeps by less than elevators move."""
    flights = [
        dataclasses.replace(
            flight,
            elevator=np.linspace(0.0, 0.02, len(flight.time)),
            command=np.zeros(len(flight.time)),
        )
        for flight in campaign.flights
    ]
    still = dataclasses.replace(campaign, flights=tuple(flights))
    assert identify_servo(still, {}) == (still, (), None)


def test_angles_that_were_not_measured_show_no_servo(campaign):
    own, _ = moved(campaign, lose(campaign.limits))
    for log in ({"angle": "reconstructed"}, {"command": "reconstructed"}):
        told = dataclasses.replace(own, servo=dataclasses.replace(own.servo, **log))
        assert identify_servo(told, {}) == (told, (), None)


def test_a_verdict_tells_first_of_a_servo_that_differs(campaign):
    low, high = campaign.elevator_limits
    told = dataclasses.replace(campaign, elevator_limits=(low, 0.5 * high))
    result = close_the_loop(told, effects=["profile_drag"])
    [words] = [words for words in result.log_findings if "The servo" in words]
    assert result.reason.startswith(words)
    # By its commands, with the stop as specified, the nominal model misses the flights.
    assert result.by_commands_m.keys() == {"nominal"}
    nearer = result.errors["nominal"].position_rms_m
    assert result.by_commands_m["nominal"] > 10.0 * nearer
    assert "with the servo as specified" in headline(result)


def test_errors_by_commands_are_told_where_elevators_do_not_follow_them(campaign):
    """Here the poses are those of elevators that do."""
    own, _ = moved(campaign, lose(campaign.limits))
    result = close_the_loop(own, effects=["profile_drag"])
    assert result.by_commands_m.keys() == {"nominal", "corrected"}
    along = result.errors["corrected"].position_rms_m
    assert result.by_commands_m["corrected"] < 0.5 * along
    assert "(RMS) along the measured elevator, from " in headline(result)
    assert headline(result).endswith("mm by the commands alone.")


def test_of_angles_without_noise_few_steps_of_rounding_are_tried():
    """As of computed ones: there were more steps than memory."""
    tape = SimpleNamespace(switches=0.02 * np.arange(43), commands=np.ones(43))
    plain = SimpleNamespace(
        elevators=[SimpleNamespace(tape=tape)], departures=SimpleNamespace(noise=0.0)
    )
    assert least_step(plain) > 0.01
