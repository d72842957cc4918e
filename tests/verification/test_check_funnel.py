"""The command line `check-funnel`."""

import dataclasses
import functools
import json

from glider.__main__ import main
from glider.paths import models_path
from glider.verification.funnel.funnel import (
    load_funnel,
    save_funnel,
)
from glider.verification.proof import check, exact_check, flight_proof
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
    assert json.loads(out.out)["remainder"] == "none"
    save_funnel(path, dataclasses.replace(funnel, S=-funnel.S))
    assert main(["check-funnel", str(path), "--every", "1000", "--prove"]) == 1
    assert "no ellipsoid" in capsys.readouterr().out
    path.write_text("no")
    assert main(["check-funnel", str(path)]) == 2
    assert "not a funnel" in capsys.readouterr().err


def test_the_command_line_proves_that_no_flight_leaves(tmp_path, capsys, monkeypatch):
    proven = load_funnel(models_path("funnels", "proven", "drawn.npz"))
    path, noted = tmp_path / "funnel.npz", tmp_path / "proof.jsonl"
    part = proven.between(40, 61)  # The last intervals take longest.
    times = part.nominal.times - part.nominal.times[0]
    nominal = dataclasses.replace(part.nominal, times=times)
    part = dataclasses.replace(part, nominal=nominal)
    save_funnel(path, part)
    monkeypatch.setattr(check, "problem_faults", lambda funnel, problem: [])
    monkeypatch.setattr(exact_check, "_within_goal", lambda funnel: True)
    alone = functools.partial(prove_flights, workers=1)
    monkeypatch.setattr(flight_proof, "prove_flights", alone)
    few = ["check-funnel", str(path), "--every", "20", "--prove"]
    assert main([*few, "--json", "--resume", str(noted)]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["every_flight"] is False
    assert (found["intervals_proven"], found["of_intervals"]) == (2, 21)
    assert found["remainder"].endswith("in 2 of 21 intervals")
    assert found["boxes"] > 1000
    assert main([*few, "--resume", str(noted)]) == 0
    words = capsys.readouterr().out
    assert "Proven: no flight leaves the funnel in 2 of its 21 intervals" in words
    assert "2 of the intervals were read from the file" in words
    fails = IntervalProof(fault="the remainder is 2 times as large as it bears")
    monkeypatch.setattr(flight_proof, "prove_interval", lambda piece, budget: fails)
    assert main(few) == 1
    words = capsys.readouterr().out
    assert "The certificate holds" in words
    assert "Not proven from 0.0000 to 0.0044 s: the remainder is 2 times as" in words
    save_funnel(path, dataclasses.replace(part, seconds=0.0))
    assert main([*few, "--resume", str(noted)]) == 2
    assert "another funnel" in capsys.readouterr().err
    assert main(["check-funnel", str(path), "--resume", str(noted)]) == 2
    assert "--prove" in capsys.readouterr().err
