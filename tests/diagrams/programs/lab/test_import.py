"""The import assistant: takes that are dropped on the page, and a map for them."""

import copy
import dataclasses
import math

import numpy as np
import pytest
import yaml
from starlette.testclient import TestClient

import diagrams.programs.lab.assistant as assistant
from diagrams.programs.lab.assistant import (
    MapJob,
    map_fields,
    next_map_job,
    with_map_field,
)
from diagrams.programs.lab.gate import Address
from diagrams.programs.lab.server import _LONGEST_MAP, make_app
from diagrams.programs.lab.session import LabSession
from glider.campaign.reader import load_campaign
from tests.helpers.lab import update

ADDRESS = Address(port=7000, token="a right token of the session")


@pytest.fixture
def session(tmp_path):
    session = LabSession(tmp_path)
    yield session
    session.close()


@pytest.fixture
def client(session):
    client = TestClient(make_app(session, ADDRESS), base_url="http://127.0.0.1")
    client.cookies.set(ADDRESS.cookie, ADDRESS.token)
    client.headers["x-glider-lab"] = "1"
    return client


def make_take(number=0):
    """CSV of a ballistic throw: millimetres, degrees, height down, nose up."""
    time = np.arange(90) / 120.0
    pitch = 4.0 + number - 30.0 * time
    x, down = 6000.0 * time, -(1500.0 + 1500.0 * time - 4905.0 * time**2)
    columns = zip(time, x, down, pitch, strict=True)
    rows = [f"{t:.4f},{a:.2f},{b:.2f},{c:.3f}" for t, a, b, c in columns]
    return "\n".join(["time,x_mm,down_mm,pitch_deg", *rows, ""])


def step(session):
    """Works until nothing is left to do."""
    session.step()
    session.step()
    while session.doing:
        if answer := session._worker.wait(60.0):
            session._take(answer)
        session.step()


def test_dropped_takes_become_throws_by_a_map_that_is_corrected(client, session):
    for number in range(3):
        answer = client.post(f"/takes/take {number}.csv", content=make_take(number))
        assert answer.status_code == 200, answer.text
    step(session)
    draft = session.state.draft
    assert draft.takes == ("take 0.csv", "take 1.csv", "take 2.csv")
    assert "columns:" in draft.text and client.get("/map.png").status_code == 200
    assert not session.state.throws  # Nothing is imported by a guess.
    good = (
        "columns: {time: time, x: x_mm, z: down_mm, pitch: pitch_deg}\n"
        "units: {length: mm, angle: deg}\n"
        "frame: {up: -z, pitch: nose_up}\nvehicle: {elevator: fixed_per_flight}\n"
    )
    for text, words in (
        (
            "columns: {x: nothing, z: down_mm, pitch: pitch_deg}\n",
            "no column 'nothing'",
        ),
        (good.replace("up: -z", "up: z"), "up"),
        ("[", "MAP.yaml"),
    ):
        assert client.post("/map/check", content=text).status_code == 200
        step(session)
        assert words in session.state.draft.refusal
        assert str(session.watched.path) not in session.state.draft.refusal
        refused = client.post("/map/save", content=text)
        assert refused.status_code == 400 and not session.watched.has_takes
    client.post("/map/propose")
    step(session)
    assert session.state.draft == draft
    client.post("/map/check", content=good)
    step(session)
    assert not session.state.draft.is_proposed
    assert session.state.draft.refusal == "" and session.state.draft.flights == 3
    assert client.post("/map/save", content=good + " ").status_code == 400
    assert client.post("/map/save", content=good).status_code == 200
    update(session)
    assert [throw.is_drawn for throw in session.state.throws] == [True] * 3
    client.post("/takes/take 3.csv", content=make_take(3))
    assert next_map_job(session.watched, session.state.draft, None) is None
    update(session)
    assert len(session.state.throws) == 4
    (session.watched.path / "take 0.csv").unlink()
    update(session)
    names = ["flight_take 1.csv", "flight_take 2.csv", "flight_take 3.csv"]
    assert [throw.name for throw in session.state.throws] == names
    flight = load_campaign(session.watched.campaign).flights[0]
    speed = np.gradient(flight.pose[:, 0], flight.time).mean()
    assert speed == pytest.approx(6.0, abs=0.01)
    assert flight.pose[0, 2] == pytest.approx(-math.radians(5.0), abs=0.01)


