"""The example that shows a logged flight."""

import json

import pytest

from diagrams.showing import run
from examples.watch_log import main
from glider.paths import models_path
from glider.physics.model import save_model
from tests.sysid.test_refly import CORRECTED

CAMPAIGN = str(models_path("campaigns", "attached_lift"))


@pytest.fixture
def model(tmp_path):
    save_model(tmp_path / "model.yaml", CORRECTED)
    return str(tmp_path / "model.yaml")


def test_a_flight_is_shown_with_both_models(model, tmp_path, capsys):
    page, figures = tmp_path / "flight.html", tmp_path / "figures.json"
    arguments = [CAMPAIGN, "flight_003", "--model", model, "--headless"]
    main([*arguments, "--html", str(page), "--json", str(figures)])
    told = json.loads(figures.read_text())
    assert told["flight"] == "flight_003.csv" and told["rows"] == 103
    assert told["duration_s"] == pytest.approx(0.85, abs=0.01)
    assert told["corrected"]["position_rms_m"] < 0.005
    assert told["as_drawn"]["position_rms_m"] > 0.1
    text = page.read_text(encoding="utf-8")
    for words in ("attached_lift, flight_003.csv", "measured", "as drawn", "corrected"):
        assert f">{words}<" in text
    assert "as drawn: 2" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([CAMPAIGN, "flight_099"], "there is no flight 'flight_099'; there are flight"),
        (["nowhere", "flight_000"], "nowhere: does not exist"),
        ([CAMPAIGN, "flight_000", "--model", "no.yaml"], "no.yaml: not a glider model"),
        ([CAMPAIGN, "flight_000", "--json", "no/f.json"], "folder no does not exist"),
    ],
)
def test_what_a_user_gets_wrong_is_one_sentence(arguments, words, capsys):
    assert run(lambda: main([*arguments, "--headless"])) == 2
    error = capsys.readouterr().err
    assert words in error
    assert "Traceback" not in error


def test_help_teaches(capsys):
    with pytest.raises(SystemExit) as end:
        main(["--help"])
    assert end.value.code == 0
    text = capsys.readouterr().out
    assert "examples/watch_log.py models/campaigns/attached_lift flight_003" in text
    assert "ghosts" in text
