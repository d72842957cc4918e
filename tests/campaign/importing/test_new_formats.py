"""C3D files, markers, matrices and times in ISO 8601 give back the flights."""

import datetime

import numpy as np
import pytest
from scipy.io import savemat

from glider.campaign.importing.campaign_import import read_flights
from glider.campaign.importing.readers import read_recording
from glider.errors import InputError
from tests.campaign.importing import foreign
from tests.campaign.importing.test_import import assert_same

RATE = 120.0


@pytest.fixture(scope="module")
def campaign():
    return foreign.flights("attached_lift")


def values(recording, name):
    return recording.find(name, "test")[1]


# ------------------------------------------------------------------------- C3D


def c3d_of(points, *, rate=RATE, unit="mm"):
    """A C3D file in memory of points by label, (n, 3) each."""
    ezc3d = pytest.importorskip("ezc3d")
    file = ezc3d.c3d()
    file["parameters"]["POINT"]["RATE"]["value"] = [rate]
    file["parameters"]["POINT"]["UNITS"]["value"] = [unit]
    file["parameters"]["POINT"]["LABELS"]["value"] = list(points)
    places = np.stack(list(points.values()), axis=1)  # (n, p, 3)
    data = np.ones((4, places.shape[1], len(places)))
    data[:3] = places.transpose(2, 1, 0)
    file["data"]["points"] = data
    return file


def resampled(flight):
    """A flight at the rate of the cameras, its elevator omitted."""
    time = np.arange(int((flight.time[-1] - flight.time[0]) * RATE)) / RATE
    pose = [np.interp(time, flight.time - flight.time[0], p) for p in flight.pose.T]
    return foreign.dataclasses.replace(flight, time=time, pose=np.stack(pose, axis=1))


def assert_same_motion(imported, flights):
    for flight, true in zip(imported.campaign.flights, flights, strict=True):
        rows = np.searchsorted(true.time, flight.time - 1e-4)
        x, z, pitch = (flight.pose - true.pose[rows]).T
        assert np.ptp(x) < 1e-5 and np.ptp(z) < 1e-5 and np.abs(pitch).max() < 1e-5


def test_markers_without_wing_tips_are_taken_as_level(tmp_path, campaign):
    files = foreign.write_trc(tmp_path, campaign)[::2]
    path = tmp_path / "MAP.yaml"
    path.write_text(
        "columns: {time: Time, position: [X5, Y5, Z5], attitude: {nose: [X1, Y1, Z1], "
        "tail: [X2, Y2, Z2]}}\nunits: {length: mm}\nframe: {up: y}\n"
        "vehicle: {elevator: fixed}\n"
    )
    imported = read_flights(files, path)
    assert_same_motion(imported, campaign.flights)
    for flight, true in zip(imported.campaign.flights, campaign.flights, strict=True):
        assert len(flight.time) == len(true.time) - 2  # In two rows nothing is seen.
        assert np.abs(flight.attitude).max() < 1e-5


def test_one_wing_tip_alone_is_refused(tmp_path):
    path = tmp_path / "MAP.yaml"
    path.write_text("columns: {attitude: {nose: a, tail: b, left: c}}\n")
    with pytest.raises(InputError, match="one of 'left' and 'right'; expected both"):
        read_flights([], path)


@pytest.mark.parametrize("names", ["''", "[]"])
@pytest.mark.parametrize("point", ["nose", "tail", "left", "right"])
def test_a_point_without_a_name_is_refused(tmp_path, point, names):
    columns = dict.fromkeys(("nose", "tail", "left", "right"), "[x, y, z]")
    columns[point] = names
    fields = ", ".join(f"{name}: {own}" for name, own in columns.items())
    path = tmp_path / "MAP.yaml"
    path.write_text(f"columns: {{attitude: {{{fields}}}}}\n")
    with pytest.raises(InputError, match=f"field '{point}' is .*; expected the column"):
        read_flights([], path)


def test_a_c3d_file_has_its_units_rates_and_channels(tmp_path):
    rows = np.arange(12.0)[:, None] * [1.0, 2.0, 3.0]
    file = c3d_of({"G": rows, "K": rows, "": rows, "H": rows}, rate=200.0)
    file["parameters"]["ANALOG"]["RATE"]["value"] = [400.0]
    file["parameters"]["ANALOG"]["LABELS"]["value"] = ["servo", "Time"]
    file["data"]["analogs"] = np.tile(np.linspace(1.0, 2.0, 24), (1, 2, 1))
    file.write(str(tmp_path / "a.c3d"))
    recording = read_recording(tmp_path / "a.c3d")
    x = values(recording, "G.Position.Z")
    assert x.unit == "mm" and np.allclose(x.values, rows[:, 2])
    assert "Point_3.Position.X" in recording.names()
    assert np.allclose(np.diff(recording.groups[0].columns["Time"].values), 0.005)
    servo, column = recording.find("ANALOG.servo", "test")
    assert np.allclose(np.diff(servo.columns["Time"].values), 0.0025)
    assert len(column.values) == 24 and column.values[-1] == pytest.approx(2.0)
    _, named_as_times = recording.find("ANALOG.Time_2", "test")
    assert np.array_equal(named_as_times.values, column.values)


