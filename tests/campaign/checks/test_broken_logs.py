"""A broken log is refused, corrected or reported; the rest stays."""

import dataclasses
import re

import numpy as np
import pytest

from glider.campaign.checks.inspection import inspect
from glider.campaign.checks.servo import (
    calc_correlation,
    check_follows,
    measure_elevators,
)
from glider.campaign.reader import load_campaign
from glider.compiled.actuators import elevator_path
from glider.errors import InputError
from tests.campaign.checks import breaking as b
from tests.helpers.campaigns import BLIND, PRACTICE, campaign_path

ODD = 5  # The flight that is broken where only one is.
NAME = f"flight_{ODD:03d}.csv"
RNG = np.random.default_rng(0)


@pytest.fixture(scope="module")
def campaign():
    """Twelve flights in still air."""
    whole = load_campaign(campaign_path("still_air"))
    return dataclasses.replace(whole, flights=whole.flights[:12])


def refusal(campaign):
    """Returns the one sentence by which a campaign is refused."""
    with pytest.raises(InputError) as info:
        inspect(campaign)
    message = str(info.value)
    assert "\n" not in message
    assert message.endswith(".") or message.endswith("?).")
    return message


def rows_set_aside(campaign, edit):
    """Breaks one flight; returns its set-aside rows from 0 on, and the inspection."""
    found = inspect(b.change(campaign, edit, only=ODD))
    assert {s.file for s in found.excluded} <= {NAME}
    return list(np.flatnonzero(found.masks[NAME].pose)), found


@pytest.mark.parametrize(
    "name",
    [*PRACTICE, *(pytest.param(name, marks=pytest.mark.nightly) for name in BLIND)],
)
def test_a_good_campaign_is_left_as_it_is(name):
    campaign = load_campaign(campaign_path(name))
    found = inspect(campaign)
    assert found.excluded == ()
    assert found.warnings == ()
    assert found.campaign == campaign
    assert not any(m.pose.any() or m.elevator.any() for m in found.masks.values())


WRONG = {
    "exchange": (b.exchange, "fall along -x.*expected 'z' to point up"),
    "behind": (b.from_behind, "go along -x, with the nose there"),
    "half turn": (b.half_turn, "tail first .column 'pitch' is off by half a turn"),
    "slow clock": (b.stretch_time(2.0), "fall at 2.*'gravity' is 9.81"),
    "fast clock": (b.stretch_time(0.5), "fall at 40.*'gravity' is 9.81"),
    "feet": (b.scale(3.28, 3.28, 1.0), "fall at 3.*'units: length'"),
    "decimeters": (b.scale(0.1, 0.1, 1.0), "fall at .*'units: length'"),
    "backwards": (b.backwards, "tail first.*do the rows run backwards"),
    "level": (b.scale(1.0, 0.0, 1.0), "column 'z' does not change in any flight"),
    "y for z": (b.level(RNG), "column 'z' does not change in any flight"),
    "pitch of the path": (
        lambda f: b.with_pose(f, b.pitch_of_path(f)),
        "column 'pitch' is the direction of the path",
    ),
    "no pitch": (b.scale(1.0, 1.0, 0.0), "column 'pitch' does not change in any"),
    "degrees": (b.scale(1.0, 1.0, 57.3), "column 'pitch' fits the motion in degrees"),
    "no elevator": (
        b.with_servo(elevator=lambda f: 0.0 * f.elevator),
        "column 'elevator' moves by 0 rad",
    ),
    "no commands": (
        b.with_servo(command=lambda f: 0.0 * f.command),
        "'elevator_rate_command' would move it by 0 rad",
    ),
    "late commands": (b.shift_commands(0.5), "does not follow.*shifted by -0.5"),
    "early commands": (b.shift_commands(-0.5), "does not follow.*shifted by 0.5"),
    "commands 30 ms late": (b.shift_commands(0.03), "moves 0.0.. s before"),
    "noise for an elevator": (
        b.with_servo(elevator=lambda f: RNG.normal(0.0, 0.2, len(f.time))),
        "column 'elevator' does not follow",
    ),
    "a clock a second off": (
        b.shift_commands(1.0),
        "'elevator_rate_command' would move it by 0 rad",
    ),
}


