"""Logs of other software become the flights that they were, or are refused."""

import copy
import dataclasses
import functools
import itertools
import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from glider.__main__ import main
from glider.campaign.checks.signs import check_signs
from glider.campaign.importing import campaign_import, joining, readers
from glider.campaign.importing.campaign_import import import_campaign, read_flights
from glider.campaign.importing.cutting import cut
from glider.campaign.importing.guess import guess_mapping
from glider.campaign.importing.track import Track
from glider.campaign.reader import load_campaign
from glider.errors import InputError
from tests.campaign.importing import foreign

MEASURED = Path(__file__).parents[4] / "shared" / "measured"
FORMATS = MEASURED.parent / "formats"

PRESETS = {
    "NED": {"up": "-z", "nose": "x", "top": "-z", "pitch": "nose_up"},
    "ENU": {"up": "z", "nose": "x", "top": "z", "pitch": "nose_down"},
}
OTHER = {
    "nose_up": "nose_down",
    "nose_down": "nose_up",
    "trailing_edge_up": "trailing_edge_down",
    "trailing_edge_down": "trailing_edge_up",
}


@pytest.fixture(scope="module")
def campaign():
    return foreign.flights("attached_lift")


@pytest.fixture(scope="module", params=foreign.FORMATS)
def lab(request, tmp_path_factory, campaign):
    """A lab's logs in one of some formats, and its MAP."""
    folder = tmp_path_factory.mktemp(request.param)
    write, text = foreign.FORMATS[request.param]
    files = write(folder, campaign)
    path = folder / "MAP.yaml"
    path.write_text(text + foreign.VEHICLE)
    return request.param, files, path


def few_formats(*few):
    """Marks a test of `lab`: with the other formats it is of make nightly."""
    formats = [
        pytest.param(name, marks=() if name in few else pytest.mark.nightly)
        for name in foreign.FORMATS
    ]
    return pytest.mark.parametrize("lab", formats, indirect=True)


def assert_same(imported, campaign, name):
    """The motions agree to the digits of each format, and a known shift of clocks."""
    assert len(imported.flights) == len(campaign.flights)
    for flight, true in zip(imported.flights, campaign.flights, strict=True):
        time = flight.time - flight.time[0]
        rows = np.searchsorted(true.time - true.time[0], time - 1e-4)
        assert np.allclose(true.time[rows] - true.time[0], time, atol=1e-5)
        x, z, pitch = (flight.pose - true.pose[rows]).T
        assert np.ptp(x) < 1e-5 and np.ptp(z) < 1e-5 and np.abs(pitch).max() < 1e-5
        slack = 3 if name == "motive" else 0  # Found clocks are rough.
        near = np.stack(
            [np.roll(true.elevator, k)[rows] for k in range(-slack, slack + 1)]
        )
        inner = slice(slack, len(rows) - slack)
        low, high = near.min(axis=0) - 0.02, near.max(axis=0) + 0.02
        assert np.all((flight.elevator >= low)[inner])
        assert np.all((flight.elevator <= high)[inner])


def test_each_format_gives_back_the_flights(lab, campaign, tmp_path):
    name, files, path = lab
    assert len(path.read_text().strip().splitlines()) <= 10
    imported = import_campaign(files, path, tmp_path / "out")
    assert imported.campaign.notes == ()
    assert_same(imported.campaign, campaign, name)
    again = load_campaign(tmp_path / "out")
    assert len(again.flights) == len(campaign.flights)
    assert json.loads((tmp_path / "out" / "import.json").read_text())["flights"]


def wrong_maps(text):
    """Yields each error of one sign or one axis that a MAP can have."""
    right = yaml.safe_load(text)
    frame = right.get("frame", {})
    frame = {"axes": frame} if isinstance(frame, str) else dict(frame)
    frame = PRESETS[frame.pop("axes", "ENU")] | frame
    axes = [sign + axis for axis in "xyz" for sign in ("", "-")]
    planar = "x" in right["columns"]
    for field in ("up",) if planar else ("up", "nose", "top"):
        for axis in axes:
            pair = {"nose": "top", "top": "nose"}.get(field)
            if axis != frame[field]:
                turned = {field: axis}
                if pair and frame[pair][-1] == axis[-1]:
                    turned[pair] = frame[field]
                yield f"{field} {axis}", {"frame": frame | turned}
    elevator = frame.get("elevator", "trailing_edge_up")
    both = {"elevator": OTHER[elevator], "command": OTHER[elevator]}
    yield "elevator and command", {"frame": frame | both}
    if planar:
        yield "forward", {"frame": frame | {"forward": "-x"}}
        yield "pitch", {"frame": frame | {"pitch": OTHER[frame["pitch"]]}}
    if "elevator" in right["columns"]:
        yield "elevator", {"frame": frame | both | {"command": elevator}}
        yield "command", {"frame": frame | both | {"elevator": elevator}}
    for rotation in ("XYZ", "wxyz") if "rotation" in frame else ():
        yield f"rotation {rotation}", {"frame": frame | {"rotation": rotation}}
    scalars = ("x", "z", "pitch", "elevator", "elevator_rate_command")
    there = [name for name in scalars if name in right["columns"]]
    for one, other in itertools.combinations(there, 2):
        columns = copy.deepcopy(right["columns"])
        columns[one], columns[other] = columns[other], columns[one]
        yield f"{one} for {other}", {"columns": columns}


