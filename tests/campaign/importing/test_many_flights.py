"""One file with several flights, in each format that can have them."""

import json

import numpy as np
import pytest
from scipy.io import savemat

from glider.campaign.checks.inspection import inspect
from glider.campaign.importing.campaign_import import read_flights
from glider.campaign.importing.guess import guess_mapping
from glider.campaign.importing.readers import read_recordings
from glider.campaign.importing.splitting import find_restarts
from glider.campaign.reader import load_campaign
from glider.errors import InputError
from tests.campaign.importing import foreign
from tests.campaign.importing.test_import import assert_same

NAMES = ("time", "x", "z", "pitch", "elevator", "elevator_rate_command")
COLUMNS = "columns: {x: x, z: z, pitch: pitch, elevator: elevator, "
MAP = COLUMNS + "elevator_rate_command: elevator_rate_command%s}\n"


@pytest.fixture(scope="module")
def campaign():
    return foreign.flights("attached_lift")


def rows_of(flight):
    return np.column_stack([flight.time, flight.pose, flight.elevator, flight.command])


def table_of(campaign, *, step=0.0):
    """All flights below each other, `step` seconds from one to the next."""
    rows, labels, begin = [], [], 0.0
    for k, flight in enumerate(campaign.flights):
        rows.append(rows_of(flight))
        rows[-1][:, 0] += begin
        begin += step + (flight.time[-1] if step else 0.0)
        labels += [k + 3] * len(flight.time)
    return np.concatenate(rows), labels


def write_text(path, rows, labels=None, label="flight"):
    names = (*NAMES, label) if labels else NAMES
    lines = [",".join(names)]
    for i, row in enumerate(rows.tolist()):
        lines.append(",".join(map(repr, row)) + (f",{labels[i]}" if labels else ""))
    path.write_text("\n".join(lines))


def imported(path, columns=""):
    mapping = path.with_name("MAP.yaml")
    mapping.write_text(MAP % columns + foreign.VEHICLE)
    return read_flights([path], mapping)


@pytest.mark.parametrize("words", ["{}", "throw {} of may"])
@pytest.mark.parametrize("step", [0.0, 0.01, 1.0])
def test_a_column_of_flights(tmp_path, campaign, words, step):
    """Whether time starts again or goes on, without a row lost at the ends."""
    rows, labels = table_of(campaign, step=step)
    path = tmp_path / "throws.csv"
    write_text(path, rows, [words.format(label) for label in labels])
    result = imported(path)
    assert_same(result.campaign, campaign, "csv")
    first = words.format(3)
    assert str(result.recordings[0].path) == f"{path}/flight {first}"
    [line] = result.describe().splitlines()
    assert line == f"{path}: 3 flights of 3 parts, {len(rows)} rows"


def test_a_column_of_flights_with_another_name(tmp_path, campaign):
    rows, labels = table_of(campaign, step=0.01)
    path = tmp_path / "throws.csv"
    write_text(path, rows, labels, label="run_id")
    assert_same(imported(path, ", flight: run_id").campaign, campaign, "csv")


def test_a_time_that_starts_again(tmp_path, campaign):
    rows, _ = table_of(campaign)
    path = tmp_path / "throws.csv"
    write_text(path, rows)
    result = imported(path)
    assert_same(result.campaign, campaign, "csv")
    assert str(result.recordings[-1].path) == f"{path}/part {len(campaign.flights)}"


def test_a_copy_of_a_flight_is_excluded(tmp_path, campaign):
    """It would count twice; the same file, named twice, is read once."""
    files = [tmp_path / f"{k}.csv" for k in range(4)]
    for file, k in zip(files, (0, 1, 2, 0), strict=True):
        write_text(file, rows_of(campaign.flights[k]))
    mapping = tmp_path / "MAP.yaml"
    mapping.write_text(MAP % "" + foreign.VEHICLE)
    assert len(read_flights([*files[:2], files[0]], mapping).campaign.flights) == 2
    [copy] = inspect(read_flights(files, mapping).campaign).excluded
    assert copy.file == "flight_003.csv" and "same rows as flight_000" in copy.why


def cells_of(values):
    cells = np.empty(len(values), dtype=object)
    cells[:] = values
    return cells


