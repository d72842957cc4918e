"""A logged flight, shown with the flights that two models make of it."""

import pytest

from diagrams.programs.program import run
from examples import watch_log
from glider.campaign.reader import load_campaign
from tests.helpers.examples import run_main
from tests.simulation.test_refly import CORRECTED

CAMPAIGN = "attached_lift"


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    path = tmp_path_factory.mktemp("model") / "model.yaml"
    CORRECTED.save(path)
    return path


@pytest.fixture(scope="module")
def flown(model):
    return watch_log.fly(load_campaign(CAMPAIGN), "flight_003", model)


@pytest.fixture(scope="module")
def output(flown, model, tmp_path_factory):
    arguments = (CAMPAIGN, "flight_003", "--model", str(model))
    folder, writes = tmp_path_factory.mktemp("log"), ("--json", "--html")
    return run_main(watch_log, flown, folder, *arguments, writes=writes)


def test_the_corrected_model_flies_as_the_glider_did(flown):
    assert flown.flight.name == "flight_003.csv"
    assert list(flown.motions) == ["measured", "nominal", "corrected"]
    time = flown.motions["measured"].time
    assert len(time) == 103
    assert time[-1] == pytest.approx(0.85, abs=0.01)
    assert flown.errors["corrected"][0] < 0.005
    assert flown.errors["nominal"][0] > 0.1
    assert flown.motions["measured"].forces.shape == (103, 2)


def test_the_result_is_reported(output, flown):
    figures = dict(output.figures)
    assert figures.pop("flight") == "flight_003.csv"
    assert figures.pop("rows") == 103
    assert figures.pop("duration_s") == flown.motions["measured"].time[-1]
    assert figures.keys() == {"nominal", "corrected"}
    for name, (rms, end) in flown.errors.items():
        errors = figures[name.replace(" ", "_")]
        assert errors == {"position_rms_m": rms, "position_end_m": end}
    assert "nominal: 2" in output.words


def test_a_flight_is_shown_with_both_models(output):
    for words in ("attached_lift, flight_003.csv", "measured", "nominal", "corrected"):
        assert f">{words}<" in output.page


def test_the_options_reach_the_story(output, model):
    campaign, *rest = output.asked.call_args.args[:3]
    assert campaign.name == "attached_lift"
    assert rest == ["flight_003", model]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([CAMPAIGN, "flight_099"], "there is no flight 'flight_099'; expected one of"),
        (["nowhere", "flight_000"], "nowhere: does not exist"),
        ([CAMPAIGN, "flight_000", "--model", "no.yaml"], "no.yaml: not a glider model"),
        ([CAMPAIGN, "flight_000", "--json", "no/f.json"], "folder no does not exist"),
    ],
)
def test_what_a_user_gets_wrong_is_one_sentence(arguments, words, capsys):
    assert run(lambda: watch_log.main([*arguments, "--headless"])) == 2
    error = capsys.readouterr().err
    assert words in error
    assert "Traceback" not in error


def test_help_teaches(capsys):
    with pytest.raises(SystemExit) as end:
        watch_log.main(["--help"])
    assert end.value.code == 0
    text = capsys.readouterr().out
    assert "examples/watch_log.py attached_lift flight_003" in text
    assert "ghosts" in text