@pytest.fixture
def files_are_read_once(monkeypatch):
    """For tests of what many maps make of the same files."""
    once = functools.cache(readers.read_recordings)
    for module in (joining, readers):
        monkeypatch.setattr(module, "read_recordings", once)
    monkeypatch.setattr(campaign_import, "advise", lambda error, *_: error)


@pytest.mark.usefixtures("files_are_read_once")
@few_formats("csv")
def test_a_wrong_map_is_refused_or_makes_no_difference(lab, tmp_path):
    """All errors of a sign or an axis, one at a time: none gets as far as a tracer."""
    _, files, path = lab
    right = read_flights(files, path).campaign
    tried = 0
    for label, change in wrong_maps(path.read_text()):
        wrong = tmp_path / "WRONG.yaml"
        wrong.write_text(yaml.safe_dump(yaml.safe_load(path.read_text()) | change))
        tried += 1
        try:
            imported = read_flights(files, wrong).campaign
        except InputError as error:
            assert len(str(error)) < 500
            continue
        for flight, other in zip(imported.flights, right.flights, strict=True):
            same = flight.pose.shape == other.pose.shape
            assert same and np.allclose(flight.pose, other.pose, atol=1e-6), label
            assert np.allclose(flight.elevator, other.elevator, atol=1e-6), label
    assert tried > 10


@few_formats("motive", "c3d")
def test_a_guess_is_the_right_map(lab, campaign, tmp_path):
    name, files, _ = lab
    if name in ("c3d", "trc", "dataflash"):  # Markers have no attitude by name.
        with pytest.raises(InputError, match="write the mapping by hand"):
            guess_mapping(files)
        return
    path = tmp_path / "MAP.yaml"
    text = guess_mapping(files).text
    path.write_text(text)
    assert "elevator_rate_limit" not in yaml.safe_load(text)["vehicle"]  # Nobody said.
    if name == "ulog":  # Only commanded angles: the servo's limit must be given.
        with pytest.raises(InputError, match="elevator_rate_limit is missing"):
            read_flights(files, path)
        path.write_text(text + "  elevator_rate_limit: 13.0\n")
    imported = read_flights(files, path).campaign
    for flight, true in zip(imported.flights, campaign.flights, strict=True):
        assert np.abs(flight.pose[5:25, 2] - true.pose[5:25, 2]).max() < 1e-5
        assert flight.elevator is not None


