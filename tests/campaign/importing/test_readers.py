"""Each reader on files of its format, and one sentence where a file is none."""

import builtins
import contextlib
import os
import signal
import sqlite3
import time
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from glider.campaign.importing.formats import FORMAT_NAMES, FORMATS
from glider.campaign.importing.readers import c3d, read_recording
from glider.errors import InputError
from tests.campaign.importing import foreign


def values(table, name):
    return table.find(name, "test")[1]


@pytest.mark.parametrize(
    ("text", "name", "unit", "first"),
    [
        ("t,x\n0,1.5\n1,2\n2,3\n", "x", None, 1.5),
        ("# made by me\n#t;x [mm]\n0;1,5\n1;2,0\n2;3,0\n", "x", "mm", 1.5),
        ("t\tpitch_deg\n0\t1e1\n1\t2\n2\t3\n", "pitch_deg", "deg", 10.0),
        ("log of today\n\nt x\n s mm\n0 1.5\n1 2\n2 3\n", "x", "mm", 1.5),
        ('"t","x (m)"\n0,1.5\n1,NaN\n2,3\n', "x", "m", 1.5),
        ("t;x;\n0;1.5;\n1;2;\n2;3;\n", "x", None, 1.5),
        ('t,x\n"0,0","1,5"\n"0,1","2,5"\n"0,2","3,5"\n', "x", None, 1.5),
        ("t,x\n0,1.5\n1,2\n2,3\n" + 60 * ",\n" + "END\n", "x", None, 1.5),
        ("t,x\n0,1.5\n1,2\n2,3\n\nt,x\n3,3\n", "x", None, 1.5),
        ("t,x,U\ns,mm,V\n0,1.5,1\n1,2,1\n2,3,1\n", "x", "mm", 1.5),
        ("t,x,U,U\n0,1.5,1,1\n1,2,1,1\n2,3,1,1\n", "x", None, 1.5),
        ("t,x\n0,1.5\n1,#N/A\n2,3\n", "x", None, 1.5),
        ("t,x\n0,1.5\n1,-nan(ind)\n2,3\n", "x", None, 1.5),
        ("t,x\n0,1.5\n1,-1.#IND00\n2,3\n", "x", None, 1.5),
        ("t;x\n0;1,5\n1;1,#QNAN\n2;3\n", "x", None, 1.5),
        ("t,x\n0,1.5\n1,missing\n2,+inf\n", "x", None, 1.5),
        ("t [s],x []\n0,1.5\n1,2\n2,3\n", "x", None, 1.5),
        ("t [s],x [-]\n0,1.5\n1,2\n2,3\n", "x", None, 1.5),
        ("# t x\n0 1.5\n1 2\n2 3\n", "x", None, 1.5),
        ("#\tt\tmy x\n0\t1.5\n1\t2\n2\t3\n", "my x", None, 1.5),
        ("# made by me\n# t x y\n0 1.5 1\n1 2 1\n2 3 1\n", "x", None, 1.5),
        ("% t, x [mm]\n0 1.5\n1 2\n2 3\n", "x", "mm", 1.5),
        ("# t x [mm]\n0,1.5\n1,2\n2,3\n", "x", "mm", 1.5),
        ("#,t,x\n7,0,1.5\n8,1,2\n9,2,3\n", "x", None, 1.5),
        ("0:00:00:000 is first\nt,x\n0,1.5\n1,2\n2,3\n", "x", None, 1.5),
        (
            ",Position,,Rate,\nt,x,z,x,z\ns,m,m,deg/s,deg/s\n0,1,1,1.5,2\n"
            + 2 * "0,1,1,1,2\n",
            "Rate.x",
            "deg/s",
            1.5,
        ),
    ],
)
def test_dialects(tmp_path, text, name, unit, first):
    path = tmp_path / "log.csv"
    path.write_text(text)
    column = values(read_recording(path), name)
    assert (
        column.values[0] == first
        and column.unit == unit
        and len(column.values) in (3, 4)
    )


