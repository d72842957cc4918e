"""Campaign folders: what is read, what is refused and how flights are split."""

import dataclasses
import math
import re
import shutil
import tempfile
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from glider.campaign.logs import (
    POSE_COLUMNS,
    SERVO_COLUMNS,
    Campaign,
    Flight,
    split_flights,
)
from glider.campaign.reader import load_campaign
from glider.campaign.writer import flight_csv, save_campaign
from glider.errors import InputError

VEHICLE = {"mass": 0.08, "wing_area": 0.0885, "hinge_offset": 0.27, "gravity": 9.81}
LIMITS = (-0.4463, 0.9473)
NAMES = tuple(f"flight_{i:03d}.csv" for i in range(4))


def save_flight(path, flight):
    path.write_bytes(flight_csv(flight))


def make_flight(name="flight_000.csv", *, time=None, servo=True):
    """A smooth glide with a moving elevator; 60 rows at 100 Hz by default."""
    t = np.arange(60) / 100 if time is None else np.asarray(time)
    s = t - t[0]
    return Flight(
        name=name,
        time=t,
        pose=np.column_stack([7 * s - 3.5, 0.1 - s**2, -0.5 * s]),
        elevator=0.3 * np.sin(5 * s) if servo else None,
        command=np.where(np.floor(50 * s) % 2, -6.5, 1.25) if servo else None,
    )


def make_campaign(flights, **changes):
    """A campaign with a partly known vehicle."""
    campaign = Campaign(
        name="folder",
        path=Path("folder"),
        vehicle=VEHICLE,
        elevator="servo",
        elevator_limits=LIMITS,
        elevator_rate_limit=13.0,
        pose_rate=100.0,
        command_rate=50.0,
        flights=tuple(flights),
    )
    return dataclasses.replace(campaign, **changes)


@pytest.fixture
def folder(tmp_path):
    """A good campaign of four flights, on disk, to be spoilt."""
    path = tmp_path / "folder"
    save_campaign(path, make_campaign([make_flight(name) for name in NAMES]))
    return path


def refusal(path, **choice):
    """Returns the message, which must be a single line."""
    with pytest.raises(InputError) as info:
        load_campaign(path, **choice)
    message = str(info.value)
    assert "\n" not in message
    return message


# Ways to spoil a flight: each takes and returns the lines of the file.


def cell(row, column, text):
    """Puts text into a cell; row is the line of the file, the header is 1."""

    def spoil(lines):
        cells = lines[row - 1].split(",")
        cells[lines[0].split(",").index(column)] = text
        return [*lines[: row - 1], ",".join(cells), *lines[row:]]

    return spoil


def scaled(column, factor):
    """Writes a whole column in another unit."""

    def spoil(lines):
        index = lines[0].split(",").index(column)
        rows = [line.split(",") for line in lines[1:]]
        for row in rows:
            row[index] = f"{float(row[index]) * factor:.9g}"
        return [lines[0], *(",".join(row) for row in rows)]

    return spoil


def header(old, new):
    """Edits the header."""
    return lambda lines: [lines[0].replace(old, new), *lines[1:]]


DEGREES = 180 / math.pi

