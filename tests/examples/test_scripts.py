"""The examples from the command line: what they print, draw and refuse."""

import dataclasses
import functools
import importlib
import inspect
import re
from pathlib import Path

import joblib
import matplotlib.image
import numpy as np
import pytest

from diagrams.programs.program import run
from examples.perch_corrected import rehearse
from glider import funnels
from glider.campaign.reader import load_campaign
from glider.campaign.writer import save_campaign
from glider.paths import models_path
from glider.physics.model import GliderModel
from glider.planning.problem import PerchingProblem
from tests.helpers.campaigns import campaign_path
from tests.simulation.test_refly import CORRECTED

NAMES = sorted(path.stem for path in Path("examples").glob("*.py"))

GIVEN = {"watch_log": ["attached_lift", "flight_003"]}
"""What must be on the command line."""


def load(name):
    return importlib.import_module(f"examples.{name}")


def show(name, folder, *arguments):
    """Runs an example that writes a page and a picture; returns page and ink."""
    files = {"--html": folder / "page.html", "--figure": folder / "figure.png"}
    given = [f"{option}={file}" for option, file in files.items()]
    load(name).main([*map(str, arguments), "--headless", *given])
    picture = matplotlib.image.imread(files["--figure"])
    ink = np.mean(np.min(picture[..., :3], axis=-1) < 0.95)
    return files["--html"].read_text(encoding="utf-8"), ink


@pytest.mark.parametrize("name", NAMES)
def test_the_help_is_the_docstring_with_a_usage(name, capsys):
    with pytest.raises(SystemExit) as end:
        load(name).main(["--help"])
    assert end.value.code == 0
    words = capsys.readouterr().out
    assert inspect.cleandoc(load(name).__doc__) in words
    assert f"python examples/{name}.py" in words
    assert "--json" not in words


@pytest.mark.parametrize(
    ("name", "arguments", "words"),
    [
        ("perch", ["--figure", "absent/a.png"], "in a folder that exists"),
        ("perch", ["--figure", "a.txt"], "the format is '.txt'"),
        ("perch", ["--problem", "fence"], "fence"),
        ("perch_corrected", ["--truth", "gremlins"], "gremlins"),
        ("perching_funnel", ["--load", "absent"], "absent/drawn.npz: "),
        ("perching_funnel", ["--save", "absent"], "in a folder that exists"),
        ("replan", ["--model", "absent.yaml"], "absent.yaml: not a glider model"),
        ("close_the_loop", ["absent"], "absent: does not exist"),
        ("cruise", ["--speed", "1"], "No steady flight at 1 m/s"),
        ("launch_map", ["--figure", "absent/a.png"], "in a folder that exists"),
        ("watch_log", ["attached_lift", "flight_099"], "there is no flight"),
        (
            "watch_log",
            ["attached_lift", "flight_003", "--model", "no.yaml"],
            "no.yaml: not",
        ),
    ],
)
def test_bad_input_is_one_sentence(name, arguments, words, capsys):
    assert run(lambda: load(name).main(arguments)) == 2
    output = capsys.readouterr()
    assert output.out == ""
    [line] = output.err.strip().splitlines()
    assert line.startswith("error: ")
    assert words in line


def test_a_perch_is_the_articles_and_feedback_brings_all_launches_there(
    tmp_path, capsys
):
    page, ink = show("perch", tmp_path, "--launches=4")
    words = capsys.readouterr().out
    assert "costs 194.05 and takes 0.8795 s (41 knots" in words
    alone = float(re.search(r"without feedback it misses by (\S+) mm", words)[1])
    assert alone < 1.0
    [(_, blind), (perched, fed_back)] = re.findall(
        r"(\d) of 4 launches perch, median miss (\S+) mm", words
    )
    assert int(perched) == 4
    assert float(fed_back) < 0.1 * float(blind)
    assert ink > 0.02
    for name in ("Perch", "worst launch", "plan"):
        assert f">{name}<" in page


@pytest.mark.nightly
def test_of_a_hundred_launches_the_wind_is_found_and_nothing_else(tmp_path, capsys):
    """As README.md and the tables of the docs run it."""
    page, ink = show("perch_corrected", tmp_path)
    words = capsys.readouterr().out
    assert ink > 0.02
    assert ">Before and after: head_wind<" in page
    assert "The flights show a steady wind" in words
    nominal = re.search(r"planned nominal: (\d+) of 100 launches perch", words)
    assert int(nominal[1]) < 50
    assert "planned corrected: 100 of 100 launches perch" in words


