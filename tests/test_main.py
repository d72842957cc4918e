"""The command line: what it writes, prints and returns."""

import json
import shutil

import pytest

from glider.__main__ import main
from tests.helpers.campaigns import campaign_path


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """The main job on a few flights of the sample campaign."""
    out = tmp_path_factory.mktemp("out") / "report"
    flights = ",".join(f"flight_{i:03d}" for i in range(10))
    campaign = str(campaign_path("attached_lift"))
    code = main(["close-the-loop", campaign, "--out", str(out), "--flights", flights])
    return code, out


def test_it_runs_and_writes_everything(done):
    code, out = done
    assert code == 0
    assert (out / "report.html").stat().st_size > 10_000
    assert list((out / "figures").glob("*.png"))
    report = json.loads((out / "report.json").read_text())
    assert report["verdict"] == "effect_found"
    assert report["effects"][0]["kind"] == "attached_lift"


def test_the_model_loads(done):
    from glider.physics.model import load_model

    model = load_model(done[1] / "model.yaml")
    assert [e.kind.kind for e in model.effects] == ["attached_lift"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["nowhere"], "nowhere"),
        (["{campaign}", "--effects", "gremlins"], "gremlins"),
        (["{campaign}", "--held-out", "2"], "held-out"),
        (["{campaign}", "--flights", "flight_1234"], "flight_1234"),
        (["{campaign}", "--grade", "A"], "index.csv"),
        (["{campaign}", "--seed", "-1"], "seed"),
    ],
)
def test_bad_input_is_one_sentence_and_exit_code_2(arguments, words, capsys, tmp_path):
    campaign = str(campaign_path("still_air"))
    filled = [a.format(campaign=campaign) for a in arguments]
    out = tmp_path / "out"
    assert main(["close-the-loop", *filled, "--out", str(out)]) == 2
    message = capsys.readouterr().err.strip()
    assert words in message
    assert message.count("\n") == 0
    assert not out.exists()


def test_a_spoilt_log_names_file_column_and_row(tmp_path, capsys):
    folder = tmp_path / "campaign"
    shutil.copytree(campaign_path("still_air"), folder)
    path = folder / "flight_003.csv"
    lines = path.read_text().splitlines()
    cells = lines[6].split(",")
    lines[6] = ",".join([cells[0], "oops", *cells[2:]])
    path.write_text("\n".join(lines))
    assert main(["close-the-loop", str(folder)]) == 2
    message = capsys.readouterr().err
    for word in ("flight_003.csv", "'x'", "7", "oops"):
        assert word in message


def test_help_teaches(capsys):
    with pytest.raises(SystemExit) as stop:
        main(["close-the-loop", "--help"])
    assert stop.value.code == 0
    text = capsys.readouterr().out
    for word in ("campaign.yaml", "--held-out", "examples", "exit code"):
        assert word in text