def write_v73(path, contents):
    """An array of structs in HDF5: fields of references to their values."""
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w", userblock_size=512) as file:
        for name in contents[0]:
            field = file.create_dataset(
                f"log/{name}", (len(contents), 1), h5py.ref_dtype
            )
            for i, content in enumerate(contents):
                field[i, 0] = file.create_dataset(
                    f"#refs#/{name}{i}", data=content[name].T
                ).ref
        file["log"].attrs["MATLAB_class"] = np.bytes_("struct")
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")


@pytest.mark.parametrize("shape", ["structs", "cells", "cells in a struct", "7.3"])
def test_arrays_of_structs_and_cells(tmp_path, campaign, shape):
    contents = [foreign.mat_content(flight) for flight in campaign.flights]
    path, mapping = tmp_path / "throws.mat", tmp_path / "MAP.yaml"
    mapping.write_text(foreign.MAP_MAT + foreign.VEHICLE)
    if shape == "7.3":
        write_v73(path, contents)
    elif shape == "cells in a struct":
        fields = {name: cells_of([c[name] for c in contents]) for name in contents[0]}
        savemat(path, {"log": fields, "limits": cells_of([[0.0, 1.0], [2.0, 3.0]])})
    elif shape == "cells":
        savemat(path, {"log": cells_of(contents), "mass": 0.08})
    else:
        kind = [(name, object) for name in contents[0]]
        structs = [tuple(content.values()) for content in contents]
        savemat(path, {"log": np.array(structs, dtype=kind), "mass": 0.08})
    result = read_flights([path], mapping)
    assert_same(result.campaign, campaign, "mat")
    assert str(result.recordings[1].path) == f"{path}/2"


