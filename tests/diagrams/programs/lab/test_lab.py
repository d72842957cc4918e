"""A session in the lab: throws that come one by one, restarts, and the page."""

import contextlib
import dataclasses
import multiprocessing
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from starlette.testclient import TestClient

import diagrams.programs.lab.session as session_module
from diagrams.programs.lab.gate import Address, listen
from diagrams.programs.lab.launches import Launches
from diagrams.programs.lab.link import StationLink
from diagrams.programs.lab.server import make_app
from diagrams.programs.lab.session import LabSession
from diagrams.programs.lab.state import Trace, load_state, trace_of
from diagrams.programs.lab.tracing import Job
from diagrams.programs.page import open_meshcat
from diagrams.programs.station.bus import OPERATOR, STATUS, Bus, free_address
from diagrams.programs.station.operators import KILL, Kills
from diagrams.programs.station.wire import Wire
from glider.__main__ import main
from glider.campaign.reader import load_campaign
from glider.campaign.samples import campaign_folder
from glider.errors import InputError
from glider.physics.model import GliderModel
from glider.simulation.refly import nominal_model
from glider.sysid.pipeline import close_the_loop
from glider.sysid.result import read_report
from tests.helpers.answers import assert_same_answer
from tests.helpers.lab import finish, update

ADDRESS = Address(port=7000, token="a right token of the session")
COOKIE = {ADDRESS.cookie: ADDRESS.token}
CHANGES = {"x-glider-lab": "1"}


@pytest.fixture
def open_session(folder):
    """Opens sessions of the folder, and closes them at the end."""
    sessions = []

    def opened():
        sessions.append(LabSession(folder))
        return sessions[-1]

    yield opened
    for session in sessions:
        session.close()


def settle(session, **options):
    """Steps until nothing is left to be read."""
    session.step(**options)
    session.step(**options)
    while session._looking:
        time.sleep(0.01)
        session.step(**options)


def drop(folder, *numbers):
    for number in numbers:
        shutil.copy(campaign_folder("head_wind") / f"flight_{number:03d}.csv", folder)


def test_each_throw_is_flown_again_when_it_has_come(folder, open_session):
    session = open_session()
    seen = []
    for number in range(3):
        drop(folder, number)
        session.step(traces=False)  # The file may still grow.
        assert len(session.state.throws) == number
        settle(session, traces=False)
        seen.append(session.state.throws[-1])
        shown = session.comparison(seen[-1].name)
        assert list(shown.motions) == ["measured", "nominal"]
    assert session.state.throws == tuple(seen)  # Earlier ones are not done again.
    assert all(set(throw.errors) == {"nominal"} for throw in seen)
    assert all(0.0 < throw.errors["nominal"] < 0.5 for throw in seen)


@pytest.mark.nightly
def test_throws_one_by_one_give_the_answer_of_a_full_run(folder, open_session):
    session = open_session()
    for number in range(6):
        drop(folder, number)
        update(session)
        if number in (1, 3):
            finish(session)
    finish(session)
    few, some, last = session.state.traces
    assert "expected at least 3" in few.refusal
    assert len(some.flights) == 4 and len(last.flights) == 6
    full = close_the_loop(folder, flights=last.flights)
    assert [e.kind for e in last.effects] == ["wind"]
    found, _ = read_report(session.report)
    assert_same_answer(found, full.report)
    assert last == trace_of(found, last.headline, last.sha256)
    # What came after a trace was predicted by its model.
    errors = session.state.throws[5].errors
    assert errors["corrected"] < 0.5 * errors["nominal"]


@pytest.mark.nightly
def test_a_restart_goes_on_where_the_session_was(folder, open_session):
    drop(folder, 0, 1, 2)
    first = open_session()
    finish(first)
    first.close()
    second = open_session()
    assert second.state == first.state and second.state.answer
    finish(second)
    assert second.state == first.state  # Nothing was traced again.
    drop(folder, 3)
    finish(second)
    assert [len(t.flights) for t in second.state.traces] == [3, 4]
    assert load_state(folder / "lab" / "session.json") == second.state


def test_a_trace_whose_process_was_killed_is_tried_again(folder, open_session):
    drop(folder, 0, 1, 2)
    session = open_session()
    update(session)
    for _ in range(2):  # Once more in this session, not for ever.
        session._worker.start(session._next_job())
        os.kill(session._worker._process.pid, signal.SIGKILL)
        answer = session._worker.wait(60.0)
        assert answer.is_fault and "died" in answer.refusal
        session._take(answer)
    assert session._next_job() is None
    session.close()
    assert open_session()._next_job() is not None


