"""Certified perches with the nominal and the corrected model, loaded and tried."""

import numpy as np
import pytest

from diagrams.programs.program import run
from examples import perching_funnel
from examples.perching_funnel import FunnelTrials, study_funnel
from glider.paths import models_path
from glider.physics.model import GliderModel
from glider.planning.problem import PerchingProblem
from glider.verification.funnel.funnel import load_funnel
from glider.verification.funnel.settings import LAUNCH_SIZES
from tests.helpers.examples import run_main

FUNNELS = models_path("funnels")
OPTIONS = ("--load", str(FUNNELS), "--prove", "--samples=80", "--every=200")


@pytest.fixture(scope="module")
def found():
    return perching_funnel.run(
        GliderModel.load("head_wind"),
        FunnelTrials(samples=80, every=200, prove=True),
        load=(FUNNELS / "drawn.npz", FUNNELS / "head_wind.npz"),
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("funnels")


@pytest.fixture(scope="module")
def output(found, folder):
    arguments = (*OPTIONS, f"--save={folder}")
    return run_main(perching_funnel, found, folder, *arguments)


@pytest.mark.nightly
def test_certificates_hold_and_no_flight_leaves(found):
    for study in found.studies.values():
        assert study.verdict.holds
        assert study.proof is not None
        assert study.falsification.samples >= 80
        assert study.falsification.escapes == 0
        assert study.funnel.half_widths()[1] > 0.05
        levels = study.funnel.level(study.funnel.nominal.times, study.flights)
        assert np.all(levels <= 1.0)


@pytest.mark.nightly
def test_the_true_glider_stays_in_the_funnel_of_what_was_found(found):
    nominal, corrected = found.nominal.on_truth, found.corrected.on_truth
    assert nominal.escapes > 0.5 * nominal.samples
    assert corrected.escapes == 0
    # A monitor in a diagram, of the launch that was planned.
    assert found.nominal.least_margin < 0.0 < found.corrected.least_margin < 1.0
    effects = found.corrected.funnel.nominal.model.effects
    assert [effect.kind.kind for effect in effects] == ["wind"]
    assert found.nominal.funnel.nominal.model.effects == ()


def test_the_result_is_reported(output, found):
    figures = output.figures
    for part, study in (
        (figures, found.nominal),
        (figures["corrected"], found.corrected),
    ):
        widths = study.funnel.half_widths()
        assert part["inlet"] == {
            "x_m": widths[0],
            "z_m": widths[1],
            "pitch_deg": np.degrees(widths[2]),
            "xdot": widths[4],
            "zdot": widths[5],
        }
        assert part["certificate_checked"] is True
        assert part["checked_intervals"] == study.verdict.intervals
        assert part["faults"] == []
        assert (part["samples"], part["escapes"]) == (study.falsification.samples, 0)
        assert part["largest_end"] == study.falsification.ends.max() <= 1.0
        assert "Proven: no flight of " in part["remainder_proof"]
        assert part["remainder_inflation"] == study.funnel.settings.remainder
        assert part["solver"] == study.funnel.solver
        assert part["seconds"] == study.funnel.seconds
        assert part["states"] == list(study.funnel.nominal.model.state_names)
        assert part["goal"] == list(study.funnel.settings.goal)
    assert figures["effects"] == []
    assert figures["corrected"]["effects"] == ["wind"]
    for name, study in found.studies.items():
        assert figures[f"{name}_on_truth_escapes"] == study.on_truth.escapes
        assert figures[f"{name}_on_truth_samples"] == study.on_truth.samples
        assert figures[f"{name}_on_truth_least_margin"] == study.least_margin
    assert (figures["truth"], figures["seed"]) == ("head_wind", 0)
    assert "Flown by head_wind, 0 of" in output.words


def test_it_is_drawn_and_animated(output):
    assert output.size == (1200, 1056)
    assert output.ink > 0.05
    for words in ("A certified perch: head_wind", "nominal", "flight 1", "flight 3"):
        assert f">{words}<" in output.page


def test_funnels_are_saved(output, found, folder):
    for name, study in (
        ("drawn.npz", found.nominal),
        ("head_wind.npz", found.corrected),
    ):
        saved = load_funnel(folder / name)
        np.testing.assert_array_equal(saved.S, study.funnel.S)
        assert saved.nominal.model == study.funnel.nominal.model


def test_the_options_reach_the_story(output):
    truth, trials, seed = output.asked.call_args.args
    assert truth == GliderModel.load("head_wind")
    assert trials == FunnelTrials(samples=80, every=200, prove=True)
    assert seed == 0
    options = output.asked.call_args.kwargs
    assert options["load"] == (FUNNELS / "drawn.npz", FUNNELS / "head_wind.npz")
    assert options["flights"] == 20


def test_the_hook_and_a_feedback_are_asked_for(found, tmp_path):
    asked = [*OPTIONS, "--hook", "--elevator-gain=40", "--for-launches"]
    output = run_main(perching_funnel, found, tmp_path, *asked)
    trials = output.asked.call_args.args[1]
    file = models_path("problems", "perching_hook.yaml")
    assert (trials.problem, trials.hook) == (PerchingProblem.load(file), True)
    assert trials.settings.elevator_gain == 40.0
    assert trials.settings.launch_sizes == LAUNCH_SIZES


def test_a_funnel_whose_states_the_truth_lacks_is_not_flown_by_it(found, tmp_path):
    """As where a servo's lag was found and the true glider has none."""
    lost = dict(vars(found.corrected), on_truth=None)
    study = type(found.corrected)(**lost)
    other = type(found)(nominal=found.nominal, corrected=study)
    output = run_main(perching_funnel, other, tmp_path, *OPTIONS)
    assert output.figures["corrected_on_truth_escapes"] is None
    assert output.figures["corrected_on_truth_samples"] is None
    assert "it has no meaning: their states differ" in output.words
    assert output.figures["corrected"]["made_for"] is None


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--json", "{folder}/none/f.json"], "does not exist"),
        (["--save", "{folder}/none"], "does not exist"),
        (["--remainder", "-1"], "remainder"),
        (["--elevator-gain", "nan"], "'elevator_gain' is nan"),
        (["--load", "{folder}"], "cannot be read: No such file"),
        (["--truth", "gremlins"], "gremlins"),
    ],
)
def test_bad_input_is_one_sentence(arguments, words, tmp_path, capsys):
    filled = [a.format(folder=tmp_path) for a in arguments]
    assert run(lambda: perching_funnel.main([*filled, "--headless"])) == 2
    message = capsys.readouterr().err.strip().splitlines()[-1]
    assert message.startswith("error: ")
    assert words in message


