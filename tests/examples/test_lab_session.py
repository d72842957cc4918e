"""A session in the lab: perches before and after the correction."""

import subprocess
import sys

import pytest

from diagrams.programs.lab import launches
from diagrams.programs.lab.state import (
    CORRECTED,
    NOMINAL,
    State,
    Throw,
    Trace,
    TracedEffect,
)
from examples import lab_session
from glider.errors import InputError
from tests.helpers.examples import run_main

FIGURES = {
    "truth": "head_wind",
    "verdict": "effect_found",
    "effects": ["wind"],
    "position_rms_m": {"nominal": 0.2, "corrected": 0.003},
    "before": [0, 4],
    "after": [3, 4],
}


def test_the_result_is_reported(tmp_path):
    given = (f"--folder={tmp_path / 'session'}", "--launches=4", "--seed=3")
    found = lab_session.Session(**FIGURES)
    output = run_main(lab_session, found, tmp_path, *given, writes=("--json",))
    assert output.figures == FIGURES
    assert output.asked.call_args.args[:3] == ("head_wind", 4, 3)
    assert output.asked.call_args.args[3] == tmp_path / "session"


def test_a_session_that_ends_early_is_no_result(tmp_path, monkeypatch):
    died = subprocess.Popen([sys.executable, "-c", "raise SystemExit(1)"])
    monkeypatch.setattr(launches.Launches, "start", lambda *given: died)
    with pytest.raises(InputError, match="not all launches were flown"):
        lab_session.run("head_wind", 3, 0, tmp_path)


def test_the_figures_are_those_of_the_session(tmp_path, monkeypatch):
    answer = Trace(
        flights=("flight_001.csv",),
        sha256="",
        verdict="effect_found",
        effects=(TracedEffect(kind="wind", evidence=9.0, coefficients={}),),
        errors={"nominal": 0.2, "corrected": 0.003},
    )
    planned = 4 * [(NOMINAL, False)] + [(CORRECTED, k < 3) for k in range(4)]
    throws = tuple(
        Throw(name=f"flight_{k:03}.csv", sha256="", planned=model, perched=perched)
        for k, (model, perched) in enumerate(planned)
    )
    state = State(throws=throws, traces=(answer,))
    monkeypatch.setattr(lab_session, "fly_session", lambda *given: state)
    found = lab_session.run("head_wind", 4, 3, tmp_path)
    assert found == lab_session.Session(**FIGURES)