@pytest.mark.nightly
def test_throws_before_the_first_answer_are_flown_again_by_it(folder, open_session):
    session = open_session()
    drop(folder, 0, 1, 2)
    finish(session)
    assert all(set(t.errors) == {"nominal"} for t in session.state.throws)
    before = session.state.throws[-1].errors["nominal"]
    session.step(traces=False)
    while not session.state.throws[-1].is_fitted:
        time.sleep(0.01)
        session._look()
    *others, last = session.state.throws
    # Whoever looks at it before the first trace sees what is seen after it.
    assert last.errors["nominal"] == pytest.approx(before, rel=1e-6)
    answer = session.state.answer
    assert last.errors["nominal"] == pytest.approx(answer.errors["nominal"], rel=0.3)
    assert last.errors["corrected"] < 0.2 * last.errors["nominal"] and last.is_fitted
    assert not any(throw.is_fitted for throw in others)  # One at a time.
    drop(folder, 3)
    update(session)
    assert not session.state.throws[-1].is_fitted
    assert set(session.state.throws[-1].errors) == {"nominal", "corrected"}


def test_a_throw_that_cannot_be_read_is_named_and_the_others_count(
    folder, open_session
):
    drop(folder, 0, 1)
    (folder / "flight_002.csv").write_text("time,x\n0,oops\n")
    session = open_session()
    update(session)
    *_, bad = session.state.throws
    assert not bad.is_read and "flight_002.csv" in bad.fault
    assert session.state.flights == ("flight_000.csv", "flight_001.csv")
    drop(folder, 2)  # The same name again, whole.
    update(session)
    assert session.state.throws[-1].is_read and not session.state.throws[-1].fault


def test_corrected_settings_make_every_throw_new(folder, open_session):
    drop(folder, 0, 1)
    session, settings = open_session(), folder / "campaign.yaml"
    update(session)
    session.report.mkdir()
    nominal_model(load_campaign(folder)).save(session.report / "model.yaml")
    session._take(Trace(flights=session.state.flights, sha256="of other throws"))
    settle(session, traces=False)
    assert "corrected" in session.state.throws[-1].errors
    before, job, text = session.state, session._next_job(), settings.read_text()
    settings.write_text("vehicle: {mass: heavy}\n")
    settle(session, traces=False)
    assert session.state.throws == before.throws
    [note] = session.state.notes
    assert "campaign.yaml" in note and "heavy" in note
    heavier = re.sub(r"mass: \S+", "mass: 0.2", text)
    assert heavier != text
    settings.write_text(heavier)
    settle(session, traces=False)
    assert session.state.notes == before.notes
    assert session._next_job().sha256 != job.sha256  # It is traced again.
    for throw, old in zip(session.state.throws, before.throws, strict=True):
        assert throw.is_drawn and throw.errors["nominal"] != old.errors["nominal"]
    settings.write_text(text)
    settle(session, traces=False)
    assert session._next_job() == job
    assert session.state.throws[-1] == before.throws[-1]


def test_throws_that_changed_since_are_no_answer(folder, open_session):
    drop(folder, 0, 1, 2)
    session = open_session()
    update(session)
    job = session._next_job()
    drop(folder, 3)
    (folder / "flight_003.csv").replace(folder / "flight_001.csv")
    answer = job.run()
    assert answer.is_fault and "changed" in answer.refusal
    session._take(answer)
    update(session)
    assert session.state.traces == ()  # What it was asked for is no more.
    assert session._next_job().sha256 != job.sha256


def test_one_session_at_a_time_has_a_folder(folder, open_session, capsys):
    first = open_session()
    assert main(["lab", str(folder)]) == 2
    error = capsys.readouterr().err
    assert f"{folder}: another session writes to it" in error
    assert "Traceback" not in error
    first.close()
    killed = "\n".join(
        [
            "import os, pathlib, sys",
            "from diagrams.programs.lab.session import LabSession",
            "session = LabSession(pathlib.Path(sys.argv[1]))",
            "os.kill(os.getpid(), 9)",
        ]
    )
    ended = subprocess.run([sys.executable, "-c", killed, folder], check=False)
    assert ended.returncode == -9
    open_session()  # A process that was killed holds nothing.


def test_a_folder_that_is_none_is_refused(tmp_path, capsys):
    with pytest.raises(InputError, match="expected a folder"):
        LabSession(tmp_path / "none")
    assert main(["lab", str(tmp_path / "none")]) == 2
    assert "expected a folder" in capsys.readouterr().err


