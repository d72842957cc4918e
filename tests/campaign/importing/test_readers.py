"""Each reader on files of its format, and one sentence where a file is none."""

import builtins
import gzip

import numpy as np
import pytest
from scipy.io import savemat

from glider.campaign.importing.readers import read_recording
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
        (
            ",Position,,Speed,\nt,x,z,x,z\ns,m,m,m/s,m/s\n0,1,1,1.5,2\n"
            + 2 * "0,1,1,1,2\n",
            "Speed.x",
            "m/s",
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
    path.with_suffix(".csv.gz").write_bytes(gzip.compress(text.encode()))
    packed = values(read_recording(path.with_suffix(".csv.gz")), name)
    np.testing.assert_array_equal(packed.values, column.values)


def test_a_name_of_two_columns_cannot_be_mapped(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("t,x,x\n0,1,1\n1,2,1\n2,3,1\n")
    with pytest.raises(InputError, match="two columns are named 'x'"):
        values(read_recording(path), "x")


def test_a_damaged_gzip_is_refused(tmp_path):
    packed = gzip.compress(b"t,x\n0,1.5\n1,2\n2,3\n")
    for content in (b"t,x\n0,1\n", packed[:-9], packed[:12] + b"???" + packed[15:]):
        (tmp_path / "log.csv.gz").write_bytes(content)
        with pytest.raises(InputError, match=r"log\.csv\.gz: cannot be read: ."):
            read_recording(tmp_path / "log.csv.gz")


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
    assert x.unit == "mm" and np.isnan(x.values[1:3]).all() and x.values[3] == 1100
    assert np.allclose(values(table, "Time").values, [0, 0.005, 0.01, 0.015])
    assert values(table, "Lab:Glider.Rotation.Y").values[0] == 0.2


def test_parquet(tmp_path):
    arrow = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    table = arrow.table(
        {
            "stamp": arrow.array([0, 8_000, 16_000], arrow.timestamp("us")),
            "pose": [{"x": 1.0, "z": 2.0}] * 3,
            "q": [[0.0, 0.0, 0.0, 1.0]] * 3,
            "pitch_deg": [1.0, 2.0, None],
        }
    )
    parquet.write_table(table, tmp_path / "log.parquet")
    raw = read_recording(tmp_path / "log.parquet")
    assert values(raw, "stamp").unit == "us" and values(raw, "stamp").values[1] == 8000
    assert values(raw, "pose.z").values[0] == 2.0 and values(raw, "q[3]").values[0] == 1
    assert np.isnan(values(raw, "pitch_deg").values[2])


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


@pytest.mark.parametrize(
    "suffix", ["ulg", "mat", "mcap", "bag", "db3", "parquet", "csv", "c3d", "xlsx"]
)
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
        ("mcap", "mcap"),
        ("bag", "rosbags"),
        ("parquet", "pyarrow"),
        ("c3d", "ezc3d"),
        ("xlsx", "openpyxl"),
    ],
)
def test_a_missing_library_says_what_to_install(tmp_path, monkeypatch, suffix, module):
    path = tmp_path / f"log.{suffix}"
    path.write_bytes(b"x")
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