@pytest.mark.parametrize("kind", WRONG)
def test_a_wrong_campaign_is_refused(campaign, kind):
    edit, sentence = WRONG[kind]
    assert re.search(sentence, refusal(b.change(campaign, edit)))


@pytest.mark.parametrize(
    ("told", "sentence"),
    [
        ({"gravity": 0.0}, "fall at 10 .* and 'gravity' is 0:"),
        ({"gravity": 1.62}, "fall at 10 .* and 'gravity' is 1.62:"),
        ({"gravity": 32.2}, "fall at 10 .* and 'gravity' is 32.2:"),
        ({"air_density": 0.0012}, "at an air_density of 0.0012 kg/m³; expected kg,"),
        ({"wing_area": 8.85}, r"by a factor of 100 \(wing_area in dm²\?\); expected"),
        ({"wing_area": 885.0}, r"by a factor of 10000 \(wing_area in cm²\?\); "),
        ({"mass": 80.0}, r"80 kg / .* by a factor of 1000 \(mass in g\?\); expected"),
    ],
)
def test_wrong_numbers_of_the_vehicle_are_refused(campaign, told, sentence):
    assert re.search(sentence, refusal(b.tell(campaign, **told)))


@pytest.mark.parametrize(
    "told",
    [
        {"hinge_offset": 270.0},
        {"hinge_offset": 27.0},
        {"elevator_offset": 22.0},
        {"elevator_area": 1.47},
        {"pitch_inertia": 1.5},
        {"pitch_inertia": 15e-6},
    ],
)
def test_a_tail_in_other_units_is_refused(campaign, told):
    words = "contradicts the measured pitch accelerations by a factor of"
    assert words in refusal(b.tell(campaign, **told))


@pytest.mark.parametrize("known", [{"mass": 80.0}, {"wing_area": 8.85}])
def test_a_mass_or_an_area_alone_is_compared_with_the_forces_too(campaign, known):
    """Without an air density, which is rarely specified, and the other one."""
    vehicle = {"gravity": 9.81} | known
    alone = dataclasses.replace(campaign, vehicle=vehicle)
    assert re.search(r"contradicts .* is not specified", refusal(alone))


def test_forces_of_real_wings_pass(campaign):
    """From half the plate's lift with a heavier glider to 2 pi with half the mass."""
    for ratio in (0.35, 6.0):
        told = b.tell(campaign, mass=ratio * campaign.vehicle["mass"])
        assert inspect(told).warnings == ()


def test_unknown_gravity_is_that_of_the_earth(campaign):
    vehicle = {k: v for k, v in campaign.vehicle.items() if k != "gravity"}
    on_earth = dataclasses.replace(campaign, vehicle=vehicle)
    assert inspect(on_earth).warnings == ()
    assert "'gravity' is 9.81" in refusal(b.change(on_earth, b.stretch_time(2.0)))


@pytest.mark.parametrize("pitch", [1.0, -1.0])
@pytest.mark.parametrize(
    ("x", "z", "words"),
    [
        (1.0, -1.0, "'up' has the wrong sign: the flights fall along"),
        (-1.0, 1.0, "'forward' has the wrong sign: the flights go along -x, tail"),
        (-1.0, -1.0, "'up' has the wrong sign"),
    ],
)
def test_a_turned_axis_is_refused(campaign, x, z, words, pitch):
    assert words in refusal(b.change(campaign, b.scale(x, z, pitch)))


@pytest.mark.parametrize("signs", [(-1, 1, 1), (1, -1, 1), (1, 1, -1), (-1, -1, -1)])
def test_turned_angles_pass(campaign, signs):
    """They are traced later."""
    pitch, elevator, command = signs

    def edit(f):
        servo = b.with_servo(
            lambda f: elevator * f.elevator, lambda f: command * f.command
        )
        return servo(b.scale(1.0, 1.0, pitch)(f))

    found = inspect(b.change(campaign, edit))
    assert found.warnings == ()
    assert found.excluded == ()