def test_a_fault_of_ours_is_shown_and_the_session_goes_on(
    folder, open_session, monkeypatch, capsys
):
    session = open_session()
    monkeypatch.setattr(LabSession, "_next_job", lambda self: None)
    with monkeypatch.context() as patched:
        patched.setattr(session_module, "compare", lambda *given: 1 / 0)
        drop(folder, 0)
        end = time.monotonic() + 60.0
        while session.try_step() and time.monotonic() < end:
            time.sleep(0.01)
    assert "ZeroDivisionError" in session.fault
    assert "ZeroDivisionError" in capsys.readouterr().err
    assert not session.state.throws[0].is_drawn
    assert session.try_step()
    settle(session)
    assert session.fault == "" and session.state.throws[0].is_drawn


def test_throws_are_listed_while_the_first_one_is_still_read(
    folder, open_session, monkeypatch
):
    may_go_on, real = threading.Event(), session_module.compare

    def compare(*given):  # As where code is compiled first.
        may_go_on.wait(60.0)
        return real(*given)

    monkeypatch.setattr(session_module, "compare", compare)
    monkeypatch.setattr(session_module, "_SLOW", 0.0)
    session = open_session()
    try:
        for number in range(4):
            drop(folder, number)
            for _ in range(3):
                session.step()
                time.sleep(0.05)
            assert len(session.state.throws) == number + 1
            assert "compiling once" in session.doing and "tracing" not in session.doing
    finally:
        may_go_on.set()
    settle(session, traces=False)
    assert all(throw.is_drawn for throw in session.state.throws)
    session.step()
    assert session.doing == "tracing (4 throws)"


def test_a_glider_that_is_not_known_is_refused_before_a_folder_is_made(
    tmp_path, capsys
):
    command = ["lab", str(tmp_path / "new"), "--simulate", "nope"]
    assert main(command) == 2
    assert (
        "nope: does not exist; expected a file, or the name of"
        in capsys.readouterr().err
    )
    assert not (tmp_path / "new").exists()


class FaultyJob(Job):
    """A search for the next throw in which this program has a fault."""

    def _propose(self):
        raise ValueError("matmul: Input operand 1 has a mismatch")


@pytest.mark.nightly
def test_a_next_throw_that_cannot_be_found_is_said_and_tried_again(
    folder, open_session
):
    drop(folder, 0, 1, 2)
    session = open_session()
    update(session)
    trace = session._next_job()
    session._take(Trace(flights=trace.flights, sha256=trace.sha256))
    job = session._next_job()
    fields = {f.name: getattr(job, f.name) for f in dataclasses.fields(job)}
    session._worker.start(FaultyJob(**fields))
    while not (answer := session._worker.wait(60.0)):
        pass
    [sentence] = answer.sentences
    assert sentence.startswith("The next throw could not be found: this program has a")
    assert "Tracing" not in sentence and "ValueError(" not in sentence
    assert answer.is_refused and not answer.throws
    session._take(answer)
    assert session._next_job() is None
    client = TestClient(make_app(session, ADDRESS), base_url="http://127.0.0.1")
    client.cookies.update(COOKIE)
    assert client.post("/next-throw", headers=CHANGES).status_code == 200
    assert session._next_job() == job


ORPHANS = """
import os, pathlib, sys, time
from diagrams.programs.lab.session import LabSession
from tests.helpers.lab import update
session = LabSession(pathlib.Path(sys.argv[1]))
update(session)
worker = session._worker
worker.start(session._next_job())
print(worker._process.pid, flush=True)
time.sleep(600.0)
"""


def state_of(pid):
    """State of a process; "" where it has ended."""
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(") ")[2][0]
    except OSError:
        return ""
    return state.replace("Z", "")


@pytest.mark.nightly
def test_a_killed_session_leaves_no_process(folder):
    drop(folder, 0, 1, 2)
    command = [sys.executable, "-c", ORPHANS, folder]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        tracer = int(process.stdout.readline())
        assert state_of(tracer)
        process.kill()
    end = time.monotonic() + 30.0
    while state_of(tracer) and time.monotonic() < end:
        time.sleep(0.05)
    left = state_of(tracer)
    if left:
        os.kill(tracer, signal.SIGKILL)
    assert not left


