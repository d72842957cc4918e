"""The commands that follow a report, after each verdict that it may give."""

import dataclasses
import json
import warnings
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from glider import close_the_loop
from glider.__main__ import main
from glider.campaign.writer import save_campaign
from glider.paths import models_path
from glider.physics.effects import PROFILE_DRAG
from glider.physics.effects.free_functions import FreeFunction
from glider.physics.model import GliderModel
from glider.planning.dircol import plan
from glider.planning.problem import PerchingProblem
from glider.report.folder import write_report
from glider.simulation.campaigns import CampaignPlan
from glider.sysid.result import VERDICTS, Result

DRAG = PROFILE_DRAG(cd0=0.05)
VENT = FreeFunction(
    kind="unexplained",
    variables=["x"],
    centers=[[-2.5], [-1.0]],
    widths=[0.25],
    weights={"wind_z": [1.0, 0.2]},
)
TRUTHS = {
    "no_effect": GliderModel(),
    "effect_found": GliderModel(effects=(DRAG,)),
    "partly_explained": GliderModel(effects=(DRAG,), free_functions=(VENT,)),
    "unexplained": GliderModel(free_functions=(VENT,)),
    "not_trusted": GliderModel(effects=(DRAG,)),
}
"""Glider whose flights have a verdict, if only a profile drag is tried."""


class Reported(NamedTuple):
    """A campaign, the folder of its report, and the result."""

    campaign: Path
    folder: Path
    result: Result


CASES = [
    pytest.param(v, marks=() if v == "unexplained" else pytest.mark.nightly)
    for v in VERDICTS
]
"""Of the others, `make test` closes the loop and proposes a throw in test_main.py."""


@pytest.fixture(scope="module", params=CASES)
def reported(request, tmp_path_factory):
    """A report of each verdict, on six simulated flights."""
    rng, name = np.random.default_rng(1), request.param
    campaign = CampaignPlan(flights=6).simulate(TRUTHS[name], rng)
    if name == "not_trusted":  # The elevator's angles are in another unit.
        flights = tuple(
            dataclasses.replace(f, elevator=1.05 * f.elevator) for f in campaign.flights
        )
        campaign = dataclasses.replace(campaign, flights=flights)
    folder = tmp_path_factory.mktemp(name)
    save_campaign(folder / "flown", campaign)
    result = close_the_loop(folder / "flown", effects=("profile_drag",))
    write_report(result, folder / "report")
    assert result.verdict == name
    return Reported(folder / "flown", folder / "report", result)


def is_warned_of(reported: Reported, said: str) -> bool:
    """Whether a command says that the model of the report is not trusted."""
    told = f"warning: {reported.folder / 'model.yaml'}: the verdict"
    why = "Too much is left to chance"
    return told in said and 'is "not trusted": ' in said and why in said


def test_next_throw_proposes(reported, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("glider.experiments.throw_search._ROUNDS", 1)
    out = tmp_path / "next"
    files = ["--report", str(reported.folder), "--launches", "1", "--out", str(out)]
    assert main(["next-throw", str(reported.campaign), *files]) == 0
    said, error = capsys.readouterr()
    assert "Throw 1: release at" in said
    assert "Traceback" not in error
    assert is_warned_of(reported, error) == (reported.result.verdict == "not_trusted")
    data = json.loads((out / "next_throw.json").read_text())
    functions = reported.result.model.free_functions
    if not functions:
        assert "free function" not in said and "over x" not in said
    else:
        assert "No formula of the library is the cause of" in said
        assert not data["nothing_more_to_learn"]


def test_the_campaign_is_rehearsed(reported, tmp_path, capsys):
    """With the model of the report, its free functions too."""
    out = tmp_path / "rehearsal"
    options = ["--effects", "mass", "--no-flights", "--out", str(out)]
    files = ["--report", str(reported.folder)]
    assert main(["rehearse", "still_air", *files, *options]) == 2
    assert "campaign is 'flown'; expected 'still_air'" in capsys.readouterr().err
    assert main(["rehearse", "still_air", "--effects", "masss"]) == 2
    assert "unknown effect 'masss'" in capsys.readouterr().err
    assert main(["rehearse", str(reported.campaign), *files, *options]) == 0
    said, error = capsys.readouterr()
    assert "Traceback" not in error
    assert is_warned_of(reported, error) == (reported.result.verdict == "not_trusted")
    assert f"{reported.result.flights.count} flights" in said
    data = json.loads((out / "rehearsal.json").read_text())
    [mass] = data["effects"]
    assert mass["power"] > 0.9
    assert 0.0 < mass["visible"] < mass["size"]
    assert mass["flown"] is None
    assert (out / "rehearsal.png").read_bytes().startswith(b"\x89PNG")


def test_a_report_is_compared_with_itself(reported, capsys):
    assert main(["compare", *[str(reported.folder)] * 2]) == 0
    said, error = capsys.readouterr()
    assert "Changed" not in said and "Traceback" not in error
    assert "warning" not in error  # The model is not used.


def test_a_funnel_of_another_glider_is_refused(reported, capsys):
    """With the model that it must be of."""
    funnel = str(models_path("funnels", "drawn.npz"))
    files = ["--model", str(reported.folder / "model.yaml"), "--every", "1000"]
    assert main(["check-funnel", funnel, *files]) in (0, 1)
    said, error = capsys.readouterr()
    assert "Traceback" not in said + error
    assert is_warned_of(reported, error) == (reported.result.verdict == "not_trusted")


def test_a_perch_is_planned_with_the_model(reported):
    path = reported.folder / "model.yaml"
    with warnings.catch_warnings(record=True) as given:
        warnings.simplefilter("always")
        planned = plan(path, PerchingProblem(), knots=15)
    texts = [str(one.message) for one in given if one.category is UserWarning]
    texts = [
        text for text in texts if "leaves what the model was traced on" not in text
    ]
    assert bool(texts) == (reported.result.verdict == "not_trusted")
    assert all("not trusted" in text for text in texts)
    assert np.all(np.isfinite(planned.states))