@pytest.mark.parametrize(
    ("cells", "seconds"),
    [
        (["0:00:00:000", "0:00:00:033", "0:01:02:500"], [0.0, 0.033, 62.5]),
        (["0:59.9", "1:00.0", "1:01.25"], [0.0, 0.1, 1.35]),
        (["59.9", "1:00.0", "1:01.25"], [0.0, 0.1, 1.35]),
        (["25:00:00.0", "25:00:01", "25:00:02"], [0.0, 1.0, 2.0]),
        (["-0:00:00:100", "0:00:00:000", "0:00:00:100"], [0.0, 0.1, 0.2]),
        (["10:00:00,5", "10:00:01,5", "10:00:02,75"], [0.0, 1.0, 2.25]),
    ],
)
def test_times_by_a_clock(tmp_path, cells, seconds):
    path = tmp_path / "log.csv"
    rows = "".join(f"{cell};1\n" for cell in cells)
    path.write_text(f"t;x\n{rows}")
    column = values(read_recording(path), "t")
    assert np.allclose(column.values, seconds)


def test_frames_of_a_clock_are_no_times(tmp_path):
    """In hh:mm:ss:ff the last number counts frames of an unknown rate."""
    path = tmp_path / "log.csv"
    path.write_text("t;x\n" + "".join(f"00:00:00:0{k};{k}\n" for k in range(5)))
    with pytest.raises(InputError, match=r"found '00:00:00:00'; expected a time"):
        values(read_recording(path), "t")


