"""The command line `check-funnel`."""

import dataclasses
import functools
import json

import pytest

from glider.__main__ import main
from glider.paths import models_path
from glider.verification.funnel.funnel import load_funnel, save_funnel
from glider.verification.proof import check, flight_proof, purpose
from glider.verification.proof.flight_proof import prove_flights
from glider.verification.proof.interval_proof import IntervalProof, prove_interval


def test_the_command_line_checks_a_file(funnel, tmp_path, capsys):
    path = tmp_path / "funnel.npz"
    save_funnel(path, funnel)
    assert main(["check-funnel", str(path), "--every", "1000"]) == 0
    assert "holds" in capsys.readouterr().out
    save_funnel(path, dataclasses.replace(funnel, S=0.9 * funnel.S))
    assert main(["check-funnel", str(path), "--every", "1000", "--json"]) == 1
    out = capsys.readouterr()
    assert json.loads(out.out)["holds"] is False
    save_funnel(path, dataclasses.replace(funnel, S=-funnel.S))
    assert main(["check-funnel", str(path), "--every", "1000", "--prove"]) == 1
    assert "not an ellipsoid" in capsys.readouterr().out
    path.write_text("no")
    assert main(["check-funnel", str(path)]) == 2
    assert "not a funnel" in capsys.readouterr().err


def test_the_command_line_proves_that_no_flight_leaves(tmp_path, capsys, monkeypatch):
    whole = load_funnel(models_path("funnels", "drawn.npz"))
    path = tmp_path / "funnel.npz"
    part = whole.between(40, 61)  # The last intervals take longest.
    times = part.nominal.times - part.nominal.times[0]
    nominal = dataclasses.replace(part.nominal, times=times)
    part = dataclasses.replace(part, nominal=nominal)
    save_funnel(path, part)
    monkeypatch.setattr(purpose, "_problem_faults", lambda *given: [])
    monkeypatch.setattr(check, "_within_goal", lambda funnel: True)
    alone = functools.partial(prove_flights, workers=1)
    monkeypatch.setattr(flight_proof, "prove_flights", alone)
    proven = {}

    def prove_once(piece, **given):
        key = piece.nominal.times.tobytes()
        if key not in proven:
            proven[key] = prove_interval(piece, **given)
        return proven[key]

    monkeypatch.setattr(flight_proof, "prove_interval", prove_once)
    few = ["check-funnel", str(path), "--every", "20", "--prove"]
    assert main([*few, "--json"]) == 1  # Not the whole funnel.
    found = json.loads(capsys.readouterr().out)
    assert found["every_flight"] is False
    loop = found["loop"]
    assert (loop["state"], loop["commands"], loop["period_s"]) == (
        "true",
        "continuous",
        0.0,
    )
    assert loop["command_error_rad_s"] == loop["wind_m_s"] == loop["jitter_s"] == 0.0
    assert (found["intervals_proven"], found["of_intervals"]) == (2, 21)
    assert found["boxes"] > 100
    assert main(few) == 1
    words = capsys.readouterr().out
    assert "Proven: no flight of this glider with a command error of at most 0" in words
    assert "leaves the funnel in 2 of its 21 intervals" in words
    assert "without an estimator: its commands follow the true state at all" in words
    fails = IntervalProof(fault="the remainder is 2 times its bound")
    monkeypatch.setattr(flight_proof, "prove_interval", lambda piece, **given: fails)
    assert main(few) == 1
    words = capsys.readouterr().out
    assert "The certificate holds" in words
    assert "Not proven from 0.0000 to 0.0044 s: the remainder is 2 times its" in words
    all_of_it = ["check-funnel", str(path), "--prove"]
    good = IntervalProof(boxes=1)
    monkeypatch.setattr(flight_proof, "prove_interval", lambda piece, **given: good)
    assert main(all_of_it) == 0
    assert "Proven: every flight" in capsys.readouterr().out


def test_the_command_line_asks_whether_the_hook_takes_the_last_set(capsys):
    few = ["--every", "1000", "--hook"]
    held = str(models_path("funnels", "head_wind_hook.npz"))
    assert main(["check-funnel", held, *few]) == 0
    assert "at most 2.80 m/s: the hook accepts all of it." in capsys.readouterr().out
    other = str(models_path("funnels", "head_wind.npz"))
    assert main(["check-funnel", other, *few[:2], "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["hook_takes_all"] is False
    assert main(["check-funnel", other, *few]) == 1
    words = capsys.readouterr().out
    assert "pitch = -1.5 rad; the hook accepts -1.17 to -0.35." in words
    assert "The certificate does not hold: 3 faults." in words


def test_the_command_line_reports_the_inlet(capsys):
    few = ["check-funnel", str(models_path("funnels", "drawn_hook.npz"))]
    few += ["--every", "1000", "--seed", "5"]
    assert main(few) == 0
    words = capsys.readouterr().out
    assert "(seed 5) finds up to 0.6" in words
    assert "z ± 0.173 (" in words
    assert main([*few, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    inlet, last = found["inlet"], found["last_set"]
    assert inlet["half_widths"]["z"] == pytest.approx(0.173, abs=1e-3)
    assert found["seed"] == 5
    for sizes in (inlet, last):
        for name, width in sizes["half_widths"].items():
            assert width <= sizes["extents"][name] * (1.0 + 1e-9)
    assert max(last["extents"]["x"], last["extents"]["z"]) <= 0.05
    assert main([*few, "--seed", "-3"]) == 2
    assert "--seed: -3 is not an integer of at least 0" in capsys.readouterr().err