SPOILT_FLIGHTS = {
    "empty file": (lambda lines: [], ["no rows of numbers", "names"]),
    "blank header": (lambda lines: ["", *lines[1:]], ["row 2", "names of the columns"]),
    "no header": (lambda lines: lines[1:], ["row 1", "names of the columns"]),
    "duplicated column": (header("pitch", "z"), ["two columns", "'z'"]),
    "short row": (
        lambda lines: [*lines[:9], "0.09,1,2", *lines[10:]],
        ["row 10", "3 cells", "expected 6"],
    ),
    "lone quote": (cell(10, "elevator_rate_command", '"1'), ["row 10", '"1', "number"]),
    "text": (cell(7, "pitch", "nose"), ["'pitch'", "row 7", "'nose'", "number"]),
    "nan": (cell(8, "x", "nan"), ["'x'", "row 8", "nan", "finite"]),
    "inf": (cell(2, "elevator", "-inf"), ["'elevator'", "row 2", "nan", "finite"]),
    "empty cell": (cell(61, "z", " "), ["'z'", "row 61", "nan", "no empty cell"]),
    "upper case": (header("elevator", "ELEVATOR"), ["(did you mean 'ELEVATOR'?)"]),
    "underscore": (cell(9, "x", "1_0"), ["'x'", "row 9", "'1_0'", "number"]),
    "time repeated": (cell(13, "time", "0.1"), ["'time'", "row 13", "0.1"]),
    "time goes back": (cell(20, "time", "0.01"), ["'time'", "row 20", "0.01"]),
    "milliseconds": (scaled("time", 1000), ["'time'", "step of 10;", "milliseconds"]),
    "wrong pose_rate": (scaled("time", 4), ["'time'", "0.04;", "0.01 ", "pose_rate"]),
    "minutes": (scaled("time", 0.3), ["'time'", "0.003;", "seconds", "pose_rate"]),
    "pitch in degrees": (scaled("pitch", DEGREES), ["'pitch'", "row 24", "degrees"]),
    "elevator in degrees": (
        scaled("elevator", DEGREES),
        ["'elevator'", "row 10", "6.3 rad", "degrees"],
    ),
    "command in degrees": (
        scaled("elevator_rate_command", DEGREES),
        ["'elevator_rate_command'", "row 4", "degrees per second"],
    ),
    "millimeters": (scaled("x", 1000), ["'x'", "row 2", "-3500", "millimeters"]),
    "speed": (scaled("x", 50), ["'x'", "350 m/s", "60", "millimeters"]),
    "few rows": (lambda lines: lines[:20], ["too short", "19 rows", "20 rows"]),
    "no rows": (lambda lines: lines[:1], ["no rows of numbers"]),
    "short time": (scaled("time", 0.2), ["too short", "0.118 s", "0.15 s"]),
}


@pytest.mark.parametrize("case", SPOILT_FLIGHTS)
def test_spoilt_flight_is_refused(folder, case):
    """The message names the file, the column, the row, the value, the need."""
    spoil, words = SPOILT_FLIGHTS[case]
    file = folder / "flight_000.csv"
    file.write_text("\n".join(spoil(file.read_text().splitlines())))
    message = refusal(folder, flights=["flight_000"])
    for word in (str(file), *words):
        assert word in message


@pytest.mark.parametrize("column", (*POSE_COLUMNS, *SERVO_COLUMNS))
def test_missing_column_is_refused(folder, column):
    for file in folder.glob("flight_*.csv"):
        file.write_text(file.read_text().replace(f"{column}", "other", 1))
    message = refusal(folder)
    assert "flight_000.csv: " in message
    assert f"no column '{column}'" in message or f"'{column}' is missing" in message


@pytest.mark.parametrize(
    "content", [b"\x89PNG\r\n\x1a\n\xff\x00", b"\x00" * 999, "t\n".encode("utf-16")]
)
@pytest.mark.parametrize("name", ["flight_000.csv", "campaign.yaml"])
def test_binary_file_is_refused(folder, name, content):
    (folder / name).write_bytes(content)
    message = refusal(folder, flights=["flight_000"])
    assert str(folder / name) in message
    assert len(message) < 400 and "no known format" not in message


@pytest.mark.parametrize("name", [NAMES[0], NAMES[2]])
def test_a_flight_without_the_servo_of_the_others_is_refused(folder, name):
    save_flight(folder / name, make_flight(servo=False))
    message = refusal(folder)
    assert f"{name}: column 'elevator' is missing" in message
    assert message.endswith("; to leave the file out, name others with --flights.")