def test_there_is_nothing_to_prove_without_a_remainder(capsys):
    with pytest.raises(SystemExit) as end:
        perching_funnel.main(["--prove", "--headless"])
    assert end.value.code == 2
    assert "nothing to prove without --remainder" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--confidence", "0.95"], "it takes a --remainder"),
        (["--confidence", "95", "--remainder", "1.1"], "between 0 and 1"),
    ],
)
def test_gliders_are_allowed_with_a_probability(arguments, words, capsys):
    with pytest.raises(SystemExit) as end:
        perching_funnel.main([*arguments, "--headless"])
    assert end.value.code == 2
    assert words in capsys.readouterr().err


def test_a_funnel_that_the_hook_does_not_take_is_reported():
    """One of the article's goal, where the hook's was asked for."""
    trials = FunnelTrials(samples=80, every=1000, hook=True)
    truth, rng = GliderModel.load("head_wind"), np.random.default_rng(0)
    file = FUNNELS / "head_wind.npz"
    study = study_funnel(file, truth, trials, rng, lambda text: None)
    assert any("hook accepts" in fault for fault in study.verdict.faults)


def test_a_funnel_of_all_gliders_that_the_logs_allow(found, tmp_path):
    file = models_path("funnels", "head_wind_95.npz")
    trials = FunnelTrials(samples=80, every=100)
    truth, rng = GliderModel.load("head_wind"), np.random.default_rng(0)
    study = study_funnel(file, truth, trials, rng, lambda text: None)
    assert study.verdict.holds
    assert study.on_truth.escapes == study.on_set.escapes == 0
    assert study.on_set.samples >= 80
    whole = type(found)(nominal=found.nominal, corrected=study)
    output = run_main(perching_funnel, whole, tmp_path, *OPTIONS)
    part = output.figures["corrected"]
    assert part["made_for"].startswith("95 % ellipsoid of wind.x ± 0.0008")
    assert (part["on_set_samples"], part["on_set_escapes"]) == (study.on_set.samples, 0)
    assert "made for the gliders of a 95 % ellipsoid" in output.words
    assert output.figures["on_set_escapes"] is None  # Of the nominal model's.
