"""`--guess` finds columns by their names, and is as certain of axes as it is right."""

import itertools
import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from benchmarks import bench_guess, bench_guess_foreign
from glider.campaign.importing.campaign_import import read_flights
from glider.campaign.importing.guess import guess_mapping
from glider.errors import InputError
from tests.campaign.importing import foreign

MOTIVE = Path(__file__).parents[4] / "shared" / "measured" / "raw_motive"
VEHICLE = "  elevator_rate_limit: 13.0\n"


@pytest.fixture(scope="module")
def campaign():
    return foreign.flights("attached_lift")


def frame_of(guess):
    """The lines of a guess under `frame:`."""
    return guess.text.partition("frame:")[2].partition("vehicle:")[0]


def assert_guessed(files, campaign, tmp_path, sure=True, **columns):
    """The guess makes the flights of a campaign, from these columns, and is certain."""
    guess = guess_mapping(files)
    found = yaml.safe_load(guess.text)
    assert found["columns"] | columns == found["columns"]
    assert not sure or (guess.probability > 0.99 and "?" not in frame_of(guess))
    path = tmp_path / "MAP.yaml"
    path.write_text(guess.text + VEHICLE)
    imported = read_flights(files, path).campaign
    for flight, true in zip(imported.flights, campaign.flights, strict=True):
        assert np.abs(flight.pose[5:25, 2] - true.pose[5:25, 2]).max() < 1e-5
        moved = flight.pose[5:25, :2] - flight.pose[5, :2]
        assert np.allclose(moved, true.pose[5:25, :2] - true.pose[5, :2], atol=1e-5)
        if columns.get("elevator"):
            near = np.abs(flight.elevator[5:25] - true.elevator[5:25])
            assert np.max(near) < 0.1  # A found offset of clocks is rough.


def write_tables(folder, campaign, head, columns_of):
    """CSV files of columns made of each flight."""
    return [
        foreign.write_table(folder / f.name, head, *columns_of(f), digits="%.9f")
        for f in campaign.flights
    ]


def test_a_guess_is_right_or_asks():
    """Five campaigns of any axes; many more in `bench_guess`, with its table."""
    sources = [foreign.flights(name, 20) for name in ("still_air", "attached_lift")]
    rows = bench_guess.run(sources, 5, seed=3)
    assert len(rows) == 5
    assert all(asks or right for _, asks, right in rows)
    assert sum(right for _, _, right in rows) >= 4
    assert sum(not asks for _, asks, _ in rows) >= 2


@pytest.mark.nightly
@pytest.mark.skipif(not MOTIVE.is_dir(), reason="no measured flights are here")
def test_motive_takes_are_y_up_or_a_question():
    takes = sorted(MOTIVE.glob("*.csv"))
    for count in (1, 2, 3):
        for files in itertools.combinations(takes, count):
            if [file.stem for file in files] == ["V3_take_2"]:
                with pytest.raises(InputError, match="the body is never seen"):
                    guess_mapping(files)
                continue
            guess = guess_mapping(files)
            right = yaml.safe_load(guess.text)["frame"].items() >= {
                ("up", "y"),
                ("nose", "x"),
                ("top", "y"),
            }
            assert right or "?" in frame_of(guess)
            assert yaml.safe_load(guess.text)["frame"]["up"] == "y"
            assert "elevator: fixed_per_flight" in guess.text


def test_poses_and_servos_in_two_files_are_joined(tmp_path, campaign):
    files = foreign.write_motive(tmp_path, campaign)
    guess = guess_mapping(files)
    found = yaml.safe_load(guess.text)
    assert found["join"] == ["*poses.csv", "*servo.csv"]
    assert found["columns"]["elevator"] == "angle"
    assert found["columns"]["time"] == ["t"]
    assert_guessed(files, campaign, tmp_path, elevator="angle")


def test_quaternions_beside_positions_under_one_name(tmp_path, campaign):
    """As pose.x, pose.qx, ...: the x, y and z of pose.q are no position."""

    def columns_of(flight):
        x, z, pitch = flight.pose.T
        none = np.zeros_like(x)
        turn = none, np.sin(0.5 * pitch), none, np.cos(0.5 * pitch)
        return flight.time, x, none, z, *turn, flight.elevator, flight.command

    names = "pose.x,pose.y,pose.z,pose.qx,pose.qy,pose.qz,pose.qw"
    head = f"t,{names},elevator,elevator_rate"
    files = write_tables(tmp_path, campaign, head, columns_of)
    found = yaml.safe_load(guess_mapping(files).text)["columns"]
    assert (found["position"], found["attitude"]) == ("pose", "pose.q")


def test_names_with_units(tmp_path, campaign):
    files = write_tables(
        tmp_path,
        campaign,
        "time_ms,North_mm,Down_mm,Theta_deg,DE_deg,DE_cmd_degps",
        lambda f: [
            1e3 * f.time,
            1e3 * f.pose[:, 0],
            -1e3 * f.pose[:, 1],
            -np.degrees(f.pose[:, 2]),
            np.degrees(f.elevator),
            np.degrees(f.command),
        ],
    )
    rate = "DE_cmd_degps"
    names = {"elevator": "DE_deg", "elevator_rate_command": rate, "z": "Down_mm"}
    assert_guessed(files, campaign, tmp_path, **names)


