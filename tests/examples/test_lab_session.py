"""A session in the lab: perches before and after the correction."""

import pytest

from diagrams.lab.state import Trace, TracedEffect
from examples import lab_session
from examples.lab_session import Session
from glider.errors import InputError
from tests.helpers.examples import run_main


def test_the_result_is_reported(tmp_path):
    answer = Trace(
        flights=("flight_001.csv",),
        sha256="",
        verdict="effect_found",
        effects=(TracedEffect(kind="wind", evidence=9.0, coefficients={}),),
        errors={"nominal": 0.2, "corrected": 0.003},
    )
    flown = Session(truth="head_wind", answer=answer, before=(0, 4), after=(4, 4))
    given = (f"--folder={tmp_path / 'session'}", "--launches=4", "--seed=3")
    output = run_main(lab_session, flown, tmp_path, *given, writes=("--json",))
    assert output.figures == {
        "truth": "head_wind",
        "verdict": "effect_found",
        "effects": ["wind"],
        "position_rms_m": {"nominal": 0.2, "corrected": 0.003},
        "before": [0, 4],
        "after": [4, 4],
    }
    assert output.asked.call_args.args[:3] == ("head_wind", 4, 3)


def test_a_session_that_ends_early_is_no_result(tmp_path, monkeypatch):
    monkeypatch.setattr(lab_session, "run_simulated", lambda *given: False)
    with pytest.raises(InputError, match="not completed"):
        lab_session.run("head_wind", 3, 0, tmp_path)
