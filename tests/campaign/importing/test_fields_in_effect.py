"""Every column of a MAP has an effect, or the MAP is refused; angles have senses."""

import numpy as np
import pytest
import yaml

from glider.campaign.importing.campaign_import import read_flights
from glider.errors import InputError
from tests.campaign.importing import foreign

ANGLES = ("roll", "pitch", "yaw")


@pytest.fixture(scope="module")
def campaign():
    return foreign.flights("attached_lift")


def write_angles(folder, campaign, sign):
    """Roll, pitch and yaw in radians, z up; pitch positive nose up for sign -1."""
    files = []
    for k, flight in enumerate(campaign.flights):
        x, z, pitch = flight.pose.T
        small = 0.01 * np.sin(np.arange(len(x)))
        columns = (flight.time, x, small, z, small, sign * pitch, -small)
        path = folder / f"take_{k}.csv"
        foreign.write_table(path, "time,x,y,z,roll,pitch,yaw", *columns)
        files.append(path)
    return files


def mapping_of(folder, frame, columns=ANGLES):
    path = folder / "MAP.yaml"
    mapped = {name: name for name in ("x", "y", "z", *columns)}
    fields = {"columns": mapped, "frame": frame, "vehicle": {"elevator": "fixed"}}
    path.write_text(yaml.safe_dump(fields))
    return path


@pytest.mark.nightly
@pytest.mark.parametrize("columns", [ANGLES, ("pitch",)])
@pytest.mark.parametrize(("pitch", "sign"), [("nose_up", -1.0), ("nose_down", 1.0)])
def test_the_sense_of_a_pitch_beside_roll_and_yaw(
    tmp_path, campaign, columns, pitch, sign
):
    files = write_angles(tmp_path, campaign, sign)
    frame = {"forward": "x", "pitch": pitch}
    imported = read_flights(files, mapping_of(tmp_path, frame, columns))
    for flight, true in zip(imported.campaign.flights, campaign.flights, strict=True):
        assert np.allclose(flight.pose, true.pose, atol=1e-7)
        if columns == ANGLES:
            small = 0.01 * np.sin(np.arange(len(true.time)))
            assert np.allclose(flight.attitude[:, 1], small, atol=1e-7)
    other = {"nose_up": "nose_down", "nose_down": "nose_up"}[pitch]
    frame["pitch"] = other
    with pytest.raises(InputError, match="sign of the pitch is reversed"):
        read_flights(files, mapping_of(tmp_path, frame, columns))


def test_the_sense_of_a_pitch_in_a_list_of_angles(tmp_path, campaign):
    files = write_angles(tmp_path, campaign, -1.0)
    frame = {"forward": "x", "pitch": "nose_up", "rotation": "ZYX"}
    path = mapping_of(tmp_path, frame, ())
    fields = yaml.safe_load(path.read_text())
    fields["columns"]["attitude"] = list(ANGLES)
    path.write_text(yaml.safe_dump(fields))
    imported = read_flights(files, path).campaign
    assert np.allclose(imported.flights[0].pose, campaign.flights[0].pose, atol=1e-7)


def test_the_sense_of_a_pitch_in_ned_axes(tmp_path, campaign):
    """There a turn about the body's y is nose up already."""
    files = write_angles(tmp_path, campaign, -1.0)
    for file in files:
        table = np.loadtxt(file, delimiter=",", skiprows=1)
        table[:, [2, 3, 6]] *= -1.0
        foreign.write_table(file, "time,x,y,z,roll,pitch,yaw", table)
    for frame in ({"axes": "NED"}, {"axes": "NED", "pitch": "nose_up"}):
        path = mapping_of(tmp_path, frame | {"forward": "x"})
        [flight, *_] = read_flights(files, path).campaign.flights
        assert np.allclose(flight.pose, campaign.flights[0].pose, atol=1e-7)


def test_the_order_of_named_angles(tmp_path, campaign):
    """Each turns about its own axis, in whatever order."""
    files = write_angles(tmp_path, campaign, 1.0)
    frame = {"forward": "x", "rotation": "XYZ"}
    [flight, *_] = read_flights(files, mapping_of(tmp_path, frame)).campaign.flights
    assert np.allclose(flight.pose[:, 2], campaign.flights[0].pose[:, 2], atol=1e-3)


@pytest.mark.parametrize(
    ("file", "change", "words"),
    [
        ("csv", {"columns": {"roll": "Nick"}}, "'roll' has no effect without all"),
        ("csv", {"columns": {"attitude": "q"}}, "'pitch' has no effect beside 'att"),
        ("csv", {"columns": {"position": "p"}}, "'x' has no effect beside 'position'"),
        ("csv", {"columns": {"elevator_angle_command": "de"}}, "'elevator_rate_comm"),
        (
            "csv",
            {"columns": {"elevator_rate_command": "de"}},
            "quantities is .*de.* two",
        ),
        ("csv", {"columns": {"x": "down"}}, "quantities is .*down.*expected two"),
        (
            "mat",
            {"frame": {"nose": "y", "pitch": "nose_up"}},
            "expected nose and top along x and z",
        ),
    ],
)
def test_a_column_without_effect_is_refused(tmp_path, campaign, file, change, words):
    write, text = foreign.FORMATS[file]
    fields = yaml.safe_load(text + foreign.VEHICLE)
    if isinstance(fields.get("frame"), str):
        fields["frame"] = {"axes": fields["frame"]}
    for name, more in change.items():
        fields[name] = fields.get(name, {}) | more
    path = tmp_path / "MAP.yaml"
    path.write_text(yaml.safe_dump(fields))
    with pytest.raises(InputError, match=words):
        read_flights(write(tmp_path, campaign), path)


def test_the_order_of_listed_quaternions(tmp_path, campaign):
    """By their names, or by 'rotation'; both must agree."""
    files = []
    for k, flight in enumerate(campaign.flights):
        turn = foreign.rotation(flight).as_quat()
        columns = flight.time, foreign.position(flight), turn, turn[:, [3, 0, 1, 2]]
        names = "time,x,y,z,qx,qy,qz,qw,a,b,c,d"
        files.append(foreign.write_table(tmp_path / f"take_{k}.csv", names, *columns))

    def read(names, rotation=None):
        frame = {"forward": "x"} | ({"rotation": rotation} if rotation else {})
        path = mapping_of(tmp_path, frame, ())
        fields = yaml.safe_load(path.read_text())
        fields["columns"]["attitude"] = names
        path.write_text(yaml.safe_dump(fields))
        return read_flights(files, path).campaign.flights[0].pose

    pose = campaign.flights[0].pose
    assert np.allclose(read(["qx", "qy", "qz", "qw"]), pose, atol=1e-6)
    assert np.allclose(read(["qw", "qx", "qy", "qz"]), pose, atol=1e-6)
    assert np.allclose(read(["qw", "qx", "qy", "qz"], "wxyz"), pose, atol=1e-6)
    assert np.allclose(read(["a", "b", "c", "d"], "wxyz"), pose, atol=1e-6)
    with pytest.raises(InputError, match="expected xyzw, the order of the quaternion"):
        read(["qx", "qy", "qz", "qw"], "wxyz")
    with pytest.raises(InputError, match="order of the quaternion's four numbers"):
        read(["a", "b", "c", "d"])
