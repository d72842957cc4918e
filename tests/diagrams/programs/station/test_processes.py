"""The command `fly` in real time: processes that are killed in flight."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from diagrams.programs.station.throw_log import read_throw
from glider.campaign.reader import load_campaign
from glider.physics.model import GliderModel

pytestmark = pytest.mark.nightly


@pytest.fixture
def make_command(tmp_path):
    """Makes a process of `fly` into a folder, the glider without effects."""
    GliderModel().save(tmp_path / "nominal.yaml")
    command = [sys.executable, "-m", "glider", "fly"]
    command += ["--simulate", str(tmp_path / "nominal.yaml")]

    def make(throws, folder="s"):
        options = ["--throws", str(throws), "--log", str(tmp_path / folder)]
        return subprocess.Popen([*command, *options], stdout=subprocess.PIPE, text=True)

    return make


def wait_for_flight(record: Path):
    """Waits until a throw has commands; returns when [s]."""
    end = time.monotonic() + 90.0
    while time.monotonic() < end:
        with contextlib.suppress(FileNotFoundError):
            if len(read_throw(record)[1]["/command"]) > 15:
                return
        time.sleep(0.01)
    raise AssertionError("no throw began")


def test_a_killed_station_has_logged_its_last_frame_and_goes_on(tmp_path, make_command):
    record = tmp_path / "s" / "throw_001.mcap"
    with make_command(3) as process:
        wait_for_flight(record)
        killed = time.monotonic()
        process.send_signal(signal.SIGKILL)
    _, topics = read_throw(record)
    assert killed - max(pose["received"] for pose in topics["/pose"]) < 0.05
    with make_command(2) as process:
        lines = process.stdout.read().splitlines()
    assert process.returncode == 0 and lines[-1].startswith("2 of 2 perched"), lines
    assert len(load_campaign(tmp_path / "s").flights) == 3


def test_two_simulations_do_not_hear_each_other(make_command):
    with make_command(2) as one, make_command(2, "other") as other:
        for process in (one, other):
            lines = process.stdout.read().splitlines()
            assert lines[-1].startswith("2 of 2 perched"), lines
    assert one.returncode == other.returncode == 0


def test_a_killed_glider_stops_its_throw(tmp_path, make_command):
    record = tmp_path / "s" / "throw_001.mcap"
    with make_command(3) as process:
        wait_for_flight(record)
        children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text()
        os.kill(int(children.split()[0]), signal.SIGKILL)
        killed = time.monotonic()
        lines = process.stdout.read().splitlines()
    assert process.returncode == 1
    [throw] = [line for line in lines if line.startswith("throw 1:")]
    assert "stopped at" in throw and "no usable pose for" in throw
    _, topics = read_throw(record)
    stopped = [e for e in topics["/event"] if e["state"] == "stopped"]
    neutral = min(c["sent"] for c in topics["/command"] if "asked" not in c)
    assert len(stopped) == 1 and neutral - killed < 0.05


def test_a_station_that_is_ended_in_flight_leaves_neutral_and_a_whole_record(
    tmp_path, make_command
):
    record = tmp_path / "s" / "throw_001.mcap"
    with make_command(3) as process:
        wait_for_flight(record)
        process.send_signal(signal.SIGTERM)
        process.communicate()
    assert process.returncode == 130
    _, topics = read_throw(record)
    result = topics["/event"][-1]
    assert result["state"] == "result" and result["reason"] == "the station was ended"
    assert "asked" not in topics["/command"][-1]


def test_a_seed_without_a_simulated_glider_is_refused(tmp_path):
    command = [sys.executable, "-m", "glider", "fly", "--seed", "3", "--log"]
    command.append(str(tmp_path))
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr == "error: --seed is 3; expected it only with --simulate.\n"