GOOD = """\
columns: {time: time, x: x_mm, z: down_mm, pitch: pitch_deg}
units: {length: mm, angle: deg}  # of Motive
frame: {up: -z, pitch: nose_up}
vehicle: {elevator: fixed_per_flight}
"""


def test_takes_that_cannot_be_read_hold_up_no_other(session):
    folder = session.watched.path
    (folder / "MAP.yaml").write_text(GOOD)
    for number in range(3):
        (folder / f"wurf_{number}.csv").write_text(make_take(number))
    (folder / "notes.txt").write_text("the second was thrown by Ann\n")
    (folder / "empty.csv").write_text("")
    update(session)
    throws = session.state.throws
    assert len(throws) == 3 and all(throw.is_drawn for throw in throws)
    skipped = session.watched.skipped
    assert set(skipped) == {"notes.txt", "empty.csv"}
    assert skipped["notes.txt"].startswith("notes.txt: ")
    for name in skipped:
        (folder / name).unlink()
    update(session)
    assert session.watched.skipped == {}
    assert len(session.state.throws) == 3


def test_a_map_that_no_take_fits_skips_none(session):
    folder = session.watched.path
    (folder / "MAP.yaml").write_text(GOOD.replace("x_mm", "nothing"))
    for number in range(3):
        (folder / f"wurf_{number}.csv").write_text(make_take(number))
    update(session)
    assert session.state.throws == () and session.watched.skipped == {}
    assert any("nothing" in note for note in session.state.notes)


def test_a_throw_keeps_the_name_of_its_take(session):
    folder = session.watched.path
    (folder / "MAP.yaml").write_text(GOOD)
    for number in range(4):
        (folder / f"wurf_{number}.csv").write_text(make_take(number))
    update(session)
    first = session.state.throws
    assert [t.name for t in first] == [f"flight_wurf_{k}.csv" for k in range(4)]
    assert [t.take for t in first] == [f"wurf_{k}.csv" for k in range(4)]
    assert all(t.written and not t.flown for t in first)
    (folder / "wurf_1.csv").unlink()
    (folder / "wurf_2.csv").rename(folder / "zuletzt.csv")
    update(session)
    names = [f"flight_{name}.csv" for name in ("wurf_0", "wurf_3", "zuletzt")]
    assert [t.name for t in session.state.throws] == names
    # What did not change was not flown again.
    assert session.state.throws[0] == first[0]


@pytest.mark.parametrize(
    "text",
    [
        GOOD,
        "columns:\n  x: x_mm\n  z: down_mm\nframe:  # by hand\n  up: x  # a guess\n",
        "columns: {x: x_mm}\nframe: NED\n",
        "columns: {x: x_mm}\n",
        "frame: {up: z,\n  pitch: nose_up}\ncolumns:\n    x: x_mm\n",
    ],
)
def test_a_choice_changes_one_field_of_a_map_however_it_is_written(text):
    before = yaml.safe_load(text)
    if isinstance(before.get("frame"), str):
        before["frame"] = {"axes": before["frame"]}
    for section, name, value in (
        *(("frame", "up", "-y"), ("units", "time", "ms"), ("columns", "x", "x: #1")),
        ("", "clock", "find"),
    ):
        changed = with_map_field(text, section, name, value)
        expected = copy.deepcopy(before)
        (expected.setdefault(section, {}) if section else expected)[name] = value
        assert yaml.safe_load(changed) == expected
        assert map_fields(changed)[section][name] == value
        gone = yaml.safe_load(with_map_field(changed, section, name, ""))
        assert name not in (gone.get(section) or {} if section else gone)
    if "# by hand" in text:
        kept = with_map_field(text, "frame", "up", "z")
        assert kept == text.replace("up: x  # a guess", "up: z")
        also = with_map_field(text.replace("x: x_mm", "up: x_mm"), "frame", "up", "z")
        assert also == kept.replace("x: x_mm", "up: x_mm")