FAULTY_ROWS = {
    "frozen": (b.freeze(40, 5), range(41, 46), "frozen"),
    "frozen for long": (b.freeze(40, 20), range(41, 61), "frozen"),
    "frozen until the end": (b.freeze(70, 99), range(71, 103), "frozen"),
    "pitch alone": (b.freeze(40, 20, (2,)), range(41, 61), "frozen"),
    "z alone": (b.freeze(40, 20, (1,)), range(41, 61), "frozen"),
    "one outlier": (b.spikes([50]), [50], "departs from"),
    "a first row": (b.spikes([0]), [0], "departs from"),
    "a last row": (b.spikes([102]), [102], "departs from"),
    "a burst": (b.spikes([50, 51]), [50, 51], "departs from"),
    "ten outliers": (b.spikes(list(range(5, 95, 9))), range(5, 95, 9), "departs from"),
    "a short jump": (b.jump(40, 50), range(40, 50), "jumps"),
    "a long jump": (b.jump(40, 60), range(40, 60), "jumps"),
    "a jump that stays": (b.jump(60), range(60, 103), "jumps"),
    "an early jump": (b.jump(20), range(20), "jumps"),
    "a jump of the pitch": (b.jump(60, by=(0, 0, 0.2)), range(60, 103), "jumps"),
    "not a number": (b.jump(50, 53, by=(np.nan, 0, 0)), range(50, 53), "not a number"),
}


@pytest.mark.parametrize("kind", FAULTY_ROWS)
def test_faulty_rows_are_set_aside_alone(campaign, kind):
    edit, rows, word = FAULTY_ROWS[kind]
    found, inspection = rows_set_aside(campaign, edit)
    assert set(rows) <= set(found)
    assert len(set(found) - set(rows)) <= 2
    assert any(word in s.why for s in inspection.excluded)


def test_rows_are_named_as_lines_of_the_file(campaign):
    _, found = rows_set_aside(campaign, b.freeze(40, 5))
    [fault] = found.excluded
    assert (fault.file, fault.rows) == (NAME, "43-47")  # The header is line 1.


def test_landing_is_set_aside(campaign):
    found, _ = rows_set_aside(campaign, b.land(60, RNG))
    assert set(range(62, 103)) <= set(found)
    assert min(found) >= 58


@pytest.mark.parametrize("first", [35, 60])
def test_all_flights_may_land(campaign, first):
    found = inspect(b.change(campaign, b.land(first, RNG)))
    assert len(found.campaign.flights) == 12
    for mask in found.masks.values():
        assert mask.pose[first + 1 :].all()
        assert not mask.pose[: first - 3].any()


@pytest.mark.parametrize(
    ("count", "push", "every"),
    [(30, 12.0, 1), (30, 25.0, 1), (0, 20.0, 1), (10, 20.0, 3)],
)
def test_rows_in_the_hand_are_set_aside(campaign, count, push, every):
    """As are those whose cubics see the hand, at 40 Hz too."""
    edit = b.hold_before(count, push, RNG)
    campaign = b.change(campaign, b.thin(every))
    before = [len(edit(f).time) - len(f.time) for f in campaign.flights]
    found = inspect(b.change(campaign, edit))
    assert len(found.campaign.flights) == 12
    assert found.warnings == ()
    for mask, rows in zip(found.masks.values(), before, strict=True):
        assert mask.pose[:rows].all()
        assert max(6 / every, 3) <= mask.pose[rows:].sum() <= 20 / every


def test_what_lies_beyond_a_gap_in_the_commands_is_set_aside(campaign):
    """The longer piece stays."""
    length = len(campaign.flights[0].time)
    rows, found = rows_set_aside(campaign, b.lose(30, 40))
    pieces = list(range(30)), list(range(30, length - 40))
    assert rows == min(pieces, key=len)
    assert [w.split(" (")[0] for w in found.warnings] == [f"{NAME}: a gap of 40 rows"]


@pytest.mark.parametrize(("begin", "count"), [(20, 36), (40, 36), (50, 18)])
def test_a_dropout_in_each_flight_says_nothing_of_glider_or_servo(begin, count):
    """Whichever piece stays, poses of both show how the glider flies."""
    whole = load_campaign(campaign_path("attached_lift"))
    whole = dataclasses.replace(whole, flights=whole.flights[:6])
    found = inspect(b.change(whole, b.lose(begin, count)))
    whys = {excluded.why for excluded in found.excluded}
    assert whys == {"pose: beyond a gap whose commands are not known"}
    assert len(found.campaign.flights) == 6


