"""Peers are left out where they are not installed, and timed fairly."""

import sys
import time

import pytest

from tests.benchmarks import bench_peers
from tests.benchmarks.peers.pairs import Pair, time_pair


def test_a_peer_that_is_not_installed_is_left_out(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "pysindy", None)  # As if it were not.
    bench_peers.main(["pysindy"])
    assert "pysindy is left out: pysindy is not installed." in capsys.readouterr().out


def test_a_peer_that_nobody_knows_is_refused():
    with pytest.raises(SystemExit, match="sindi is no peer; there are drake, casadi"):
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