def test_stamps_that_start_again_in_mcap(tmp_path, campaign):
    writers = pytest.importorskip("mcap.writer")
    path = tmp_path / "throws.mcap"
    with path.open("wb") as stream:
        writer = writers.Writer(stream)
        writer.start("", "test")
        schema = writer.register_schema("log", "jsonschema", b"{}")
        topics = [
            writer.register_channel(t, "json", schema) for t in ("/pose", "/servo")
        ]
        recorded = 10**18
        for flight in campaign.flights:
            for row in rows_of(flight).tolist():
                recorded += 8_000_000
                stamp = round(1e9 * (row[0] - flight.time[0]))  # The first is zero.
                message = dict(zip(NAMES[1:], row[1:], strict=True))
                message["stamp"] = {"sec": stamp // 10**9, "nsec": stamp % 10**9}
                for topic in topics:
                    data = json.dumps(message).encode()
                    writer.add_message(topic, recorded, data, recorded)
        writer.finish()
    mapping = tmp_path / "MAP.yaml"
    mapping.write_text(
        "columns: {x: /pose.x, z: /pose.z, pitch: /pose.pitch, elevator: "
        "/servo.elevator, elevator_rate_command: /servo.elevator_rate_command}\n"
        + foreign.VEHICLE
    )
    assert_same(read_flights([path], mapping).campaign, campaign, "mcap")


def test_a_column_that_only_says_whether_it_flies_is_not_one_of_flights(
    tmp_path, campaign
):
    rows, labels = table_of(campaign)
    path = tmp_path / "throws.csv"
    flags = [int(i % 40 > 5) for i in range(len(labels))]
    write_text(path, rows, flags)
    assert_same(imported(path).campaign, campaign, "csv")
    with pytest.raises(InputError, match="expected the rows of a flight together"):
        imported(path, ", flight: flight")
    with pytest.raises(InputError, match="columns: flight: there is no column 'run'"):
        imported(path, ", flight: run")


def test_an_index_that_starts_again_on_the_next_day(tmp_path):
    campaign = foreign.flights("attached_lift", 4)
    rows, labels = table_of(campaign, step=0.01)
    path = tmp_path / "throws.csv"
    write_text(path, rows, [label if label < 6 else 3 for label in labels])
    result = imported(path)
    assert_same(result.campaign, campaign, "csv")
    assert result.recordings[-1].path.name == "flight 3 (2)"


def test_rows_whose_time_falls_back_are_counted(tmp_path, campaign):
    """A part of few rows is no flight, but it is reported."""
    rows = rows_of(campaign.flights[0])
    path = tmp_path / "throws.csv"
    write_text(path, np.concatenate([rows, rows[:9]]))
    result = imported(path)
    assert len(result.campaign.flights[0].time) == len(rows)
    assert "9 rows whose time falls back: they are dropped" in result.describe()


@pytest.mark.parametrize("read", [np.floor, np.round])
def test_times_in_whole_milliseconds_are_those_of_even_rows(tmp_path, campaign, read):
    tables = list(map(rows_of, campaign.flights))
    for begin, table in enumerate(tables):  # With pauses between the flights.
        table[:, 0] = read(1e3 * (table[:, 0] + 2.0 * begin)) / 1e3
    path = tmp_path / "throws.csv"
    write_text(path, np.concatenate(tables))
    for flight, true in zip(
        imported(path).campaign.flights, campaign.flights, strict=True
    ):
        rows = slice(0, len(flight.time))  # The pause ends all but the last sooner.
        assert np.allclose(flight.time, true.time[rows] - true.time[0], atol=5e-5)


def test_late_rows_are_no_restart():
    time = np.arange(200) / 100.0
    time[90] = time[80]
    time[120:135] -= 1.0
    assert find_restarts(time) == []
    assert find_restarts(np.r_[time, time, time]) == [200, 400]
    assert find_restarts(np.full(50, np.nan)) == []


def test_flights_of_a_campaign_are_one_in_each_file(tmp_path, campaign):
    """They are not cut, so none of them would be seen."""
    rows, _ = table_of(campaign)
    write_text(tmp_path / "flight_000.csv", rows)
    (tmp_path / "campaign.yaml").write_text(MAP % "" + foreign.VEHICLE)
    with pytest.raises(InputError, match="holds 3 flights"):
        load_campaign(tmp_path)


def test_tables_whose_restarts_differ_are_refused(tmp_path, campaign):
    contents = foreign.mat_content(campaign.flights[0])
    twice = {name: np.concatenate([v, v]) for name, v in contents.items()}
    thrice = {
        "t": np.tile(contents["t"], (3, 1)),
        "de": np.tile(contents["de"], (3, 1)),
    }
    path, mapping = tmp_path / "throws.mat", tmp_path / "MAP.yaml"
    savemat(path, {"log": twice, "servo": thrice})
    mapping.write_text(
        "columns: {time: [log.t, servo.t], position: log.p, attitude: log.eul, "
        "elevator: servo.de, elevator_rate_command: log.de_dot}\n"
        "units: {angle: deg, length: mm}\nframe: {rotation: ZYX}\n" + foreign.VEHICLE
    )
    assert len(read_recordings(path)) == 1
    with pytest.raises(
        InputError, match=r"does not increase at value 104 .* as many restarts"
    ):
        read_flights([path], mapping)


def test_a_guess_from_a_table_of_flights(tmp_path, campaign):
    """Its frames are tried on each flight, of which there are several in a file."""
    names = "time,px,py,pz,qx,qy,qz,qw"
    tables = [
        np.column_stack([f.time, foreign.position(f), foreign.rotation(f).as_quat()])
        for f in campaign.flights
    ]
    path, mapping = tmp_path / "throws.csv", tmp_path / "MAP.yaml"
    foreign.write_table(path, names, np.concatenate(tables))
    mapping.write_text(guess_mapping([path]).text)
    result = read_flights([path], mapping).campaign
    assert len(result.flights) == len(campaign.flights)
    assert np.allclose(result.flights[-1].pose[:, 2], campaign.flights[-1].pose[:, 2])


def test_an_order_of_angles_is_checked_on_each_flight_of_a_table(tmp_path, campaign):
    names, mapping = "time,px,py,pz,roll,pitch,yaw", tmp_path / "MAP.yaml"
    tables = []
    for flight in campaign.flights:
        roll_pitch_yaw = foreign.rotation(flight).as_euler("ZYX")[:, ::-1]
        place = foreign.position(flight)
        tables.append(np.column_stack([flight.time, place, roll_pitch_yaw]))
    foreign.write_table(tmp_path / "a.csv", names, np.concatenate(tables))
    mapping.write_text(
        "columns: {position: p, roll: roll, pitch: pitch, yaw: yaw}\n"
        "frame: {rotation: ZYX}\nvehicle: {elevator: fixed}\n"
    )
    result = read_flights([tmp_path / "a.csv"], mapping).campaign
    assert len(result.flights) == len(campaign.flights)