def test_command_line(tmp_path, campaign, capsys):
    files = [str(f) for f in foreign.write_csv(tmp_path, campaign)]
    path = tmp_path / "MAP.yaml"
    assert main(["import", *files, "--guess", "--map", str(path)]) == 0
    assert path.with_suffix(".png").stat().st_size > 10_000
    assert "standard errors" in capsys.readouterr().out
    assert main(["import", *files, "--map", str(path)]) == 2
    out = tmp_path / "campaign"
    assert main(["import", *files, "--map", str(path), "--out", str(out)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 4 and lines[0].startswith(f"{files[0]}: 1 flight, ")
    assert lines[-1] == f"Campaign: {out}, 3 flights"
    assert main(["import", *files, "--guess", "--map", str(path)]) == 2


def test_nothing_is_overwritten_without_force(tmp_path, campaign, capsys):
    """Neither a campaign.yaml, which may be edited by hand, nor a map, nor a log."""
    files = [str(f) for f in foreign.write_csv(tmp_path, campaign)]
    path, out = tmp_path / "MAP.yaml", tmp_path / "out"
    path.write_text(foreign.MAP_CSV + foreign.VEHICLE)
    command = ["import", *files, "--map", str(path), "--out", str(out)]
    assert main(command) == 0
    edited = out / "campaign.yaml"
    edited.write_text(edited.read_text() + "# mine\n")
    capsys.readouterr()
    assert main(command) == 2
    assert f"{edited}: exists; expected a new folder" in capsys.readouterr().err
    assert "# mine" in edited.read_text()
    assert main([*command, "--force"]) == 0
    assert "# mine" not in edited.read_text()
    raw = tmp_path / "raw"
    raw.mkdir()
    logs = [raw / f"flight_{k:03d}.csv" for k in range(len(files))]
    for file, log in zip(files, logs, strict=True):
        Path(file).rename(log)
    before = [log.read_bytes() for log in logs]
    words = [str(log) for log in logs]
    for force in ([], ["--force"]):
        command = ["import", *words, "--map", str(path), "--out", str(raw), *force]
        assert main(command) == 2
    assert [log.read_bytes() for log in logs] == before
    guessed = tmp_path / "new.yaml"
    guessed.with_suffix(".png").write_text("mine")
    assert main(["import", *words, "--guess", "--map", str(guessed)]) == 2
    assert not guessed.exists()
    assert main(["import", *words, "--guess", "--map", str(guessed), "--force"]) == 0


def test_recordings_without_a_flight_are_counted(tmp_path, campaign, capsys):
    files = foreign.write_csv(tmp_path, campaign)
    for file in files[1:]:
        lines = file.read_bytes().split(b"\r\n")
        still = lines[3].split(b";", 1)[1]
        times = (line.split(b";", 1)[0] for line in lines[3:-1])
        file.write_bytes(b"\r\n".join(lines[:3] + [t + b";" + still for t in times]))
    path, out = tmp_path / "MAP.yaml", tmp_path / "out"
    path.write_text(foreign.MAP_CSV + foreign.VEHICLE)
    names = [str(file) for file in files]
    command = ["import", *names, "--map", str(path), "--out"]
    assert main([*command, str(out)]) == 0
    lines = capsys.readouterr().out.splitlines()
    warnings = [line for line in lines if line.startswith("warning: ")]
    assert lines[: len(warnings)] == warnings
    few = "2 of 3 recordings gave no flight"
    assert f"warning: {few}; is 'frame:' right?" in warnings
    assert lines[-1] == f"Campaign: {out}, 1 flight; {few}"
    assert str(files[1]) in json.loads((out / "import.json").read_text())["notes"]
    assert main([*command, str(tmp_path / "again"), "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["campaign"] == str(tmp_path / "again")
    assert list(report["notes"]) == names
    [flight] = report["flights"]
    assert flight["recording"] == names[0]
    assert flight["name"] == "flight_000.csv" and flight["end"] > flight["begin"]
    assert few in " ".join(report["warnings"])


def test_the_same_map_in_campaign_yaml(tmp_path, campaign):
    for file in foreign.write_csv(tmp_path, campaign):
        file.rename(file.with_name(file.name.replace("log", "flight")))
    settings = tmp_path / "campaign.yaml"
    settings.write_text(foreign.MAP_CSV + foreign.VEHICLE)
    loaded = load_campaign(tmp_path)
    assert_same(loaded, campaign, "csv")
    settings.write_text(
        foreign.MAP_CSV.replace("axes: NED", "axes: NED, pitch: nose_down")
        + foreign.VEHICLE
    )
    with pytest.raises(InputError, match="pitch"):
        load_campaign(tmp_path)


def recorded(flight, rng):
    """Seconds of lying, being carried and thrown, then a flight, a crash, and rest."""
    step = 1.0 / 120.0
    pose = flight.pose
    speed = (pose[3] - pose[0]) / (3 * step)
    push = np.arange(30)[::-1] * step  # Up to the speed of release in a quarter second.
    thrown = pose[0] - (speed * push[:, None] - 0.5 * speed / 0.3 * push[:, None] ** 2)
    carry = np.linspace(thrown[0] - [1.0, 0.2, 0.0], thrown[0], 240, endpoint=False)
    lying = np.repeat(carry[:1], 120, axis=0)
    after = pose[-1] + np.linspace(0.0, 1.0, 12)[:, None] * [0.05, -0.02, 0.1]
    rest = np.repeat(after[-1:], 120, axis=0)
    parts = [lying, carry, thrown[:-1], pose, after, rest]
    rows = np.concatenate(parts)
    rows += rng.normal(size=rows.shape) * [1e-4, 1e-4, 1e-3]
    begin = sum(map(len, parts[:3])) * step
    return np.arange(len(rows)) * step, rows, begin


def test_a_recording_is_cut_from_release_to_contact(tmp_path, campaign):
    rng = np.random.default_rng(4)
    files, spans = [], []
    for k, flight in enumerate(campaign.flights):
        time, rows, begin = recorded(flight, rng)
        spans.append((begin, begin + flight.time[-1] - flight.time[0]))
        path = tmp_path / f"take_{k}.csv"
        files.append(foreign.write_table(path, "time,x,z,pitch", time, rows))
    settings = tmp_path / "MAP.yaml"
    settings.write_text(
        "columns: {x: x, z: z, pitch: pitch}\nvehicle: {elevator: fixed}\n"
    )
    imported = read_flights(files, settings)
    for recording, (begin, end) in zip(imported.recordings, spans, strict=True):
        [flight] = recording.flights
        first, last = flight.span
        assert begin - 0.02 < first < begin + 0.15, flight.why
        assert end - 0.2 < last < end + 0.02, flight.why
        assert "hand lets go" in flight.why


def test_the_docs_show_the_maps_that_are_tested():
    page = Path(__file__).parents[3] / "docs" / "import.md"
    blocks = page.read_text(encoding="utf-8").split("```yaml\n")[1:]
    shown = [block.partition("```")[0] for block in blocks]
    tested = [text + foreign.VEHICLE for _, text in foreign.FORMATS.values()]
    assert sorted(shown) == sorted(tested)


SERVO = "columns: {time: Zeit, x: north, z: down, pitch: Nick"
UNITS = "units: {time: ms, angle: deg, rate: deg/s}\n"
NED = "frame: {axes: NED, elevator: trailing_edge_down}\n"


def import_servo(folder, campaign, columns, vehicle):
    files = foreign.write_csv(folder, campaign)
    path = folder / "MAP.yaml"
    path.write_text(f"{SERVO}{columns}}}\n{UNITS}{NED}vehicle: {vehicle}\n")
    return read_flights(files, path)


def test_a_measured_elevator_without_commands(tmp_path, campaign):
    imported = import_servo(tmp_path, campaign, ", elevator: de", "{}")
    assert imported.campaign.servo.command == "reconstructed"
    for flight, true in zip(imported.campaign.flights, campaign.flights, strict=True):
        steps = np.diff(flight.time)
        path = flight.elevator[0] + np.cumsum(flight.command[:-1] * steps)
        assert np.abs(path - true.elevator[1:]).max() < 0.1


def test_commanded_angles_beside_a_measured_elevator(tmp_path, campaign):
    columns = ", elevator: de, elevator_angle_command: de"
    imported = import_servo(tmp_path, campaign, columns, "{}")
    assert imported.campaign.servo.command == "converted"
    for flight, true in zip(imported.campaign.flights, campaign.flights, strict=True):
        assert np.allclose(flight.elevator, true.elevator, atol=1e-8)


def test_a_rate_that_is_mapped_as_an_angle_is_refused(tmp_path, campaign):
    vehicle = "{elevator_rate_limit: 13.0, elevator_limits: [-0.4463, 0.9473]}"
    with pytest.raises(InputError, match=r"expected 1\.42 at most: is it a rate"):
        import_servo(tmp_path, campaign, ", elevator_angle_command: de_cmd", vehicle)


def test_a_fixed_tail(tmp_path, campaign):
    imported = import_servo(tmp_path, campaign, "", "{elevator: fixed}")
    assert all(flight.elevator is None for flight in imported.campaign.flights)


@pytest.mark.parametrize(
    ("columns", "vehicle", "words"),
    [
        ("", "{}", "elevator: fixed"),
        (", elevator_rate_command: de_cmd", "{}", "elevator: fixed"),
        (", elevator: de", "{elevator: fixed}", "one or the other"),
        (", elevator_angle_command: de", "{}", "elevator_rate_limit is missing"),
        (", elevator: Ruder", "{}", "there is no column 'Ruder'"),
        (", roll: Nick", "{mas: 1}", "did you mean 'mass'"),
    ],
)
def test_servo_logs_that_do_not_tell_enough(
    tmp_path, campaign, columns, vehicle, words
):
    with pytest.raises(InputError, match=words):
        import_servo(tmp_path, campaign, columns, vehicle)


@pytest.mark.skipif(not MEASURED.is_dir(), reason="no measured flights are here")
def test_motive_exports_of_measured_throws(tmp_path):
    """Of three takes one is a flight of the measured campaign, one shows nothing."""
    files = sorted((MEASURED / "raw_motive").glob("*.csv"))
    path = tmp_path / "MAP.yaml"
    path.write_text(
        "columns: {position: V3Glider.Position, attitude: V3Glider.Rotation}\n"
        "frame: {up: y, nose: x, top: y}\nvehicle: {elevator: fixed_per_flight}\n"
    )
    imported = read_flights(files, path)
    assert "never seen" in imported.describe()
    known = load_campaign(MEASURED / "motion_studio_v3", flights=["flight_019"])
    true, flight = known.flights[0], imported.campaign.flights[-1]
    lag = int(np.argmin(np.abs(flight.pose[:20, 1] - true.pose[0, 1])))
    assert lag * (flight.time[1] - flight.time[0]) < 0.03  # Release, as cut by hand.
    rows = min(len(flight.time) - lag, len(true.time))
    assert rows > 0.98 * len(true.time)
    ours, theirs = flight.pose[lag : lag + rows], true.pose[:rows]
    assert np.abs(ours[:, 1] - theirs[:, 1]).max() < 1e-5
    # Along the throw: the line through a few more rows is another by 2 mrad.
    assert np.ptp(ours[:, 0] - theirs[:, 0]) < 2e-3
    assert np.abs(ours[:, 2] - theirs[:, 2]).max() < 0.005


@pytest.mark.skipif(not MEASURED.is_dir(), reason="no measured flights are here")
def test_throws_that_fall_sideways_are_refused():
    """With y and z exchanged they show gravity to ± 54 %, which only warns."""
    thrown = load_campaign(MEASURED / "motion_studio_v3")
    assert check_signs(thrown) == ()
    exchanged = []
    for flight in thrown.flights:
        pose, attitude = flight.pose.copy(), flight.attitude.copy()
        pose[:, 1], attitude[:, 0] = flight.attitude[:, 0], flight.pose[:, 1]
        exchanged.append(dataclasses.replace(flight, pose=pose, attitude=attitude))
    with pytest.raises(InputError, match="fall sideways, at"):
        check_signs(dataclasses.replace(thrown, flights=tuple(exchanged)))


@pytest.mark.nightly
@pytest.mark.skipif(not FORMATS.is_dir(), reason="no files of other software are here")
def test_a_real_ulog_that_shows_no_flight(tmp_path):
    path = tmp_path / "MAP.yaml"
    path.write_text(foreign.MAP_ULOG + "vehicle: {elevator_rate_limit: 10.0}\n")
    with pytest.raises(InputError, match="nothing moves like a flight"):
        read_flights([FORMATS / "sample_log_small.ulg"], path)


def test_a_recording_is_cut_at_the_vehicles_gravity():
    """On Jupiter, a body that falls is not pushed by a hand."""
    gravity, time = 24.8, np.arange(180) / 120.0
    thrown, falling = np.minimum(time, 0.5), np.maximum(time - 0.5, 0.0)
    x = 5.0 * thrown**2 + 5.0 * falling
    z = 30.0 - 0.5 * gravity * falling**2
    track = Track(
        path=Path("drop.csv"),
        time=time,
        position=np.column_stack([x, np.zeros_like(x), z]),
        rotation=foreign.planar_rotation(np.arctan2(gravity * falling, 5.0)),
        spatial=False,
    )
    [flight], _ = cut(track, gravity)
    assert 0.5 < flight.time[0] < 0.65
    elsewhere, _ = cut(track, 9.81)
    assert not elsewhere or elsewhere[0].time[0] > 0.8


def test_nothing_that_is_printed_has_an_escape_sequence(tmp_path, campaign):
    folder = tmp_path / "ta\x1b[31mkes"
    folder.mkdir()
    files = foreign.write_csv(folder, campaign)
    path = tmp_path / "MAP.yaml"
    path.write_text(foreign.MAP_CSV + foreign.VEHICLE)
    described = read_flights(files, path).describe()
    assert all(line.isprintable() for line in described.splitlines())
    for file in files:
        file.write_bytes(file.read_bytes().replace(b"Nick", b"Nick\x1b[2J"))
    assert all(line.isprintable() for line in guess_mapping(files).text.splitlines())


def test_arguments_that_are_none_are_named(tmp_path, capsys):
    file, path = tmp_path / "a.csv", tmp_path / "MAP.yaml"
    path.write_text("columns: {x: x, z: z, pitch: p}\n")
    for given, words in (
        (([], path, tmp_path), "no files were given; expected one log or more"),
        ((str(file), path, tmp_path), "files is .*; expected a list of paths"),
        ((None, path, tmp_path), "files is None; expected a list of paths"),
        (([5], path, tmp_path), "files is 5; expected paths of logs"),
        (([file], {"columns": {}}, tmp_path), "the mapping is {.*expected the path"),
        (([file], path, None), "out is None; expected the path"),
    ):
        with pytest.raises(InputError, match=words):
            import_campaign(*given)
    with pytest.raises(InputError, match="no files were given"):
        guess_mapping([])