def edited(**changes):
    """Changes top-level fields; "vehicle__mass" is a field of the vehicle."""

    def spoil(folder):
        file = folder / "campaign.yaml"
        content = yaml.safe_load(file.read_text())
        for name, value in changes.items():
            inside = name.startswith("vehicle__")
            target = content["vehicle"] if inside else content
            target[name.removeprefix("vehicle__")] = value
        file.write_text(yaml.safe_dump(content))

    return spoil


def written(text):
    return lambda folder: (folder / "campaign.yaml").write_text(text)


SPOILT_SETTINGS = {
    "missing": (lambda folder: (folder / "campaign.yaml").unlink(), ["no campaign"]),
    "not YAML": (written("vehicle: {mass: 1"), ["YAML", "line 1"]),
    "bad date": (written("pose_rate: 2024-13-45"), ["YAML", "month"]),
    "empty": (written("# nothing\n"), ["None", "a mapping of fields"]),
    "a list": (written("- 1\n"), ["[1]", "a mapping of fields"]),
    "unknown field": (edited(pose_rat=120), ["'pose_rat'", "mean 'pose_rate'?"]),
    "misplaced field": (edited(mass=1), ["'mass'", "vehicle, pose_rate"]),
    "number as a field": (edited(**{"vehicle__": 1}), ["unknown field ''"]),
    "unknown vehicle field": (
        edited(vehicle__wing_aera=0.1),
        ["vehicle", "'wing_aera'", "mean 'wing_area'?"],
    ),
    "vehicle is a name": (
        edited(vehicle="r1"),
        ["vehicle", "'r1'", "a mapping of fields"],
    ),
    "negative mass": (edited(vehicle__mass=-1), ["'mass'", "-1", "a positive number"]),
    "mass is text": (edited(vehicle__mass="1 kg"), ["mass'", "'1 kg'", "number"]),
    "limits in degrees": (
        edited(vehicle__elevator_limits=[-25, 54]),
        ["'elevator_limits'", "[-25.0, 54.0]", "radians"],
    ),
    "limits turned": (
        edited(vehicle__elevator_limits=[0.9, -0.4]),
        ["'elevator_limits'", "lower < upper"],
    ),
    "offset in mm": (
        edited(vehicle__wing_offset=10, vehicle__hinge_offset=0.27),
        ["'wing_offset'", "10", "m, less than the 0.27 to the tail"],
    ),
    "elevator": (edited(vehicle__elevator="free"), ["'elevator'", "'free'", "fixed"]),
    "zero rate": (edited(command_rate=0), ["'command_rate'", "0", "positive"]),
    "rate is nan": (edited(pose_rate=math.nan), ["'pose_rate'", "nan", "positive"]),
    "rate is text": (edited(pose_rate="fast"), ["'pose_rate'", "'fast'", "a number"]),
    "rate is true": (edited(pose_rate=True), ["'pose_rate'", "True", "a number"]),
}


@pytest.mark.parametrize("case", SPOILT_SETTINGS)
def test_spoilt_settings_are_refused(folder, case):
    """The message names campaign.yaml, the field, the value and the need."""
    spoil, words = SPOILT_SETTINGS[case]
    spoil(folder)
    message = refusal(folder)
    for word in (str(folder), "campaign.yaml", *words):
        assert word in message


def test_folder_without_flights_is_refused(folder, tmp_path):
    (tmp_path / "nothing").mkdir()
    for path, words in (
        (tmp_path / "absent", "does not exist"),
        (folder / "campaign.yaml", "is not a folder"),
        (folder / NAMES[0], "is not a folder"),
        (tmp_path / "nothing", "no campaign.yaml"),
    ):
        message = refusal(path)
        assert f"{path}: {words}" in message
        assert not path.exists() or "glider import" in message
    for name in NAMES:
        (folder / name).unlink()
    assert f"{folder}: no flight_*.csv" in refusal(folder)
    (folder / NAMES[0]).mkdir()
    assert f"{folder / NAMES[0]}: is a folder; expected" in refusal(folder)