def test_flights_too_short_to_show_whether_a_servo_follows_are_kept(campaign):
    """In 32 rows at 120 Hz there are ten windows."""

    def shorten(flight):
        names = "time", "pose", "elevator", "command"
        return dataclasses.replace(
            flight, **{n: getattr(flight, n)[:32] for n in names}
        )

    assert inspect(b.change(campaign, shorten)).excluded == ()
    one = dataclasses.replace(campaign, flights=campaign.flights[:1])
    short = b.change(one, shorten)
    elevators = measure_elevators(short, {})
    assert np.isnan(calc_correlation(elevators)).all()
    check_follows(short, elevators)


def test_an_elevator_that_stands_at_its_stop_has_no_wrong_clock(campaign):
    """Only what it does between its stops counts."""
    rng = np.random.default_rng(3)

    def saturate(flight):
        step = int(0.04 * 120.0)
        pushes = rng.choice([-8.0, 8.0, 8.0], len(flight.time) // step + 1)
        command = np.repeat(pushes, step)[: len(flight.time)]
        path = elevator_path(flight.time, command, flight.time, campaign.limits)
        noise = rng.normal(0.0, 0.005, len(path))
        return dataclasses.replace(flight, command=command, elevator=path + noise)

    stopped = b.change(campaign, saturate)
    elevators = measure_elevators(stopped, {})
    check_follows(stopped, elevators)
    known, _ = calc_correlation(elevators, servo=campaign.limits)
    anywhere, _ = calc_correlation(elevators)
    assert known > 0.95 > anywhere


WHOLE_FLIGHTS = {
    "stands": (b.land(0, RNG), "rows of it show a flight"),
    "pitch stuck": (b.freeze(0, 200, (2,)), "rows of it show a flight"),
    "every other row": (b.spikes(list(range(1, 101, 2))), "most of its rows"),
    "elevator stuck": (b.with_servo(elevator=lambda f: 0 * f.elevator), "its elevator"),
}


@pytest.mark.parametrize("kind", WHOLE_FLIGHTS)
def test_a_flight_that_stands_out_is_set_aside(campaign, kind):
    edit, why = WHOLE_FLIGHTS[kind]
    found = inspect(b.change(campaign, edit, only=ODD))
    [fault] = [s for s in found.excluded if s.rows == "all"]
    assert fault.file == NAME
    assert why in fault.why
    assert len(found.campaign.flights) == 11
    assert NAME not in found.masks


def test_a_copy_is_set_aside(campaign):
    again = dataclasses.replace(campaign.flights[2], name="flight_900.csv")
    found = inspect(dataclasses.replace(campaign, flights=(*campaign.flights, again)))
    [fault] = found.excluded
    assert (fault.file, fault.why) == (
        "flight_900.csv",
        "the same rows as flight_002.csv",
    )
    assert found.campaign.flights == campaign.flights
    names = [flight.name for flight in campaign.flights]
    copies = tuple(dataclasses.replace(again, name=name) for name in names)
    assert "same rows as" in refusal(dataclasses.replace(campaign, flights=copies))


def test_a_campaign_of_mostly_broken_flights_is_refused(campaign):
    assert "cannot be used" in refusal(b.change(campaign, b.land(0, RNG)))


def test_faulty_rows_of_an_elevator_leave_the_pose(campaign):
    def edit(flight):
        angle = flight.elevator.copy()
        angle[30] += 0.5
        return dataclasses.replace(flight, elevator=angle)

    rows, found = rows_set_aside(campaign, edit)
    assert rows == []
    assert list(np.flatnonzero(found.masks[NAME].elevator)) == [30]


def test_a_flight_elsewhere_is_no_fault(campaign):
    rows, found = rows_set_aside(campaign, b.jump(0, by=(0.5, -0.3, 0.0)))
    assert (rows, found.warnings) == ([], ())


@pytest.mark.parametrize("name", PRACTICE + BLIND)
def test_one_flight_alone_is_not_refused(name):
    """It does not determine gravity, so its axes are not judged."""
    campaign = load_campaign(campaign_path(name))
    for flight in campaign.flights[:3]:
        found = inspect(dataclasses.replace(campaign, flights=(flight,)))
        assert (found.excluded, found.warnings) == ((), ())
