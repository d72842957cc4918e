"""The command line `check-funnel`."""

import dataclasses
import functools
import json

import pytest

from glider.__main__ import main
from glider.paths import models_path
from glider.physics.covariance import Covariance
from glider.physics.model import GliderModel, load_covariance
from glider.verification.funnel.funnel import load_funnel, save_funnel
from glider.verification.proof import exact_check, flight_proof, purpose
from glider.verification.proof.flight_proof import prove_flights
from glider.verification.proof.interval_proof import IntervalProof


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
    proven = load_funnel(models_path("funnels", "drawn.npz"))
    path = tmp_path / "funnel.npz"
    part = proven.between(40, 61)  # The last intervals take longest.
    times = part.nominal.times - part.nominal.times[0]
    nominal = dataclasses.replace(part.nominal, times=times)
    part = dataclasses.replace(part, nominal=nominal)
    save_funnel(path, part)
    monkeypatch.setattr(purpose, "_problem_faults", lambda *given: [])
    monkeypatch.setattr(exact_check, "_within_goal", lambda funnel: True)
    alone = functools.partial(prove_flights, workers=1)
    monkeypatch.setattr(flight_proof, "prove_flights", alone)
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
    monkeypatch.setattr(flight_proof, "prove_interval", lambda piece, budget: fails)
    assert main(few) == 1
    words = capsys.readouterr().out
    assert "The certificate holds" in words
    assert "Not proven from 0.0000 to 0.0044 s: the remainder is 2 times its" in words
    whole = ["check-funnel", str(path), "--prove"]
    good = IntervalProof(boxes=1, parts=1)
    monkeypatch.setattr(flight_proof, "prove_interval", lambda piece, budget: good)
    assert main(whole) == 0
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
    assert "pitches from -85.9° to -28.6°; the hook accepts -67.0° to -20.1°." in words
    assert "The certificate does not hold: 3 faults." in words


@pytest.mark.nightly
def test_the_command_line_flies_the_gliders_that_the_data_allow(tmp_path, capsys):
    funnel = str(models_path("funnels", "head_wind_95.npz"))
    model = models_path("identified", "head_wind.yaml")
    few = [funnel, "--every", "1000", "--model", str(model), "--flights", "80"]
    command = ["check-funnel", *few, "--confidence"]
    assert main(command) == 0
    words = capsys.readouterr().out
    assert (
        "It was made for a set of gliders, the 95 % ellipsoid of wind.x ± 0.0008"
        in words
    )
    assert "V is about each one's own center; the funnel was made for these." in words
    assert " 0 of 1" in words and "flights from the boundary leave the funnel" in words
    assert main([*command, "0.99", "--seed", "3", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["made_for"]["level"] == 0.95
    flights = found["flights"]
    gliders = flights["gliders"]
    assert gliders["names"] == ["wind.x", "wind.z"]
    assert (gliders["level"], flights["seed"]) == (0.99, 3)
    assert gliders["funnel_was_made_for_them"] is False
    assert flights["escapes"] == 0 < flights["flights"]
    assert main([*command, "0.99", "--seed", "3", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["flights"] == flights

    # Of a glider that is hardly known, some leave.
    covariance = load_covariance(model)
    hardly = Covariance(names=covariance.names, matrix=9e4 * covariance.matrix)
    worse = tmp_path / "worse.yaml"
    GliderModel.load(model).save(worse, covariance=hardly)
    assert main([*command, "--model", str(worse)]) == 1
    words = capsys.readouterr().out
    assert "set of gliders, the 95 % ellipsoid of wind.x ± 0.00084" in words
    assert "is smaller than the model's, the 95 % ellipsoid of wind.x ± 0.25" in words
    alone = str(models_path("funnels", "head_wind.npz"))
    load_funnel(alone).nominal.model.save(worse, covariance=hardly)
    assert main(["check-funnel", alone, *command[2:], "--model", str(worse)]) == 1
    words = capsys.readouterr().out
    assert "It is of the estimated glider alone" in words
    assert "the funnel was made for one glider, not for these" in words
    assert " 0 of " not in words


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


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--confidence", "1.5"], "--confidence is '1.5'; expected a probability"),
        (["--confidence", "95"], "such as 0.95"),
        (["--confidence", "abc"], "--confidence is 'abc'; expected a"),
        (["--confidence", "nan"], "--confidence is 'nan'; expected a"),
        (
            ["--confidence", "--flights", "0"],
            "--flights is 0; expected a number from 1 to",
        ),
        (["--confidence", "--flights", "9999999999999"], "from 1 to 1,000,000"),
        (["--confidence", "--seed", "-1"], "--seed is -1"),
        (["--flights", "100"], "--flights has no effect without --confidence"),
        (["--seed", "-3"], "--seed is -3"),
        (["--confidence"], "a --model with a covariance"),
        (["--confidence", "--model", "VEHICLE"], "a --model with a covariance"),
        (
            ["--confidence", "--model", "MODEL"],
            "model.yaml: the accuracy of the glider",
        ),
    ],
)
def test_what_makes_no_set_is_said_in_a_sentence(arguments, words, tmp_path, capsys):
    model = tmp_path / "model.yaml"
    GliderModel().save(model)
    vehicle = str(models_path("vehicles", "perching.yaml"))
    files = {"MODEL": str(model), "VEHICLE": vehicle}
    alone = str(models_path("funnels", "drawn.npz"))
    command = ["check-funnel", alone, "--every", "1000"]
    assert main([*command, *(files.get(a, a) for a in arguments)]) == 2
    found = capsys.readouterr()
    assert words in found.err
    assert found.err.count("\n") == 1
    assert not found.out