@pytest.mark.parametrize(
    "name",
    [
        "flight_<img src=x onerror=alert(1)>.csv",
        "flight_a&b.csv",
        'flight_"a".csv',
        "flight_'a'.csv",
        "flight_\x1b[31m.csv",
        "flight_\n.csv",
        "flight_\u202e.csv",
    ],
)
def test_a_hostile_name_of_a_flight_is_refused(folder, name):
    """A name goes to the report's page and to the terminal."""
    (folder / NAMES[0]).rename(folder / name)
    message = refusal(folder)
    assert "flight_" in message and "name" in message
    assert message.isprintable()


def test_names_in_other_scripts_are_accepted(folder):
    (folder / NAMES[0]).rename(folder / "flight_Käfer 3 (größer).csv")
    assert "flight_Käfer 3 (größer).csv" in [
        f.name for f in load_campaign(folder).flights
    ]


def test_no_message_has_an_escape_sequence(folder):
    """Names of columns and fields come from files that others wrote."""
    file = folder / NAMES[0]
    file.write_text(file.read_text().replace("pitch", "pi\x1b[31mtch", 1))
    assert refusal(folder).isprintable()
    (folder / "campaign.yaml").write_text('"ma\x1b[2Jss": 1')
    assert refusal(folder).isprintable()
    path = folder.rename(folder.with_name("fol\x1b]0;der"))
    assert refusal(path).isprintable()


def test_choice_of_flights(folder):
    """By name; what is not chosen is not even read."""

    def names(**choice):
        flights = load_campaign(folder, **choice).flights
        return tuple(flight.name for flight in flights)

    (folder / "flight_002.csv").write_text("broken")
    (folder / "notes.csv").write_text("not a flight")
    assert names(flights=["flight_003", "flight_000.csv"]) == (NAMES[0], NAMES[3])


@pytest.mark.parametrize(
    ("choice", "words"),
    [
        ({"flights": ["flight_007"]}, ["'flight_007.csv'", "not in this folder"]),
        ({"flights": []}, ["no flight is chosen"]),
    ],
)
def test_impossible_choice_is_refused(folder, choice, words):
    message = refusal(folder, **choice)
    for word in (str(folder), *words):
        assert word in message


def test_irregular_times_and_gaps_are_accepted(folder):
    """Times as logged: an epoch, jitter and missing rows."""
    rng = np.random.default_rng(1)
    time = 1.7e9 + np.delete(np.arange(90) / 100, [*range(20, 32), 50, 70, 71])
    time = time + rng.uniform(-0.004, 0.004, time.size)
    save_flight(folder / NAMES[1], make_flight(time=time))
    flight = load_campaign(folder).flights[1]
    np.testing.assert_allclose(flight.time, time, rtol=0, atol=1e-5)


def test_habits_of_other_programs_are_accepted(folder):
    """Byte order mark, CRLF, quoted and spaced names, blank lines, 1e-3, semicolons."""
    expected = load_campaign(folder).flights[0]
    for name in NAMES:
        lines = (folder / name).read_text().splitlines()
        lines[0] = ", ".join(f'"{column} "' for column in lines[0].split(","))
        lines.insert(9, ",,,,,")
        if name == NAMES[1]:
            lines = [line.replace(",", ";") for line in lines]
        text = "\r\n".join(["\ufeff" + lines[0], *lines[1:], "", ""])
        (folder / name).write_bytes(text.encode())
    written("vehicle: {pitch_inertia: 15e-4}\npose_rate: 100\n")(folder)
    campaign = load_campaign(str(folder))
    np.testing.assert_array_equal(campaign.flights[0].pose, expected.pose)
    assert campaign.vehicle == {"pitch_inertia": 0.0015}


def test_a_unit_behind_a_name_is_converted(folder):
    expected = load_campaign(folder).flights[0]
    file = folder / NAMES[0]
    lines = scaled("x", 1000)(file.read_text().splitlines())
    text = "\n".join(lines)
    file.write_text(text.replace(",x,", ",x [mm],", 1))
    pose = load_campaign(folder).flights[0].pose
    np.testing.assert_allclose(pose, expected.pose, rtol=1e-8)
    file.write_text(text.replace(",x,", ",x [deg],", 1))
    assert "column 'x': found 'deg'; expected one of m, cm" in refusal(folder)


