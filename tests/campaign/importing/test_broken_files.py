"""Files that were cut short, edited or damaged: data, or one sentence; no traceback."""

import shutil
import warnings
from pathlib import Path

import numpy as np
import pytest

from glider.campaign.importing.campaign_import import read_flights
from glider.campaign.importing.picking import make_track
from glider.campaign.importing.readers import read_recording
from glider.campaign.importing.recording import Column, Group, Recording
from glider.campaign.settings import Settings
from glider.errors import InputError
from glider.files import schema
from tests.campaign.importing import foreign
from tests.campaign.importing.test_readers import VICON

MOTIVE_HEAD = (
    "Format Version,1.24,Rotation Type,Quaternion,Length Units,Meters\n\n"
    ",Type,Rigid Body,Rigid Body,Rigid Body\n"
)


def refusal(path, text):
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(InputError) as caught:
        read_recording(path)
    message = str(caught.value)
    assert str(path) in message and "\n" not in message and message.endswith(".")
    return message


def test_a_vicon_export_of_few_rows(tmp_path):
    message = refusal(tmp_path / "a.csv", "Objects\n200\n")
    assert "whole header" in message


def test_a_motive_export_whose_trailing_commas_were_trimmed(tmp_path):
    text = MOTIVE_HEAD + (
        ",Name,Glider,Glider\n,ID,1,1\n,,Position,Position,Position\n"
        "Frame,Time (Seconds),X,Y,Z\n0,0.0,1,2,3\n"
    )
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(InputError, match=r"no column 'Glider.Position.Z'.*found Time"):
        read_recording(tmp_path / "a.csv").find("Glider.Position.Z", "columns")


def test_a_motive_marker_that_lacks_an_axis(tmp_path):
    """It is of no use, but the other bodies are."""
    text = MOTIVE_HEAD + (
        ",Name,H,H,G,G,G\n,ID,1,1,1,1,1\n,," + 5 * "Position," + "\n"
        "Frame,Time (Seconds),X,Y,X,Y,Z\n0,0.0,1,2,3,4,5\n"
    )
    (tmp_path / "a.csv").write_text(text)
    recording = read_recording(tmp_path / "a.csv")
    assert recording.find("G.Position.Z", "columns")[1].values == [5.0]
    with pytest.raises(InputError, match=r"no column 'H.Position.Z'"):
        recording.find("H.Position.Z", "columns")


def test_a_lone_quote_in_a_large_file(tmp_path):
    rows = "".join(f"{i},{i}.5\n" for i in range(30_000))
    path = tmp_path / "a.csv"
    path.write_text('t,x\n0,"1\n' + rows)
    recording = read_recording(path)
    assert len(recording.find("t", "test")[1].values) == 30_001
    with pytest.raises(InputError, match="row 2: found '\"1'; expected a number"):
        recording.find("x", "test")


def test_a_damaged_mat_of_version_7_3(tmp_path):
    head = b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM"
    message = refusal(tmp_path / "a.mat", head.ljust(512) + b"\x89HDF no more of it")
    assert "not readable as" in message


def write_vicon(folder, campaign):
    text = VICON + "".join(
        f"{i},0,0.1,0.2,0.3,{1100 + i},2000,3000\n" for i in range(15, 90)
    )
    (folder / "trial.csv").write_text(text)
    return [folder / "trial.csv"]


def write_bag(folder, campaign):
    writer = pytest.importorskip("rosbags.rosbag1").Writer(folder / "log.bag")
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    kind = "geometry_msgs/msg/PoseStamped"
    with writer:
        channel = writer.add_connection("/pose", kind, typestore=store)
        for i in range(20):
            message = foreign.pose_message(store, campaign.flights[0], i, 10**9 + i, i)
            writer.write(channel, 10**9 + i, store.serialize_ros1(message, kind))
    return [folder / "log.bag"]


WRITERS = {name: write for name, (write, _) in foreign.FORMATS.items()} | {
    "vicon": write_vicon,
    "bag": write_bag,
}


def cut_short(data, rng):
    return data[: rng.integers(len(data))]


def swap_bytes(data, rng):
    damaged = bytearray(data)
    for _ in range(rng.integers(1, 9)):
        i, j = rng.integers(len(data), size=2)
        damaged[i], damaged[j] = damaged[j], damaged[i]
    return bytes(damaged)


def overwrite(data, rng):
    damaged = bytearray(data)
    # The head of a file holds most of its structure.
    for i in rng.integers(min(len(data), 2000), size=rng.integers(1, 6)):
        damaged[i] = rng.integers(256)
    return bytes(damaged)


def cut_columns(data, rng):
    lines = data.split(b"\n")
    first, keep = rng.integers(len(lines)), rng.integers(1, 6)
    for i in range(first, min(first + rng.integers(1, 50), len(lines))):
        for delimiter in (b",", b";"):
            if delimiter in lines[i]:
                lines[i] = delimiter.join(lines[i].split(delimiter)[:keep])
    return b"\n".join(lines)


def lose_lines(data, rng):
    lines = data.split(b"\n")
    del lines[rng.integers(len(lines)) :: rng.integers(1, 8)]
    return b"\n".join(lines)


COUNTS = {("c3d", 0): 5, ("c3d", 1): 20}
"""How many times a file is damaged that takes long to read, by format and seed."""

