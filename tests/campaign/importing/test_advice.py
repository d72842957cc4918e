"""A refusal's advice is right: what it names makes the campaign that the logs are."""

import re

import numpy as np
import pytest
import yaml

from glider.campaign.importing.campaign_import import read_flights
from glider.errors import InputError
from tests.campaign.importing import foreign
from tests.campaign.importing.test_import import wrong_maps

RIGHT = {
    "columns": dict.fromkeys(("x", "z", "pitch"))
    | {"elevator": "angle", "elevator_rate_command": "rate"},
    "frame": {},
    "units": {},
} | yaml.safe_load(foreign.VEHICLE)
RIGHT["columns"] = {name: value or name for name, value in RIGHT["columns"].items()}


@pytest.fixture(scope="module")
def campaign():
    return foreign.flights("attached_lift")


def write_tables(folder, campaign, *, forward="x"):
    """One table for each flight, which goes along x or -y."""
    files = []
    for flight in campaign.flights:
        x, z, pitch = flight.pose.T
        ground = (x, 0.0 * x) if forward == "x" else (0.0 * x, -x)
        servo = flight.elevator, flight.command
        columns = flight.time, *ground, z, pitch, *servo
        names = "time,x,y,z,pitch,angle,rate"
        files.append(foreign.write_table(folder / flight.name, names, *columns))
    return files


def refusal_and_advice(files, path, wrong):
    """The refusal of a wrong MAP, and the MAP that its first advice makes."""
    path.write_text(yaml.safe_dump(wrong))
    with pytest.raises(InputError) as refusal:
        read_flights(files, path)
    message = str(refusal.value)
    if message.endswith("or 'find'."):
        return message, wrong | {"clock": "find"}
    advised = re.search("; with '(.*?)'.* passes all checks", message)
    assert advised, message
    better = dict(wrong)
    for part, fields in yaml.safe_load("{" + advised[1] + "}").items():
        old = wrong.get(part)
        old = {"axes": old} if part == "frame" and isinstance(old, str) else old
        better[part] = {**(old or {}), **fields} if isinstance(fields, dict) else fields
    return message, better


def assert_advice_is_right(files, path, wrong, campaign, slack=0.0):
    message, better = refusal_and_advice(files, path, wrong)
    path.write_text(yaml.safe_dump(better))
    imported = read_flights(files, path).campaign
    for flight, true in zip(imported.flights, campaign.flights, strict=True):
        rows = np.searchsorted(true.time - true.time[0], flight.time - 1e-4)
        x, z, pitch = (flight.pose - true.pose[rows]).T
        assert np.ptp(x) < 1e-5 and np.ptp(z) < 1e-5, message
        assert np.abs(pitch).max() < 1e-5, message
        missed = np.abs(flight.elevator - true.elevator[rows])
        assert np.percentile(missed, 80) < 1e-5 + slack, message


UP, DOWN = "trailing_edge_up", "trailing_edge_down"


@pytest.mark.parametrize(
    "wrong",
    [
        {"units": {"length": "cm"}},
        pytest.param({"frame": {"elevator": DOWN}}, marks=pytest.mark.nightly),
        pytest.param(
            {"frame": {"elevator": DOWN, "command": UP}}, marks=pytest.mark.nightly
        ),
        {"columns": RIGHT["columns"] | {"x": "z", "z": "x"}},
    ],
    ids=str,
)
def test_the_advice_makes_the_right_campaign(tmp_path, campaign, wrong):
    files = write_tables(tmp_path, campaign)
    assert_advice_is_right(files, tmp_path / "MAP.yaml", RIGHT | wrong, campaign)


def test_flights_along_y_need_its_column(tmp_path, campaign):
    files = write_tables(tmp_path, campaign, forward="-y")
    assert_advice_is_right(files, tmp_path / "MAP.yaml", RIGHT, campaign)


@pytest.mark.nightly
@pytest.mark.parametrize("true", [0.35, -2.1])
def test_a_clock_that_is_wrong_is_not_taken_for_a_sign(tmp_path, true):
    """At 0.1 s beside the right clock the elevator seems to turn the other way."""
    campaign = foreign.flights("attached_lift", 8)
    files = []
    rest = np.arange(1, 101) / 100.0
    for flight in campaign.flights:
        pose = tmp_path / flight.name.replace("flight", "pose")
        servo = tmp_path / flight.name.replace("flight", "servo")
        foreign.write_table(pose, "time,x,z,pitch", flight.time, flight.pose)
        begin, end = flight.time[[0, -1]]
        time = np.concatenate([begin - rest[::-1], flight.time, end + rest]) + true
        angle = np.pad(flight.elevator, 100, mode="edge")
        columns = time, angle, np.pad(flight.command, 100)
        foreign.write_table(servo, "time,angle,rate", *columns)
        files += [pose, servo]
    path = tmp_path / "MAP.yaml"
    join = {"join": ["pose_*", "servo_*"], "clock": true - 0.1}
    assert_advice_is_right(files, path, RIGHT | join, campaign, slack=0.05)


def test_no_advice_where_nothing_flies(tmp_path):
    """A vehicle that is parked, and a body that is never seen."""
    rng, time = np.random.default_rng(0), np.arange(300) / 100.0
    still = np.column_stack([time, 0.02 * rng.normal(size=(300, 6))])
    unseen = still * [1.0, np.nan, 1.0, 1.0, 1.0, 1.0, 1.0]
    path, names = tmp_path / "MAP.yaml", "time,x,y,z,pitch,angle,rate"
    for table, words in ((still, "nothing moves like"), (unseen, "is never seen")):
        file = foreign.write_table(tmp_path / "log.csv", names, table)
        path.write_text(yaml.safe_dump(RIGHT))
        with pytest.raises(InputError, match=words) as refusal:
            read_flights([file], path)
        assert "passes all checks" not in str(refusal.value)


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["csv", "mat", "ulog"])
def test_any_wrong_map_is_refused_with_the_right_advice(name, tmp_path):
    """All errors of a sign or an axis, one at a time, in three formats."""
    campaign = foreign.flights("attached_lift")
    write, text = foreign.FORMATS[name]
    files, path = write(tmp_path, campaign), tmp_path / "MAP.yaml"
    text += foreign.VEHICLE
    path.write_text(text)
    right = read_flights(files, path).campaign
    for _, change in wrong_maps(text):
        wrong = yaml.safe_load(text) | change
        path.write_text(yaml.safe_dump(wrong))
        try:
            read_flights(files, path)
        except InputError as error:
            if "passes all checks" in str(error):
                assert_advice_is_right(files, path, wrong, right)


def test_angles_of_elevator_and_command_in_a_wrong_unit(tmp_path, campaign):
    """Both 57 times too small: they agree, but no tail is so strong."""
    files = write_tables(tmp_path, campaign)
    units = {"units": {"elevator": "deg", "elevator_rate_command": "deg/s"}}
    assert_advice_is_right(files, tmp_path / "MAP.yaml", RIGHT | units, campaign)