def test_what_is_left_out_stays_unknown(folder):
    """Only the pose rate is estimated, from the steps of all flights."""
    written("vehicle: {elevator: fixed}\n")(folder)
    for name in NAMES:
        save_flight(folder / name, make_flight(time=np.arange(40) / 80))
    campaign = load_campaign(folder)
    assert campaign.vehicle == {}
    assert campaign.elevator_limits is None
    assert campaign.elevator_rate_limit is None
    assert campaign.command_rate is None
    assert campaign.pose_rate is None
    assert campaign.row_rate == pytest.approx(80)
    assert campaign.flights[0].elevator is None
    assert campaign.flights[0].command is None


def test_estimated_pose_rate_still_finds_the_odd_flight(folder):
    written("vehicle: {}\n")(folder)
    file = folder / NAMES[2]
    file.write_text("\n".join(scaled("time", 10)(file.read_text().splitlines())))
    assert f"{file}: column 'time'" in refusal(folder)
    for name in NAMES:  # All in milliseconds: nothing to compare with.
        file = folder / name
        spoil = scaled("time", 100 if name == NAMES[2] else 1000)
        file.write_text("\n".join(spoil(file.read_text().splitlines())))
    assert "milliseconds" in refusal(folder)


def test_pitch_is_unwrapped(folder):
    """A loop that motion capture logs within ±π comes back continuous."""
    flight = make_flight()
    pitch = np.linspace(-0.3, -9.0, flight.time.size)
    pose = np.column_stack([flight.pose[:, :2], pitch])
    save_flight(folder / NAMES[0], dataclasses.replace(flight, pose=pose))
    loaded = load_campaign(folder).flights[0]
    np.testing.assert_allclose(loaded.pose[:, 2], pitch, atol=1e-7)


@pytest.mark.parametrize("column", ["x", "pitch", "elevator"])
def test_a_turned_sign_is_accepted(folder, column):
    """It is an effect to be traced, not an unreadable log."""
    file = folder / NAMES[0]
    flight = make_flight(NAMES[0])
    full = dataclasses.replace(flight, elevator=np.linspace(*LIMITS, flight.time.size))
    save_flight(file, full)
    file.write_text("\n".join(scaled(column, -1)(file.read_text().splitlines())))
    assert len(load_campaign(folder).flights) == len(NAMES)


@pytest.mark.parametrize("elevator", ["servo", "fixed", "fixed_per_flight"])
@pytest.mark.parametrize("known", [True, False])
def test_campaign_round_trip(tmp_path, elevator, known):
    servo = elevator == "servo"
    flights = [make_flight(name, servo=servo) for name in NAMES]
    campaign = make_campaign(flights, elevator=elevator, path=tmp_path / "folder")
    if not known:
        nothing = dict.fromkeys(("elevator_limits", "elevator_rate_limit"))
        campaign = dataclasses.replace(
            campaign, vehicle={}, command_rate=None, **nothing
        )
    save_campaign(campaign.path, campaign)
    loaded = load_campaign(campaign.path)
    same = {"flights": ()}
    assert dataclasses.replace(loaded, **same) == dataclasses.replace(campaign, **same)
    for ours, theirs in zip(flights, loaded.flights, strict=True):
        for field in dataclasses.fields(Flight)[1:]:
            expected, actual = getattr(ours, field.name), getattr(theirs, field.name)
            if expected is None:
                assert actual is None
            else:
                np.testing.assert_allclose(actual, expected, rtol=1e-8, atol=1e-12)
    assert [flight.name for flight in loaded.flights] == list(NAMES)