DAMAGES = (cut_short, swap_bytes, overwrite, cut_columns, lose_lines)


@pytest.fixture(scope="module")
def campaign():
    return foreign.flights("attached_lift", count=1)


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.nightly)])
@pytest.mark.parametrize("name", WRITERS)
def test_a_damaged_file_gives_data_or_one_sentence(tmp_path, campaign, name, seed):
    """Cut short, bytes swapped or overwritten, columns or lines lost."""
    rng = np.random.default_rng(seed)
    folder = tmp_path / "whole"
    folder.mkdir()
    for path in WRITERS[name](folder, campaign):
        data = path.read_bytes()
        for k in range(COUNTS.get((name, seed), 40 if seed == 0 else 400)):
            damaged = tmp_path / f"damaged{path.suffix}"
            damaged.write_bytes(DAMAGES[k % len(DAMAGES)](data, rng))
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # Of the libraries that read it.
                try:
                    table = read_recording(damaged)
                except InputError as error:
                    message = str(error)
                    assert "damaged" in message and "\n" not in message
                else:
                    assert all(isinstance(n, str) for n in table.names())
    shutil.rmtree(folder)


@pytest.mark.parametrize(
    ("column", "words"),
    [
        ("pitch", "no flight was found"),
        ("de", "fewer than two rows of it have a number"),
    ],
)
def test_a_column_that_is_blank_throughout(tmp_path, campaign, column, words):
    [file] = foreign.write_csv(tmp_path, campaign)
    lines = file.read_bytes().decode("cp1252").splitlines()
    names = lines[1].split(";")
    j = names.index({"pitch": "Nick"}.get(column, column))
    for i in range(3, len(lines)):
        cells = lines[i].split(";")
        cells[j] = ""
        lines[i] = ";".join(cells)
    file.write_text("\n".join(lines))
    path = tmp_path / "MAP.yaml"
    path.write_text(foreign.MAP_CSV + foreign.VEHICLE)
    with pytest.raises(InputError, match=words):
        read_flights([file], path)


def test_angles_beside_a_rotation_of_four_numbers(tmp_path, campaign):
    """PX4's quaternions are no order of roll, pitch and yaw, which are mapped here."""
    [file] = foreign.write_csv(tmp_path, campaign)
    path = tmp_path / "MAP.yaml"
    path.write_text(
        foreign.MAP_CSV.replace(
            "pitch: Nick", "y: x0, pitch: Nick, roll: r, yaw: w"
        ).replace("axes: NED", "axes: NED, rotation: wxyz")
        + foreign.VEHICLE
    )
    lines = file.read_bytes().decode("cp1252").splitlines()
    ends = ["", ";x0;r;w", ";;;", *[";0,0;0,0;0,0"] * (len(lines) - 3)]
    file.write_text("\n".join(a + b for a, b in zip(lines, ends, strict=True)))
    with pytest.raises(InputError, match="meaning of its three angles"):
        read_flights([file], path)
    path.write_text(path.read_text().replace(", rotation: wxyz", ""))
    assert len(read_flights([file], path).campaign.flights) == 1


def test_a_topic_without_its_times(tmp_path, campaign):
    """As in a ULog whose format message is damaged."""
    files = foreign.write_ulog(tmp_path, campaign)
    content = files[0].read_bytes()
    files[0].write_bytes(
        content.replace(b"uint64_t timestamp;", b"uint64_t timestomp;")
    )
    path = tmp_path / "MAP.yaml"
    path.write_text(foreign.MAP_ULOG + foreign.VEHICLE)
    with pytest.raises(InputError):
        read_flights(files, path)


@pytest.mark.parametrize("value", [0.0, 1e200, 40.0])
def test_a_quaternion_that_is_none_is_not_seen(value):
    rows = np.tile([0.0, 0.0, 0.0, 1.0], (9, 1))
    rows[4] = [0.0, 0.0, 0.0, value]
    columns = {
        f"q.{axis}": Column(values=v) for axis, v in zip("xyzw", rows.T, strict=True)
    }
    columns |= {f"p.{axis}": Column(values=np.arange(1.0, 10.0)) for axis in "xyz"}
    columns["t"] = Column(values=np.arange(9.0) / 5)
    recording = Recording(path=Path("a"), groups=(Group(name="", columns=columns),))
    fields = {"columns": {"position": "p", "attitude": "q", "time": "t"}}
    mapping = schema.convert(fields, Settings, "MAP").mapping("MAP")
    track = make_track(recording, mapping)
    assert len(track.time) == 8


def test_a_long_gap_of_the_pitch_is_not_interpolated():
    """As none of an attitude is: what happened in a quarter second is unknown."""
    time = np.arange(60) / 100.0
    pitch = np.sin(9.0 * time)
    pitch[20:45], pitch[50] = np.nan, np.nan
    columns = {"t": time, "x": 5.0 * time - 9.0, "z": -time, "theta": pitch}
    group = Group(name="", columns={n: Column(values=v) for n, v in columns.items()})
    fields = {"columns": {"time": "t", "x": "x", "z": "z", "pitch": "theta"}}
    mapping = schema.convert(fields, Settings, "MAP").mapping("MAP")
    track = make_track(Recording(path=Path("a"), groups=(group,)), mapping)
    assert np.array_equal(track.time, np.delete(time, np.s_[20:45]))
