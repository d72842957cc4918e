"""The command line `check-funnel`."""

import dataclasses
import json

from glider.__main__ import main
from glider.paths import models_path
from glider.verification.funnel.funnel import (
    load_funnel,
    save_funnel,
)


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


def test_the_command_line_proves_the_remainder(tmp_path, capsys):
    proven = load_funnel(models_path("funnels", "proven", "drawn.npz"))
    path, end = tmp_path / "funnel.npz", f"{proven.nominal.times[-1]:.4f}"
    save_funnel(path, proven)
    few = ["check-funnel", str(path), "--every", "1000", "--prove"]
    assert main([*few, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["remainder"] == f"rigorous until t={end} at 2 of 201 times"
    assert found["boxes"] > 1000
    beta = proven.beta.copy()
    beta[-1] *= 0.8
    save_funnel(path, dataclasses.replace(proven, beta=beta))
    assert main(few) == 1
    words = capsys.readouterr().out
    assert "The certificate holds" in words
    assert "proven until 0.0000 s, and at 1 of the 2 times" in words