def test_german_names_and_centimeters(tmp_path, campaign):
    files = write_tables(
        tmp_path,
        campaign,
        "Zeit,Nord,Ost,Höhe,Nickwinkel,Höhenruder,Höhenruder_Soll",
        lambda f: [
            f.time,
            60.0 * f.pose[:, 0],
            -80.0 * f.pose[:, 0],
            100.0 * f.pose[:, 1],
            -np.degrees(f.pose[:, 2]),
            np.degrees(f.elevator),
            np.degrees(f.command),
        ],
    )
    names = {"y": "Ost", "z": "Höhe", "elevator": "Höhenruder"}
    assert_guessed(files, campaign, tmp_path, **names)


def test_throws_along_minus_y(tmp_path, campaign):
    files = write_tables(
        tmp_path,
        campaign,
        "t,x,y,z,pitch,de,rate",
        lambda f: [
            f.time,
            0.0 * f.time,
            -f.pose[:, 0],
            f.pose[:, 1],
            f.pose[:, 2],
            f.elevator,
            f.command,
        ],
    )
    assert_guessed(files, campaign, tmp_path, y="y", elevator="de")


def test_rates_by_their_suffix_and_an_elevator_that_begins_like_a_position(
    tmp_path, campaign
):
    files = write_tables(
        tmp_path,
        campaign,
        "t_s,px,py,pz,pitch_rad,profundidad_deg,profundidad_cmd_deg_s",
        lambda f: [
            f.time,
            *foreign.position(f).T,
            f.pose[:, 2],
            np.degrees(f.elevator),
            np.degrees(f.command),
        ],
    )
    rate = "profundidad_cmd_deg_s"
    names = {"elevator": "profundidad_deg", "elevator_rate_command": rate}
    assert_guessed(files, campaign, tmp_path, **names)


@pytest.mark.nightly
def test_a_slide_on_the_floor_decides_nothing():
    """Its rows fit no flight in the right frame; those of the flight itself do."""
    flight = bench_guess_foreign.run_one(1, 9)
    assert flight["end"] == "sure", flight["why"]
    slide = bench_guess_foreign.run_one(1, 82)
    assert yaml.safe_load(slide["text"])["frame"]["up"] == "y"
    assert slide["end"] == "sure" or "an import refuses it" in slide["text"]


def in_space(flight):
    """Position (n, 3), thrown along a slanted line, and rotation with some roll."""
    roll, yaw = 0.2 * np.sin(3.0 * flight.time), np.full(len(flight.time), 0.7)
    turn = Rotation.from_euler("ZYX", np.c_[yaw, flight.pose[:, 2], roll])
    return Rotation.from_euler("z", 0.7).apply(foreign.position(flight)), turn


@pytest.mark.parametrize(
    "names",
    [
        "rot_x_deg,rot_y_deg,rot_z_deg",
        pytest.param("q0,q1,q2,q3", marks=pytest.mark.nightly),
    ],
)
def test_vectors_with_units_or_numbers_in_their_names(tmp_path, campaign, names):
    def columns(flight):
        place, turn = in_space(flight)
        angles = turn.as_euler("ZYX", degrees=True)[:, ::-1]
        quaternion = turn.as_quat()[:, [3, 0, 1, 2]]
        values = angles if names.startswith("rot") else quaternion
        return [flight.time, *(100.0 * place.T), *values.T]

    head = f"t_s,pos_x_cm,pos_y_cm,pos_z_cm,{names}"
    files = write_tables(tmp_path, campaign, head, columns)
    stem = names.partition("_")[0] if names.startswith("rot") else "q"
    sure = stem == "q"  # Little roll leaves a question: in which order?
    assert_guessed(files, campaign, tmp_path, sure, position="pos", attitude=stem)


@pytest.mark.parametrize(
    "words",
    [
        pytest.param("roll,pitch,yaw", marks=pytest.mark.nightly),
        "alabeo,cabeceo,guiñada",
    ],
)
def test_roll_pitch_and_yaw(tmp_path, campaign, words):
    """A positive pitch is nose up, though z is up; the rates are no angles."""

    def columns(flight):
        place, turn = in_space(flight)
        roll, pitch, yaw = turn.as_euler("ZYX")[:, ::-1].T
        return [flight.time, *place.T, 0.0 * roll, roll, -pitch, yaw]

    files = write_tables(tmp_path, campaign, f"t,x,y,z,roll_rate,{words}", columns)
    roll, pitch, yaw = words.split(",")
    assert_guessed(files, campaign, tmp_path, roll=roll, pitch=pitch, yaw=yaw)
    assert yaml.safe_load(guess_mapping(files).text)["frame"]["pitch"] == "nose_up"


