"""What another process compiles is loaded from the disk, not compiled again."""

import os
import subprocess
import sys

import numba
import numpy as np
import pytest

from glider.compiled import collocation
from glider.compiled.ahead import compile_ahead, wait_for
from glider.compiled.kernel import machine_code

POINTS = np.arange(6.0).reshape(2, 3)

FIRST_USES = """
import numba
from glider import GliderModel, plan
from glider.compiled import filter_error, interior_point, stages
from glider.sysid.replay import warm_up

asked = {}
def note(function, *arguments):
    asked[function] = tuple(map(numba.typeof, arguments))

interior_point.compile_ahead = warm_up.compile_ahead = note
plan(GliderModel())
warm_up.warm_up()
filter_error.filter_flight(*filter_error.no_flight())
for function in (stages.newton_step, filter_error.filter_flight):
    print(function.signatures == [asked[function]])
"""


@pytest.fixture
def spread(monkeypatch, tmp_path):
    """A function of `machine_code` as a session has it that has kept nothing yet."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    return machine_code(collocation.spread.py_func)


def call(function):
    """Returns what it writes, and how often its code was found on disk."""
    moved = np.empty((12, 3))
    compile_ahead(function, POINTS, 0.1, moved)
    wait_for(function)
    function(POINTS, 0.1, moved)
    return moved, sum(function.stats.cache_hits.values())


def moved_points():
    """Returns what `spread` writes."""
    moved = [POINTS + s * 0.1 * np.eye(3)[axis] for axis in range(3) for s in (1, -1)]
    return np.concatenate(moved)


def test_what_another_process_compiles_is_loaded(spread):
    moved, found = call(spread)
    assert found == 1
    np.testing.assert_array_equal(moved, moved_points())


def test_nothing_is_begun_where_the_code_is_kept(spread, monkeypatch):
    spread(POINTS, 0.1, np.empty((12, 3)))
    monkeypatch.setattr(subprocess, "Popen", None)  # Calling it would be an error.
    _, found = call(machine_code(spread.py_func))
    assert found == 1


@pytest.mark.parametrize("executable", ["no such file", "false"])
def test_without_another_process_it_is_compiled_here(spread, monkeypatch, executable):
    monkeypatch.setattr(sys, "executable", executable)
    moved, found = call(spread)
    assert found == 0
    np.testing.assert_array_equal(moved, moved_points())


def test_plain_python_needs_no_compiler():
    """As all functions are with NUMBA_DISABLE_JIT."""
    compile_ahead(collocation.spread.py_func, POINTS)
    wait_for(collocation.spread.py_func)


@pytest.mark.slow
def test_what_takes_longest_is_compiled_ahead():
    """A plan's Newton step and a campaign's filter, for what they are called with."""
    told = subprocess.check_output([sys.executable, "-c", FIRST_USES], text=True)
    assert told.splitlines() == ["True", "True"]