def test_a_name_of_two_columns_cannot_be_mapped(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("t,x,x\n0,1,1\n1,2,1\n2,3,1\n")
    with pytest.raises(InputError, match="two columns are named 'x'"):
        values(read_recording(path), "x")


@pytest.mark.parametrize(
    "content",
    [{"x": np.zeros((100, 20))}, {"T": np.uint32([[3707764736, 2, 1, 1, 1, 1]])}],
)
def test_a_mat_file_without_vectors_says_how_to_save_them(tmp_path, content):
    """As of a matrix with a column a flight, or what a table is in version 7.3."""
    savemat(tmp_path / "a.mat", content)
    with pytest.raises(InputError, match=r"of up to 16 .*array of structs.*table2s"):
        read_recording(tmp_path / "a.mat")


def test_utf16_and_bad_cells(tmp_path):
    path = tmp_path / "log.txt"
    path.write_text("t,x\n0,1\n1,2\n2,abc\n3,4\n4,5\n5,6\n", encoding="utf-16")
    table = read_recording(path)
    assert values(table, "t").values[-1] == 5.0
    with pytest.raises(InputError, match="row 4: found 'abc'"):
        values(table, "x")
    with pytest.raises(InputError, match=r"did you mean 't'"):
        values(table, "tt")


VICON = """\
Objects
200
,,Global Angle Lab:Glider,,,,,
Frame,Sub Frame,RX,RY,RZ,TX,TY,TZ
,,rad,rad,rad,mm,mm,mm
11,0,0.1,0.2,0.3,1000,2000,3000
12,0,0.1,0.2,0.3,0,0,0
13,0,,,,,,
14,0,0.1,0.2,0.3,1100,2000,3000
"""


def test_vicon(tmp_path):
    path = tmp_path / "trial.csv"
    path.write_text(VICON)
    table = read_recording(path)
    x = values(table, "Lab:Glider.Position.X")
    assert x.unit == "mm" and np.isnan(x.values[2]) and x.values[3] == 1100
    assert np.allclose(values(table, "Time").values, [0, 0.005, 0.01, 0.015])
    assert values(table, "Lab:Glider.Rotation.Y").values[0] == 0.2


@pytest.mark.parametrize("body", ["glider", "my.glider"])
def test_qtm(tmp_path, body):
    """A residual of -1 marks rows in which a body is not seen."""
    [flight] = foreign.flights(count=1).flights
    path = tmp_path / "take_6d.tsv"
    path.write_text(foreign.qtm_text(flight).replace("glider", body))
    table = read_recording(path)
    x = values(table, f"{body}.Position.X")
    assert x.unit == "mm" and np.flatnonzero(np.isnan(x.values)).tolist() == [30, 31]
    turns = [values(table, f"{body}.Rotation[{k}]").values for k in range(9)]
    seen = np.delete(np.arange(len(flight.time)), [30, 31])
    true = foreign.rotation(flight).as_matrix().reshape(-1, 9)
    assert np.allclose(np.stack(turns, axis=1)[seen], true[seen], atol=1e-8)
    pitch = values(table, f"{body}.Pitch")
    assert pitch.unit == "deg" and np.isnan(pitch.values[30])
    assert np.allclose(pitch.values[seen], np.degrees(flight.pose[seen, 2]), atol=1e-6)
    time = values(table, "Time").values
    assert np.allclose(time, flight.time - flight.time[0], atol=1e-6)


def test_qtm_with_markers_and_without_times(tmp_path):
    head = "NO_OF_FRAMES\t3\nFREQUENCY\t100\nDATA_INCLUDED\t3D\nMARKER_NAMES\ta\tb c\n"
    path = tmp_path / "take.tsv"
    numbers = "1\t2\t3\t4\t5\t6\n" + 2 * "0\t0\t0\t7\t8\t9\n"
    path.write_text(head + "a X\tY\tZ\tb c X\tY\tZ\n" + numbers)
    table = read_recording(path)
    assert values(table, "b c.Position.Y").values.tolist() == [5.0, 8.0, 8.0]
    assert np.allclose(values(table, "Time").values, [0.0, 0.01, 0.02])
    for rate in ("\t100", "\tEXT"), ("\tEXT", ""):
        path.write_text(path.read_text().replace(*rate))
        with pytest.raises(InputError, match="without times, or a FREQUENCY"):
            read_recording(path)
    for text in (head + numbers, "NO_OF_FRAMES\t3\nDATA_INCLUDED\t2D\n1\t2\n1\t2\n"):
        path.write_text(text)
        with pytest.raises(InputError, match="without 6D or 3D data, or the row"):
            read_recording(path)


def test_a_mat_file_of_qtm_is_named(tmp_path):
    own = {"FrameRate": 120, "Frames": 30, "Positions": np.zeros((1, 3, 30))}
    savemat(tmp_path / "a.mat", {"take": own})
    with pytest.raises(InputError, match=r"a \.mat file of QTM.*6D data as TSV"):
        read_recording(tmp_path / "a.mat")


def test_trc(tmp_path):
    """Names are in two rows of its header, one below the other."""
    path = tmp_path / "a.trc"
    path.write_text(
        "PathFileType\t4\t(X/Y/Z)\ta.trc\nDataRate\tUnits\n100\tm\n"
        "Frame#\tTime\tnose\t\t\ttail\t\t\n\t\tX1\tY1\tZ1\tX2\tY2\tZ2\n\n"
        "1\t0.00\t1\t2\t3\t4\t5\t6\n2\t0.01\t1\t2\t3\t0\t0\t0\n"
        "3\t0.02\t1\t2\t3\t4\t5\t6\n"
    )
    table = read_recording(path)
    assert values(table, "Time").values.tolist() == [0.0, 0.01, 0.02]
    assert values(table, "X2").values.tolist() == [4.0, 0.0, 4.0]


def kill_process(path):
    os.kill(os.getpid(), signal.SIGKILL)


def hang(path):
    time.sleep(60.0)


def test_a_refused_c3d_file_says_why(tmp_path, monkeypatch):
    """By what its library says, or as damaged where that crashes or hangs."""
    pytest.importorskip("ezc3d")
    path = tmp_path / "take.c3d"
    path.write_bytes(b"x")
    with pytest.raises(InputError, match=r"not readable as C3D: .*\w\.$"):
        read_recording(path)
    monkeypatch.setattr(c3d, "_TIMEOUT", 0.5)
    for fails in (kill_process, hang):
        monkeypatch.setattr(c3d, "_read_file", fails)
        with pytest.raises(InputError) as caught:
            read_recording(path)
        assert str(caught.value) == f"{path}: not readable as C3D: it is damaged."


def test_one_list_of_formats():
    """The table of the docs, the README and the readers have those of FORMATS."""
    root = Path(__file__).parents[3]
    page = (root / "docs" / "import.md").read_text(encoding="utf-8")
    rows = page.partition("| format | needs |")[2].partition("\n\n")[0].split("\n")[2:]
    cells = [[cell.strip() for cell in row.split("|")[1:3]] for row in rows]
    for format, (name, needs) in zip(FORMATS, cells, strict=True):
        assert name.startswith(format.name) and needs.startswith(format.library)
    readme = " ".join((root / "README.md").read_text(encoding="utf-8").split())
    assert f"The importer reads {FORMAT_NAMES}, and data frames" in readme
    project = (root / "pyproject.toml").read_text(encoding="utf-8")
    extra = project.partition("\nimport = [")[2].partition("]\n#")[0]
    needed = {format.library for format in FORMATS} - {"", "mcap"}
    assert all(f'"{library}' in extra for library in needed)


@pytest.mark.parametrize("ros", [1, 2])
def test_ros_bags(tmp_path, ros):
    rosbag1 = pytest.importorskip("rosbags.rosbag1")
    rosbag2 = pytest.importorskip("rosbags.rosbag2")
    from rosbags.typesys import Stores, get_typestore

    [flight] = foreign.flights(count=1).flights
    store = get_typestore(Stores.ROS1_NOETIC if ros == 1 else Stores.ROS2_HUMBLE)
    kind = "geometry_msgs/msg/PoseStamped"
    path = tmp_path / ("log.bag" if ros == 1 else "log")
    writer = rosbag1.Writer(path) if ros == 1 else rosbag2.Writer(path, version=9)
    with writer:
        channel = writer.add_connection("/pose", kind, typestore=store)
        for i in range(5):
            stamp = 10**9 + 10**7 * i
            seq = i if ros == 1 else None
            message = foreign.pose_message(store, flight, i, stamp, seq)
            encode = store.serialize_ros1 if ros == 1 else store.serialize_cdr
            writer.write(channel, stamp + 10**6, encode(message, kind))
    raw = read_recording(path)
    assert np.allclose(values(raw, "/pose.time").values, 1.0 + 0.01 * np.arange(5))
    assert np.allclose(values(raw, "pose.position.x").values, flight.pose[:5, 0])
    if ros == 2:
        assert len(read_recording(next(path.glob("*.db3"))).groups) == 1


def write_bag(path, types, messages, store):
    """A bag of ROS 2 of (topic, type, message) at 100 Hz."""
    writer = pytest.importorskip("rosbags.rosbag2").Writer(path, version=9)
    with writer:
        channels = {
            topic: writer.add_connection(topic, kind, typestore=store)
            for topic, kind in types.items()
        }
        for i, (topic, message) in enumerate(messages):
            data = store.serialize_cdr(message, types[topic])
            writer.write(channels[topic], 10**9 + 10**7 * i, data)


@pytest.fixture
def ros():
    pytest.importorskip("rosbags")
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    servo = get_types_from_msg("float64 angle\n", "our_msgs/msg/Servo")
    store.register(servo)
    return store


def transform(store, name, x, i):
    types = store.types
    time = types["builtin_interfaces/msg/Time"](1, 10**7 * i)
    return types["geometry_msgs/msg/TransformStamped"](
        types["std_msgs/msg/Header"](time, "world"),
        name,
        types["geometry_msgs/msg/Transform"](
            types["geometry_msgs/msg/Vector3"](x, 0.0, 1.0),
            types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0),
        ),
    )