def test_north_east_down_with_roll_pitch_and_yaw(tmp_path, campaign):
    def columns(flight):
        place, turn = in_space(flight)
        yaw, pitch, roll = turn.as_euler("ZYX", degrees=True).T
        return [flight.time, *(place * [1, -1, -1]).T, roll, -pitch, -yaw]

    files = write_tables(tmp_path, campaign, "t,north,east,down,phi,theta,psi", columns)
    assert_guessed(files, campaign, tmp_path, roll="phi")
    frame = yaml.safe_load(guess_mapping(files).text)["frame"]
    assert frame["up"] == frame["top"] == "-z"


def test_commands_without_a_unit_are_what_the_elevator_shows(tmp_path, campaign):
    files = write_tables(
        tmp_path,
        campaign,
        "temps,px,py,pz,tangage,profondeur,consigne_profondeur",
        lambda f: [
            f.time,
            *foreign.position(f).T,
            f.pose[:, 2],
            f.elevator,
            f.elevator,
        ],
    )
    names = {"elevator": "profondeur", "elevator_angle_command": "consigne_profondeur"}
    assert_guessed(files, campaign, tmp_path, **names)


@pytest.mark.parametrize("name", ["servo", "servo_cmd"])
def test_pulse_widths_of_a_servo_are_a_question(tmp_path, campaign, name):
    files = write_tables(
        tmp_path,
        campaign,
        f"t,x,z,pitch,{name}",
        lambda f: [f.time, *f.pose.T, np.round(1500.0 + 500.0 * f.elevator)],
    )
    text = guess_mapping(files).text
    quantity = "elevator" if name == "servo" else "elevator_angle_command"
    scale = yaml.safe_load(text)["units"][quantity]
    assert scale["zero"] == 1500 and scale["gain"] > 0.0
    assert re.search(rf"{quantity}: {{.*}}  # \? .*microseconds", text)


def test_an_elevator_in_radians_beside_angles_in_degrees(tmp_path, campaign):
    """The unit of each is stated, and the roll has that of the pitch."""

    def columns(flight):
        place, turn = in_space(flight)
        angles = turn.as_euler("ZYX", degrees=True)[:, ::-1] * [0.1, -1.0, 1.0]
        return [flight.time, *place.T, *angles.T, flight.elevator]

    head = "t,x,y,z,roll,pitch,yaw,elevator"
    files = write_tables(tmp_path, campaign, head, columns)
    assert_guessed(files, campaign, tmp_path, elevator="elevator")
    text = guess_mapping(files).text
    units = yaml.safe_load(text)["units"]
    assert units == dict.fromkeys(("roll", "pitch", "yaw"), "deg") | {"elevator": "rad"}
    assert re.search(r"elevator: rad  # \? 'elevator' reaches", text)


def test_the_plane_of_a_video(tmp_path, campaign):
    files = write_tables(
        tmp_path,
        campaign,
        "t,x,y,theta_deg",
        lambda f: [f.time, *f.pose[:, :2].T, np.degrees(f.pose[:, 2])],
    )
    assert_guessed(files, campaign, tmp_path, x="x", z="y", pitch="theta_deg")


def test_a_pitch_off_by_half_a_turn_is_a_question_that_an_import_refuses(
    tmp_path, campaign
):
    files = write_tables(
        tmp_path,
        campaign,
        "Zeit,Länge,Höhe,Nick_deg,Höhenruder_deg",
        lambda f: [
            f.time,
            *f.pose[:, :2].T,
            (360.0 - np.degrees(f.pose[:, 2])) % 360.0 - 180.0,
            np.degrees(f.elevator),
        ],
    )
    text = guess_mapping(files).text + VEHICLE
    assert "x: Länge" in text and "? an import refuses it" in text
    path = tmp_path / "MAP.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match="off by half a turn"):
        read_flights(files, path)
    scale = {"gain": -np.pi / 180.0, "zero": 180.0}
    right = yaml.safe_load(text)
    right["units"] = {**right.get("units", {}), "pitch": scale}
    right["frame"]["pitch"] = "nose_down"
    path.write_text(yaml.safe_dump(right))
    imported = read_flights(files, path).campaign
    for flight, true in zip(imported.flights, campaign.flights, strict=True):
        assert np.abs(flight.pose[5:25, 2] - true.pose[5:25, 2]).max() < 1e-5


@pytest.mark.nightly
@pytest.mark.parametrize(
    "kind, k", [("steep", 0), ("steep", 6), ("loop", 0), ("loop", 1), ("heavy", 3)]
)
def test_right_maps_of_steep_flights_and_loops(kind, k):
    """They go up, over, and slide on their tails; slides on the floor are cut."""
    wrong, after = bench_guess_foreign.run_right(5, k, kind)
    assert not wrong
    assert after < (0.3 if kind == "loop" else 0.02)


def test_a_wrong_beginning_of_names_lists_those_that_are_there(tmp_path, campaign):
    files = foreign.write_motive(tmp_path, campaign)
    path = tmp_path / "MAP.yaml"
    wrong = foreign.MAP_MOTIVE.replace("Glider.P", "Glder.P")
    path.write_text(wrong + foreign.VEHICLE)
    with pytest.raises(InputError, match=r"did you mean '.*Glider\.Position"):
        read_flights(files, path)