@settings(max_examples=100, deadline=None)
@given(st.floats(-20.0, 20.0), st.floats(-7.0, 7.0), st.integers(1, 59))
def test_what_is_written_of_any_angle_is_read(begin, jump, row):
    """Full turns too, in the nine digits that are written."""
    flight = make_flight()
    angle = np.full(len(flight.time), begin)
    angle[row:] += jump
    for turns in (angle, 2.0 * np.pi * np.round(angle / (2.0 * np.pi))):
        pose = np.column_stack([flight.pose[:, :2], turns])
        attitude = np.column_stack([0.0 * turns, turns, turns])
        turned = dataclasses.replace(flight, pose=pose, attitude=attitude)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "written"
            save_campaign(path, make_campaign([turned], path=path))
            [again] = load_campaign(path).flights
        assert np.allclose(np.exp(1j * again.pose[:, 2]), np.exp(1j * turns))


def test_save_does_not_mix_campaigns(folder):
    campaign = make_campaign([make_flight("flight_000.csv")])
    with pytest.raises(InputError, match=re.escape(f"{folder}: holds flight_001.csv")):
        save_campaign(folder, campaign)
    shutil.rmtree(folder)
    save_campaign(folder, campaign)
    assert len(load_campaign(folder).flights) == 1


@settings(deadline=None)
@given(st.integers(3, 60), st.floats(0.01, 0.99), st.integers(0, 2**32))
def test_split_is_a_partition_of_whole_flights(count, fraction, seed):
    """Disjoint, complete, sorted, repeatable and of the size asked for."""
    flights = [make_flight(f"flight_{i:03d}.csv") for i in range(count)]
    fit, held_out = split_flights(make_campaign(flights), fraction, seed)
    assert len(fit) >= 2
    assert len(held_out) >= 1
    assert len(held_out) == pytest.approx(
        np.clip(fraction * count, 1, count - 2), abs=0.51
    )
    assert sorted(map(id, fit + held_out)) == sorted(map(id, flights))
    for part in (fit, held_out):
        assert [f.name for f in part] == sorted(f.name for f in part)
    turned = make_campaign(flights[::-1])
    again = split_flights(turned, fraction, seed)
    for part, same in zip((fit, held_out), again, strict=True):
        assert all(a is b for a, b in zip(part, same, strict=True))


def test_when_a_command_began_is_read_where_it_is_logged(folder):
    plain = make_flight("flight_001.csv")
    began = np.floor(50 * plain.time + 0.3) / 50 - 0.006
    timed = dataclasses.replace(plain, command_time=began)
    save_flight(folder / plain.name, timed)  # The others may lack it.
    flights = load_campaign(folder).flights
    np.testing.assert_allclose(flights[1].command_time, began, rtol=1e-14)
    assert flights[0].command_time is None
    for wrong in (began + 0.03, began[::-1]):
        save_flight(folder / plain.name, dataclasses.replace(plain, command_time=wrong))
        message = refusal(folder)
        assert "flight_001.csv: column 'command_time', row" in message
        assert "not after the row's, nor before the last" in message


def test_split_depends_on_the_seed():
    campaign = make_campaign([make_flight(f"flight_{i:03d}.csv") for i in range(20)])
    splits = {
        tuple(f.name for f in split_flights(campaign, 0.25, seed)[1])
        for seed in range(5)
    }
    assert len(splits) > 1


@pytest.mark.parametrize("fraction", [0.0, 1.0, -0.2, math.nan])
def test_split_needs_a_fraction(fraction):
    campaign = make_campaign([make_flight(name) for name in NAMES])
    with pytest.raises(InputError, match="held-out fraction"):
        split_flights(campaign, fraction, 0)


def test_split_needs_three_flights():
    campaign = make_campaign([make_flight(name) for name in NAMES[:2]])
    with pytest.raises(InputError, match="found 2 flights; expected at least 3"):
        split_flights(campaign, 0.25, 0)
    with pytest.raises(InputError, match="found 1 flight; expected"):
        split_flights(make_campaign([make_flight(NAMES[0])]), 0.25, 0)