def test_a_rehearsal_is_repeatable_and_its_logs_are_of_the_flights():
    problem, nominal = PerchingProblem(wire=[-0.2, -0.1]), GliderModel()
    starts = problem.draw_launches(3, np.random.default_rng(0))
    (_, first), (_, again) = (
        rehearse(nominal, nominal, problem, starts, np.random.default_rng(1))
        for _ in range(2)
    )
    assert first.misses == again.misses
    assert first.perched == 3
    logs = first.campaign.flights
    assert [f.name for f in logs] == [f"flight_{k:03d}.csv" for k in range(3)]
    for flight, log in zip(first, logs, strict=True):
        columns = flight.states.T
        path = np.array([np.interp(log.time, flight.times, c) for c in columns])
        # Between the integrator's steps a straight line is a millimeter off.
        np.testing.assert_allclose(log.pose[:, :2], path[:2].T, atol=0.004)
        assert not np.allclose(log.pose[:, 2], path[2], atol=1e-4)  # Noise.


def test_a_loop_is_closed_and_its_model_saved(tmp_path, capsys, monkeypatch):
    example = load("close_the_loop")
    quick = functools.partial(example.close_the_loop, effects=["attached_lift"])
    monkeypatch.setattr(example, "close_the_loop", quick)
    campaign = load_campaign(campaign_path("attached_lift"))
    few = dataclasses.replace(campaign, flights=campaign.flights[:5])
    folder, model = tmp_path / "attached_lift", tmp_path / "model.yaml"
    save_campaign(folder, few)
    example.main([str(folder), f"--model={model}"])
    words = capsys.readouterr().out
    assert "attached_lift: effect_found" in words
    assert "slope = " in words
    nominal, corrected = re.findall(r"(\w+): held-out position error", words)[::2]
    assert (nominal, corrected) == ("nominal", "corrected")
    assert [e.kind.kind for e in GliderModel.load(model).effects] == ["attached_lift"]


def test_a_logged_flight_is_shown_with_both_models(tmp_path, capsys):
    model, page = tmp_path / "model.yaml", tmp_path / "page.html"
    CORRECTED.save(model)
    arguments = [*GIVEN["watch_log"], f"--model={model}", f"--html={page}"]
    load("watch_log").main([*arguments, "--headless"])
    words = capsys.readouterr().out
    assert "flight_003.csv: 103 rows in 0.85 s" in words
    errors = dict(re.findall(r"(\w+): (\d+) mm off", words))
    assert int(errors["corrected"]) < 5 < 100 < int(errors["nominal"])
    text = page.read_text(encoding="utf-8")
    for name in ("attached_lift, flight_003.csv", "measured", "nominal", "corrected"):
        assert f">{name}<" in text


def test_launches_are_mapped(tmp_path, capsys):
    picture = tmp_path / "map.png"
    with joblib.parallel_config("threading"):  # No processes, which import all again.
        load("launch_map").main(["--launches=60", f"--figure={picture}"])
    found = re.match(r"(\d+) of 60 launches have a plan", capsys.readouterr().out)
    assert 20 < int(found[1]) < 60
    assert np.mean(matplotlib.image.imread(picture)[..., :3] < 0.95) > 0.02


@pytest.mark.nightly
def test_few_throws_tell_the_hidden_effect(tmp_path, capsys):
    page, ink = show("next_throw", tmp_path)
    words = capsys.readouterr().out
    known = re.findall(r"command_delay (\d\.\d\d)", words)
    assert float(known[0]) < 0.95 <= float(known[-1])
    assert "the hidden effect was command_delay" in words
    assert "proposed" in page
    assert ink > 0.02


@pytest.mark.parametrize("every", [200, pytest.param(1, marks=pytest.mark.nightly)])
def test_the_true_glider_stays_in_the_funnel_of_what_was_found(
    every, tmp_path, capsys, monkeypatch
):
    """Of both funnels every so many intervals are checked: all take a minute."""
    some = functools.partial(funnels.check_funnel, every=every)
    monkeypatch.setattr(funnels, "check_funnel", some)
    folder = models_path("funnels")
    page, ink = show("perching_funnel", tmp_path, f"--load={folder}", "--samples=80")
    nominal, corrected = capsys.readouterr().out.split("corrected model:")
    assert nominal.count("certificate holds") == corrected.count("holds") == 1
    own, others = re.findall(r"(\d+) of \d+ (?:flights from|leave it)", nominal)
    assert int(own) == 0 < int(others)
    assert re.findall(r"(\d+) of \d+ (?:flights from|leave it)", corrected) == 2 * ["0"]
    assert "least margin is -" in nominal and "least margin is 0." in corrected
    assert ink > 0.05
    assert ">A certified perch: head_wind<" in page