def test_a_c3d_file_without_a_rate_is_refused(tmp_path):
    file = c3d_of({"G": np.ones((5, 3))})
    file.write(str(tmp_path / "a.c3d"))
    content = (tmp_path / "a.c3d").read_bytes()
    rate = np.float32(RATE).tobytes()
    assert rate in content
    (tmp_path / "a.c3d").write_bytes(content.replace(rate, bytes(4)))
    with pytest.raises(InputError, match="POINT:RATE"):
        read_recording(tmp_path / "a.c3d")


# --------------------------------------------------------------------- ISO 8601


@pytest.mark.parametrize(
    ("first", "second", "seconds"),
    [
        ("2024-05-01T10:00:00", "2024-05-01T10:00:01", 1.0),
        ("2024-05-01 10:00:00.25", "2024-05-01 10:00:00.5", 0.25),
        ("2024-05-01T10:00:00.123456Z", "2024-05-01T10:00:00.223456Z", 0.1),
        ("2024-05-01T23:59:59+02:00", "2024-05-01T22:00:01+00:00", 2.0),
        ("20240501T100000Z", "20240501T100001Z", None),  # Read where it has colons.
        ("10:00:00.5", "10:00:00.75", 0.25),
    ],
)
def test_times_in_iso_8601(tmp_path, first, second, seconds):
    path = tmp_path / "log.csv"
    rows = "".join(f"{first if i == 0 else second},{i}.5\n" for i in range(4))
    path.write_text("time,x\n" + rows)
    column = read_recording(path).groups[0].columns["time"]
    if seconds is None:
        assert "expected a number" in column.fault
    else:
        assert column.unit == "s"
        assert column.values[:2] == pytest.approx([0.0, seconds], abs=1e-6)


