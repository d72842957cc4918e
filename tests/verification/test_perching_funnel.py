"""The example of funnels."""

import functools
import json

import pytest

from diagrams.showing import run
from examples import perching_funnel
from glider.paths import models_path
from glider.verification.trials.estimated import study_estimates


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--json", "{folder}/none/f.json"], "does not exist"),
        (["--remainder", "-1"], "remainder"),
        (["--load", "{folder}"], "not a funnel"),
        (["--truth", "gremlins"], "gremlins"),
    ],
)
def test_bad_input_of_the_example_is_one_sentence(arguments, words, tmp_path, capsys):
    filled = [a.format(folder=tmp_path) for a in arguments]
    assert run(lambda: perching_funnel.main([*filled, "--headless"])) == 2
    message = capsys.readouterr().err.strip().splitlines()[-1]
    assert message.startswith("error: ")
    assert words in message


def test_the_example_tells_its_story(tmp_path, capsys, monkeypatch):
    few = functools.partial(study_estimates, noises=[0.001], unknown=[0.1, 1.0])
    monkeypatch.setattr(perching_funnel, "study_estimates", few)
    out, figure = tmp_path / "f.json", tmp_path / "f.png"
    perching_funnel.main(
        [
            *("--load", str(models_path("funnels", "proven")), "--prove"),
            *("--samples", "80", "--every", "100", "--headless", "--estimate", "1"),
            *("--json", str(out), "--figure", str(figure)),
        ]
    )
    found = json.loads(out.read_text())
    for part in (found, found["corrected"]):
        assert part["certificate_checked"] is True
        assert part["escapes"] == 0
        assert part["inlet"]["z_m"] > 0.05
        assert part["remainder"].startswith("rigorous until t=0.")
    assert found["drawn_on_truth_escapes"] > 0.5 * found["drawn_on_truth_samples"]
    assert found["corrected_on_truth_escapes"] == 0
    assert found["corrected"]["effects"] == ["wind"]
    assert found["estimate"]["flights"] == 1
    assert [row["unknown"] for row in found["estimate"]["bears"]] == [0.1, 1.0]
    assert "Flown by head_wind, 0 of" in capsys.readouterr().out
    for picture in (figure, tmp_path / "f_estimate.png"):
        assert picture.stat().st_size > 10_000