@pytest.mark.parametrize("together", [True, False])
def test_bodies_of_a_topic_have_columns_by_name(tmp_path, ros, together):
    """In one message, where an index tells them apart too, or in messages in turn."""
    make = ros.types["tf2_msgs/msg/TFMessage"]
    messages = []
    for i in range(30):
        both = [transform(ros, "lab/wand", 9.0, i), transform(ros, "bird", 0.1 * i, i)]
        messages += [make(both)] if together else [make([one]) for one in both]
    path = tmp_path / "bag"
    named = [("/tf", message) for message in messages]
    write_bag(path, {"/tf": "tf2_msgs/msg/TFMessage"}, named, ros)
    table = read_recording(path)
    bird = values(table, "/tf[bird].transform.translation.x").values
    assert np.allclose(bird, 0.1 * np.arange(30))
    assert np.allclose(values(table, "/tf[lab/wand].transform.translation.x").values, 9)
    assert np.allclose(values(table, "/tf[bird].time").values, 1 + 0.01 * np.arange(30))
    if together:
        own = values(table, "/tf.transforms[1].transform.translation.x").values
        assert np.allclose(own, bird)
        return
    with pytest.raises(
        InputError, match=r"bodies in turn; expected a column of one: /tf\[bird"
    ):
        values(table, "/tf.transforms[0].transform.translation.x")


def test_a_topic_whose_messages_are_of_several_bodies(tmp_path, ros):
    path, kind = tmp_path / "bag", "geometry_msgs/msg/TransformStamped"
    pairs = [("wand", 9.0), ("bird", 1.0)] * 20
    messages = [("/pose", transform(ros, n, x, i)) for i, (n, x) in enumerate(pairs)]
    write_bag(path, {"/pose": kind}, messages, ros)
    table = read_recording(path)
    own = values(table, "/pose[bird].transform.translation.x").values
    assert own.tolist() == [1.0] * 20
    with pytest.raises(InputError, match="are of 2 bodies in turn"):
        values(table, "/pose.transform.translation.x")
    write_bag(tmp_path / "one", {"/pose": kind}, messages[::2], ros)
    names = read_recording(tmp_path / "one").names()
    assert "/pose.transform.translation.x" in names
    assert not any("[" in name for name in names)