def test_a_time_that_is_none_is_refused_with_its_row(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text(
        "time,x\n2024-05-01T10:00:00,1\n2024-05-01T10:00:01,2\n2024-13-01T10:00,3\n"
        "2024-05-01T10:00:03,4\n"
    )
    with pytest.raises(InputError, match="row 2: found '2024-05-01T10:00:00'"):
        values(read_recording(path), "time")


def test_csv_files_with_iso_8601_times_give_back_the_flights(tmp_path, campaign):
    files = foreign.write_csv(tmp_path, campaign)
    begin = datetime.datetime(2026, 5, 1, 23, 59, 59, tzinfo=datetime.UTC)
    for file in files:
        lines = file.read_bytes().decode("cp1252").splitlines()
        for i in range(3, len(lines)):
            time, _, rest = lines[i].partition(";")
            milliseconds = float(time.replace(",", "."))
            stamp = begin + datetime.timedelta(milliseconds=milliseconds)
            lines[i] = f"{stamp.isoformat()};{rest}"
        lines[2] = lines[2].replace("ms;", ";")
        file.write_text("\n".join(lines))
    path = tmp_path / "MAP.yaml"
    path.write_text(foreign.MAP_CSV.replace("time: ms, ", "") + foreign.VEHICLE)
    assert_same(read_flights(files, path).campaign, campaign, "csv")


def test_joined_files_with_iso_8601_times_keep_their_common_clock(tmp_path, campaign):
    [flight] = campaign.flights[:1]
    begin = datetime.datetime(2026, 5, 1, 10, tzinfo=datetime.UTC)

    def stamps(times):
        return [
            (begin + datetime.timedelta(seconds=float(t))).isoformat() for t in times
        ]

    poses = [
        f"{s},{x!r},{z!r},{p!r}"
        for s, (x, z, p) in zip(stamps(flight.time), flight.pose.tolist(), strict=True)
    ]
    (tmp_path / "a_poses.csv").write_text("\n".join(["t,x,z,pitch", *poses]))
    rest = np.arange(1, 61) / RATE
    time = np.concatenate([flight.time[0] - rest[::-1], flight.time])
    angle, rate = np.pad(flight.elevator, (60, 0)), np.pad(flight.command, (60, 0))
    servo = [
        f"{s},{a!r},{r!r}"
        for s, a, r in zip(stamps(time), angle.tolist(), rate.tolist(), strict=True)
    ]
    (tmp_path / "a_servo.csv").write_text("\n".join(["t,de,rate", *servo]))
    path = tmp_path / "MAP.yaml"
    path.write_text(
        'join: ["*_poses.csv", "*_servo.csv"]\nclock: same\n'
        "columns: {time: t, x: x, z: z, pitch: pitch, elevator: de, "
        "elevator_rate_command: rate}\n" + foreign.VEHICLE
    )
    [imported] = read_flights(sorted(tmp_path.glob("*.csv")), path).campaign.flights
    rows = np.searchsorted(flight.time - flight.time[0], imported.time - 1e-4)
    assert np.allclose(imported.elevator, flight.elevator[rows], atol=1e-4)


# ---------------------------------------------------------- markers and matrices


def video(folder, campaign):
    """Points at nose and tail in a plane, as Tracker exports them."""
    files = []
    for k, flight in enumerate(campaign.flights):
        x, z, pitch = flight.pose.T
        along = np.column_stack([np.cos(pitch), -np.sin(pitch)])
        nose, tail = (np.column_stack([x, z]) + c * along for c in (0.2, -0.3))
        rows = np.column_stack([flight.time, nose, tail])
        head = "#multi:\n\tnose\t\ttail\t\t\nt\tx\ty\tx\ty\t\n"
        lines = ("\t".join(f"{v:.9E}" for v in row) + "\t" for row in rows)
        files.append(folder / f"throw{k}.txt")
        files[-1].write_text(head + "\n".join(lines) + "\n")
    return files


@pytest.mark.parametrize(
    "columns",
    [
        "position: nose, attitude: {nose: nose, tail: tail}",
        "position: [nose.x, nose.y], attitude: {nose: [nose.x, nose.y], tail: tail}",
        "x: nose.x, y: nose.y, attitude: {nose: nose, tail: tail}",
    ],
)
def test_two_points_of_a_video_give_the_pitch(tmp_path, campaign, columns):
    files = video(tmp_path, campaign)
    path = tmp_path / "MAP.yaml"
    text = f"columns: {{time: t, {columns}}}\nvehicle: {{elevator: fixed_per_flight}}\n"
    frame = "frame: {up: y, tracked_point: [0.2, 0.0]}\n"
    path.write_text(text + frame)
    assert_same_motion(read_flights(files, path), campaign.flights)
    path.write_text(text + frame.replace("up: y", "up: -y"))
    with pytest.raises(InputError, match="up"):
        read_flights(files, path)


def test_points_in_a_plane_show_no_roll(tmp_path, campaign):
    path = tmp_path / "MAP.yaml"
    markers = "{nose: nose, tail: tail, left: nose, right: tail}"
    path.write_text(
        f"columns: {{time: t, position: nose, attitude: {markers}}}\n"
        "frame: {up: y}\nvehicle: {elevator: fixed_per_flight}\n"
    )
    with pytest.raises(InputError, match="in a plane a position, nose and tail"):
        read_flights(video(tmp_path, campaign), path)


@pytest.mark.parametrize("named", [True, False])
def test_a_rotation_matrix_row_by_row(tmp_path, campaign, named):
    """Nine columns, or an array of matrices in a .mat file; zeros are not seen."""
    entries = [f"r{i}{j}" for i in range(1, 4) for j in range(1, 4)]
    files = []
    for k, flight in enumerate(campaign.flights):
        turns = foreign.rotation(flight).as_matrix()
        turns[30] = 0.0
        place = foreign.position(flight)
        if named:
            path, names = tmp_path / f"log{k}.csv", ",".join(["t,x,y,z", *entries])
            columns = flight.time, place, turns.reshape(-1, 9)
            files.append(foreign.write_table(path, names, *columns))
        else:
            files.append(tmp_path / f"log{k}.mat")
            content = {"t": flight.time, "p": place, "R": np.moveaxis(turns, 0, 2)}
            savemat(files[-1], content)
    own = f"x: x, y: y, z: z, attitude: [{', '.join(entries)}]"
    own = own if named else "position: p, attitude: R"
    path = tmp_path / "MAP.yaml"
    text = f"columns: {{time: t, {own}}}\nvehicle: {{elevator: fixed_per_flight}}\n"
    path.write_text(text)
    imported = read_flights(files, path).campaign
    for flight, true in zip(imported.flights, campaign.flights, strict=True):
        assert np.abs(flight.pose[5:25, 2] - true.pose[5:25, 2]).max() < 1e-6
