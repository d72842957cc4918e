"""Peers are left out where they are not installed, and timed fairly."""

import sys
import time
import types

import pytest

from benchmarks import bench_peers
from benchmarks.peers.aeroid_identification import Estimates, rows_of
from benchmarks.peers.pairs import Pair, time_pair


@pytest.mark.parametrize("name", ["pysindy", "aeroid"])
def test_a_peer_that_is_not_installed_is_left_out(monkeypatch, capsys, name):
    monkeypatch.setitem(sys.modules, name, None)  # As if it were not.
    bench_peers.main([name])
    assert f"{name} is left out: {name} is not installed." in capsys.readouterr().out


def test_intervals_of_coefficients_are_counted():
    """Student's t of 4 degrees of freedom is 2.78; the third is not found."""
    truth = types.SimpleNamespace(
        air_std=0.1, coefficients={"a.b": 2.0, "c.d": -1.0, "e.f": 1.0}
    )
    found = Estimates(
        values={"a.b": 2.5, "c.d": -0.7, "g.h": 7.0},
        stds={"a.b": 0.2, "c.d": 0.1, "g.h": 1.0},
        freedom=4.0,
        seconds=3.0,
    )
    [row] = rows_of([(truth, {"ours": found})])
    assert row == "| gusts | ours | 3 s | 27.50% | 30.0% | 1 of 2 (3 asked) |"


def test_a_peer_that_nobody_knows_is_refused():
    with pytest.raises(SystemExit, match="sindi is no peer; there are drake, pytorch"):
        bench_peers.main(["sindi"])


def test_what_is_timed_is_computing_in_turn():
    calls = []

    def work(name: str, seconds: float):
        calls.append(name)
        begin = time.process_time()
        while time.process_time() - begin < seconds:
            pass

    timing = time_pair(
        Pair(
            task="",
            peer="",
            ours=lambda: work("ours", 0.01),
            theirs=lambda: work("theirs", 0.02),
            told=str,
            rounds=3,
        )
    )
    assert calls == ["ours", "theirs"] * 4
    assert timing.ratio == pytest.approx(0.5, abs=0.1)