def test_a_proposal_that_fails_leaves_what_was_found(tmp_path):
    # The glider at rest: there is no flight, and so no frame.
    rows = [f"{0.01 * k:.3f},-4.0,0.1,0.2,0.0" for k in range(300)]
    header = "time,x,z,pitch,elevator"
    (tmp_path / "a.csv").write_text("\n".join([header, *rows, ""]))
    draft = MapJob(folder=tmp_path, out=tmp_path / "out", takes=("a.csv",)).run()
    assert draft.refusal and set(draft.columns) == set(header.split(","))
    assert map_fields(draft.text)["columns"]["pitch"] == "pitch"


def test_more_takes_make_another_proposal_unless_a_person_has_corrected_it(session):
    def job_after(name, draft):
        (session.watched.path / name).write_text(make_take())
        return next_map_job(session.watched, draft, None)

    proposed = job_after("a.csv", None).run()
    assert proposed.is_proposed and proposed.text
    assert next_map_job(session.watched, proposed, None) is None
    assert job_after("b.csv", proposed).text == ""
    corrected = dataclasses.replace(proposed, is_proposed=False)
    assert job_after("c.csv", corrected).text == proposed.text
    assert next_map_job(session.watched, corrected, "").text == ""


@pytest.mark.parametrize(
    "name",
    [
        *("..%2Fx.csv", "..%5Cx.csv", "%2Ftmp%2Fx.csv", ".hidden.csv", "x.yaml"),
        *("MAP.yaml", "campaign.yaml", "x.csv%00.png", "x%0A.csv", "x.py", "x"),
        *("%E2%80%AEvsc.csv", "a" * 130 + ".csv", "<b>.csv", "-rf.csv"),
    ],
)
def test_hostile_names_are_refused(client, session, name):
    before = sorted(session.watched.path.rglob("*"))
    assert client.post(f"/takes/{name}", content="x").status_code in (400, 404)
    assert sorted(session.watched.path.rglob("*")) == before


def test_a_take_is_all_there_or_not_at_all(client, session, monkeypatch):
    assert client.post("/takes/a.csv", content=make_take()).status_code == 200
    again = client.post("/takes/a.csv", content="other")
    assert again.status_code == 400 and "exists" in again.text
    assert (session.watched.path / "a.csv").read_text() == make_take()
    assert client.post("/takes/empty.csv", content="").status_code == 400
    monkeypatch.setattr(assistant, "_MOST_BYTES", 1000)
    large = client.post("/takes/large.csv", content="x" * 1001)
    assert large.status_code == 400 and "too large" in large.text
    monkeypatch.setattr(assistant, "_MOST_TAKES", 1)
    assert client.post("/takes/b.csv", content="x").status_code == 400
    assert [path.name for path in session.watched.takes] == ["a.csv"]
    assert not list(session.watched.kept.glob("upload-*"))
    assert (
        client.post("/map/check", content="x" * (_LONGEST_MAP + 1)).status_code == 413
    )


def test_takes_are_not_for_the_stations_folder(client, session):
    (session.watched.path / "campaign.yaml").write_text("vehicle: {mass: 0.08}\n")
    answer = client.post("/takes/a.csv", content=make_take())
    assert answer.status_code == 400 and "no takes" in answer.text


def test_a_log_that_no_map_can_be_proposed_for_says_so(tmp_path):
    (tmp_path / "a.csv").write_text("a,b\n" + "1,2\n" * 50)
    draft = MapJob(folder=tmp_path, out=tmp_path / "out", takes=("a.csv",)).run()
    assert "no columns of a position" in draft.refusal and draft.text == ""