def test_a_process_whose_parent_is_gone_already_ends_at_once():
    """The parent may end before the child asks Linux for its signal."""
    code = (
        "from diagrams.programs.station.processes import end_with; "
        f"end_with({os.getpid()})"
    )
    orphan = [sys.executable, "-c", code.replace(str(os.getpid()), "1 << 22")]
    assert subprocess.run(orphan, check=False).returncode == -signal.SIGKILL
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.nightly
@pytest.mark.parametrize("truth", ["head_wind", "slow_servo", "floor_vent"])
def test_in_three_minutes_and_commands_the_glider_perches(tmp_path, truth):
    """In real time: other work on this computer would delay commands."""
    began = time.monotonic()
    session, report = tmp_path / "session", tmp_path / "report"
    fly = ["fly", "--simulate", truth]
    perched = []
    for command in (
        [*fly, "--log", session],
        ["close-the-loop", session, "--out", report],
        [*fly, "--model", report / "model.yaml", "--log", tmp_path / "after"],
    ):
        done = subprocess.run(
            [sys.executable, "-m", "glider", *command],
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        perched += re.findall(r"(\d+) of 10 perched", done.stdout)
    before, after = map(int, perched)
    assert before == 0
    assert after >= 9
    assert time.monotonic() - began < 180.0


@pytest.fixture
def client(folder, open_session):
    drop(folder, 0)
    session = open_session()
    update(session)
    session.launches = Launches(folder=folder, truth="head_wind")
    app = make_app(session, ADDRESS)
    app.state.session = session
    return TestClient(app, base_url="http://127.0.0.1")


@pytest.mark.parametrize("query", ["", "?token=", "?token=wrong", "?token=%C3%A9"])
@pytest.mark.parametrize("path", ["/", "/events", "/throws/flight_000.json", "/none"])
def test_without_the_token_there_is_nothing(client, path, query):
    response = client.get(path + query)
    assert response.status_code == 403 and not response.cookies
    assert client.post(path + query, headers=CHANGES).status_code == 403


def test_the_page_serves_who_has_the_token(client):
    page = client.get(f"/?token={ADDRESS.token}")
    assert page.status_code == 200 and "lab.js" in page.text
    # From here on by the cookie.
    for path in re.findall(r'(?:href|src)="((?:static/|colors)[^"]+)"', page.text):
        assert client.get(f"/{path}").status_code == 200, path
    figure = client.get("/throws/flight_000.json").json()
    assert set(figure["figures"]["throw"]["keys"]) == {"measured", "nominal", "fitted"}
    assert "flight_000" in client.get("/throws/flight_000/replay").text
    for path in (
        *("throws/flight_001.json", "throws/flight_001/replay", "report"),
        *("throws/..%2Fsession.json", "static/..%2Fserver.py", "next/..%2Fmodel.yaml"),
    ):
        assert client.get(f"/{path}").status_code == 404, path


def listeners():
    """Addresses that this process listens on, by their sockets."""
    own = set()
    for entry in os.listdir("/proc/self/fd"):
        with contextlib.suppress(OSError):
            own.add(os.readlink(f"/proc/self/fd/{entry}"))
    found = {}
    for table in ("tcp", "tcp6"):
        for line in Path(f"/proc/self/net/{table}").read_text().splitlines()[1:]:
            _, address, _, state, *_ = fields = line.split()
            socket = f"socket:[{fields[9]}]"
            if state == "0A" and socket in own:
                found[socket] = address.partition(":")[0]
    return found


@pytest.mark.nightly
def test_replays_leave_no_server_behind(client):
    client.cookies.update(COOKIE)
    before = listeners()
    children = multiprocessing.active_children()  # Those of other tests.
    for _ in range(3):
        assert "flight_000" in client.get("/throws/flight_000/replay").text
        assert listeners() == before
        assert multiprocessing.active_children() == children


def test_a_scene_is_for_this_computer_only():
    before, meshcat = listeners(), open_meshcat()
    new = {s: address for s, address in listeners().items() if s not in before}
    assert meshcat.port() and list(new.values()) == ["0100007F"]  # 127.0.0.1


def test_a_stop_reaches_every_servo_whatever_the_session_does(client, open_session):
    session = client.app.state.session
    link = session.link = StationLink(free_address())
    servo = Wire(GliderModel().parameters.servo, 0.0, 10.0)
    servo.obey(1.0, 1.0, 0.0)
    bus = Bus(link.address)
    bus.listen(OPERATOR, lambda t, values, names: servo.operate(values, names, 1.0))
    client.cookies.update(COOKIE)

    def heard(holds):
        end = time.monotonic() + 5.0
        while not holds() and time.monotonic() < end:
            bus.handle(0.01)
        return holds()

    assert client.post("/stop").status_code == 403  # A page of another port.
    assert client.post("/stop", headers=CHANGES).status_code == 200
    assert heard(lambda: bool(servo.kills)) and not servo.obey(1.0, 1.0, 1.1)
    refused = client.post("/fly?planned=nominal&throws=3", headers=CHANGES)
    assert refused.status_code == 400 and "arm" in refused.text
    assert client.post("/arm", headers=CHANGES).status_code == 200
    assert heard(lambda: not servo.kills) and servo.obey(1.0, 1.0, 1.2)
    # It is repeated, as for a servo that was switched on later.
    ended = threading.Event()
    listening = threading.Thread(target=link.run, args=(ended,))
    listening.start()
    try:
        client.post("/stop", headers=CHANGES)
        assert heard(lambda: bool(servo.kills))
        servo.kills = Kills()
        assert heard(lambda: bool(servo.kills))
        # An arm of ours does not end the Stop of another, who still repeats it.
        for _ in range(20):
            bus.say(OPERATOR, time.monotonic(), (7.0,), (KILL,))
            time.sleep(0.02)
        answer = client.post("/arm", headers=CHANGES)
        assert answer.status_code == 400 and "another operator" in answer.text
        assert link.is_stopped
        assert link.state["state"] == ""  # There is no station.
        bus.say(STATUS, time.monotonic(), (3.0, 0.0), ("waiting", "no usable pose yet"))
        assert heard(lambda: link.state["state"] == "waiting")
        assert link.state["reason"] == "no usable pose yet"
    finally:
        ended.set()
        listening.join()


def test_another_hosts_name_is_refused(client):
    headers = {"host": "evil.example"}
    address = f"/?token={ADDRESS.token}"
    assert client.get(address, headers=headers).status_code == 400


def test_a_page_of_another_port_cannot_fly(client):
    """It shares our cookies, and cannot send our header."""
    client.cookies.update(COOKIE)
    assert client.post("/fly?planned=nominal&throws=3").status_code == 403
    for query in ("planned=best&throws=3", "planned=nominal&throws=1e9", "planned=x"):
        assert client.post(f"/fly?{query}", headers=CHANGES).status_code == 400
    assert client.get("/fly?planned=nominal&throws=3").status_code == 405
    answer = client.post("/fly?planned=nominal&throws=3", headers=CHANGES)
    assert answer.status_code == 200


def test_a_session_is_at_the_same_address_after_a_restart(tmp_path):
    file = tmp_path / "address.json"
    first, address = listen(file, 0)
    assert file.stat().st_mode & 0o077 == 0
    other, elsewhere = listen(file, 0)  # While it is served a second time.
    assert elsewhere.token == address.token and elsewhere.port != address.port
    with pytest.raises(InputError, match="expected a free port"):
        listen(file, address.port)
    other.close()
    first.close()
    again, same = listen(file, 0)
    again.close()
    assert same == elsewhere


def test_launches_are_flown_one_request_after_the_other(tmp_path):
    class Flown(Launches):
        """Launches that end when a file is there."""

        def start(self, throws, model, flown, commands=None):
            flights.append((throws, model, flown, commands))
            wait = f"until [ -e {tmp_path}/over ]; do sleep 0.01; done"
            return subprocess.Popen(["sh", "-c", wait])

    flights = []
    launches = Flown(folder=tmp_path, truth="head_wind")
    assert not launches.step(None, 0)
    launches.ask("corrected", 2)
    assert not launches.step(None, 0)
    assert "no corrected model" in launches.fault
    launches.ask("nominal", 3)
    model = tmp_path / "model.yaml"
    assert launches.step(model, 0) and "3 launches" in launches.doing
    launches.ask("corrected", 4)
    assert launches.step(model, 3)
    assert flights == [(3, None, 0, None)]
    (tmp_path / "over").touch()
    launches._process.wait()
    assert launches.step(model, 3)
    assert flights[1:] == [(4, model, 3, None)]
    launches.ask("proposed", 1)
    launches._process.wait()
    assert launches.step(model, 7) and launches.doing == "flying the proposed throw"
    commands = tmp_path / "next_throw" / "commands_1.csv"
    assert flights[2:] == [(1, model, 7, commands)]
    launches._process.wait()
    launches.step(model, 8)
    (tmp_path / "over").unlink()
    launches.ask("nominal", 5)
    assert launches.step(model, 8)
    launches._process.kill()
    launches._process.wait()
    launches.step(model, 8)
    assert "SIGKILL ended the station" in launches.fault
    launches.ask("nominal", 5)
    launches.step(model, 8)
    launches.ask("nominal", 5)
    launches.stop()  # Those that fly, and those that were to come.
    launches._process.wait()
    assert not launches.step(model, 8)
    assert launches.fault == "" and len(flights) == 5
    launches.close()