def without_definitions(bag):
    """Removes the definitions of messages, which older bags do not have."""
    [file] = bag.glob("*.db3")
    with contextlib.closing(sqlite3.connect(file)) as base:
        base.execute("DELETE FROM message_definitions")
        base.execute("UPDATE topics SET type_description_hash = ''")
        base.commit()


@pytest.mark.parametrize("alone", [True, False])
def test_a_bag_without_definitions_says_how_to_give_them(tmp_path, ros, alone):
    path = tmp_path / "bag"
    types = {"/servo": "our_msgs/msg/Servo", "/pose": "geometry_msgs/msg/Point"}
    point = ros.types["geometry_msgs/msg/Point"](1.0, 2.0, 3.0)
    messages = [("/servo", ros.types["our_msgs/msg/Servo"](0.5))] * 5
    messages += [] if alone else [("/pose", point)] * 5
    types = {topic: types[topic] for topic, _ in messages}
    write_bag(path, types, messages, ros)
    without_definitions(path)
    with pytest.raises(InputError, match=r"definition of its type.*our_msgs"):
        values(read_recording(path), "/servo.angle")
    definition = tmp_path / "our_msgs" / "msg" / "Servo.msg"
    definition.parent.mkdir(parents=True)
    definition.write_text("float64 angle\n")
    assert values(read_recording(path), "/servo.angle").values.tolist() == [0.5] * 5


def test_an_instance_of_a_message_is_a_group(tmp_path):
    """Two EKF cores of ArduPilot log in turn; units tell which field counts them."""
    pytest.importorskip("pymavlink")
    lines = [
        "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns",
        "FMT, 129, 44, FMTU, QBNN, TimeUS,FmtType,UnitIds,MultIds",
        "FMT, 35, 16, XKF1, QBf, TimeUS,C,PN",
        "FMTU, 1, 35, s#m, F-0",
        "MODE, an unknown message",
    ]
    for i in range(6):
        lines += [f"XKF1, {1000 * i}, {core}, {i + 10 * core}.5" for core in (0, 1)]
    path = tmp_path / "1.log"
    path.write_text("\n".join([*lines, ""]))
    table = read_recording(path)
    assert values(table, "XKF1.PN").values.tolist() == [i + 0.5 for i in range(6)]
    assert values(table, "XKF1_1.PN").values[0] == 10.5
    assert values(table, "XKF1_1.TimeUS").unit == "us"


@pytest.mark.parametrize("suffix", ["ulg", "mat", "mcap", "bag", "db3", "csv", "c3d"])
def test_a_file_that_is_something_else_is_refused(tmp_path, suffix):
    path = tmp_path / f"log.{suffix}"
    path.write_bytes(b"\x00\x01 nothing that any of them knows \x00" * 20)
    with pytest.raises(InputError) as caught:
        read_recording(path)
    assert str(path) in str(caught.value) or str(tmp_path) in str(caught.value)


@pytest.mark.parametrize(
    ("suffix", "module"),
    [
        ("ulg", "pyulog"),
        ("bin", "pymavlink"),
        ("mcap", "mcap"),
        ("bag", "rosbags"),
        ("c3d", "ezc3d"),
    ],
)
def test_a_missing_library_says_what_to_install(tmp_path, monkeypatch, suffix, module):
    path = tmp_path / f"log.{suffix}"
    path.write_bytes(b"\xa3\x95" if suffix == "bin" else b"x")
    real = builtins.__import__

    def refuse(name, *args, **kwargs):
        if name.partition(".")[0] == module:
            raise ImportError(name)
        return real(name, *args, **kwargs)

    monkeypatch.setattr("importlib.import_module", refuse)
    with pytest.raises(InputError, match=rf"needs {module}.*drake-glider\[import\]"):
        read_recording(path)


def test_a_mat_file_has_its_columns_in_one_order(tmp_path, monkeypatch):
    """Pymatreader's order of names changes from run to run; a guess must not."""
    pymatreader = pytest.importorskip("pymatreader")
    path = foreign.write_mat(tmp_path, foreign.flights(count=2))[1]  # Of version 7.3.
    read, names = pymatreader.read_mat, []
    for step in (1, -1):

        def shuffled(path, step=step):
            return {"log": dict(list(read(path)["log"].items())[::step])}

        monkeypatch.setattr(pymatreader, "read_mat", shuffled)
        names.append(read_recording(path).names())
    assert names[0] == names[1] and len(names[0]) == 9
