"""The identification exercise: published scores, their sign fault, and what helps."""

import math

import numpy as np
import pytest

import basis_model
from diagrams.programs.program import run
from tests.helpers.examples import run_main

pytestmark = pytest.mark.nightly

PUBLISHED = [113727, 183944, 120629, 104607, 192647, 63831, 157343, 96418]
PUBLISHED += [129489, 174510]
CONSISTENT = [116008, 197861, 114153, 93612, 210773, 4013, 131394, 28827]
CONSISTENT += [128622, 210798]


@pytest.fixture(scope="module")
def study():
    return basis_model.run()


@pytest.fixture(scope="module")
def output(study, tmp_path_factory):
    return run_main(basis_model, study, tmp_path_factory.mktemp("basis"))


@pytest.mark.parametrize(
    ("signs", "scores"),
    [("published_signs", PUBLISHED), ("consistent_signs", CONSISTENT)],
)
def test_scores_are_the_published_ones_to_the_integer(study, output, signs, scores):
    fits = study.fits.configurations[signs]
    assert list(fits) == [str(i) for i in range(1, 11)]
    assert [int(fit.score) for fit in fits.values()] == scores
    assert output.figures["scores"][signs] == dict(zip(fits, scores, strict=True))


def test_the_published_model_ends_where_the_article_says(study, output):
    published = study.flown["configuration 6 published signs"]
    x, z, pitch = published[-1, :3]
    assert 3.34 <= x <= 3.36 and 4.99 <= z <= 5.10 and -0.54 <= pitch <= -0.52
    assert output.figures["held_out_end"] == [x, z, pitch]


def test_the_best_subsets_of_the_same_features_leave_next_to_nothing(study, output):
    best = study.fits.subsets["best_subsets"]
    assert best.score == pytest.approx(2.55, abs=0.005)
    assert best.model.numbers == ((5, 15, 24), (1, 26, 30), (15, 26, 30))
    for name, fit in study.fits.subsets.items():
        along, normal, pitch = map(list, fit.model.numbers)
        channels = {"tangential": along, "normal": normal, "pitch": pitch}
        assert output.figures[name] == {"total": fit.score, **channels}


def test_the_tracer_names_the_sign_fault_and_nothing_else(study, output):
    [effect] = study.traced.effects
    assert effect.kind == "angle_sign"
    assert effect.share_of_residual > 0.99
    assert output.figures["traced"] == {
        "angle_sign": {"share": effect.share_of_residual}
    }


def test_the_exercises_own_numbers_show_the_fault(study, output):
    signs = study.signs
    assert (signs.pitch, signs.elevator, signs.command) == (-1, -1, -1)
    assert signs.share > 0.99
    assert output.figures["signs"] == vars(signs)


def test_rank_and_condition_of_each_channel_are_reported(study, output):
    regressions = output.figures["regressions"]
    names = ["published_signs", "consistent_signs", "best_subsets"]
    assert list(regressions) == [*names, "best_subsets_of_41"]
    for (name, numbers), channels in zip(
        study.exercise.configurations.items(),
        regressions["consistent_signs"].values(),
        strict=True,
    ):
        ranks = [channel["rank"] for channel in channels.values()]
        assert ranks == [len(chosen) for chosen in numbers], name
        assert all(channel["condition"] >= 1.0 for channel in channels.values())
    assert list(regressions["best_subsets"]) == ["tangential", "normal", "pitch"]


def test_refined_models_fly_the_held_out_flight_closer(study, output):
    for name in ("configuration 6 consistent signs", "best subsets"):
        pair = study.rollouts[name]
        assert pair["after"].weighted < 0.6 * pair["before"].weighted
    assert output.figures["rollout"] == {
        name: {when: vars(error) for when, error in pair.items()}
        for name, pair in study.rollouts.items()
    }


def test_held_out_flights_prefer_the_searched_model_and_show_what_diverges(
    study, output
):
    errors = study.choice["consistent_signs"]
    assert min(errors.values()) == errors["best 3"]
    assert math.isinf(errors["2"]) and math.isinf(errors["8"])
    written = output.figures["cross_validation"]
    assert written["consistent_signs"]["2"] is None
    for signs, candidates in study.choice.items():
        finite = {name: error for name, error in candidates.items() if error < np.inf}
        assert written[signs] == {name: finite.get(name) for name in candidates}


def test_the_help_names_every_key_figure(output):
    for key in output.figures:
        assert f'"{key}"' in basis_model.__doc__
    for model in output.figures["rollout"].values():
        for key in model["after"]:
            assert f'"{key}"' in basis_model.__doc__


def test_it_is_said_drawn_and_animated(output):
    words = "best_subsets leave 2.55: tangential V² sin³ a, V u sin p, W² sin b sin p; "
    assert words + "normal V² sin a, " in output.words
    assert "the tracer names angle_sign" in output.words
    assert "consistent_signs: held-out flights choose 'best 3'" in output.words
    assert output.size == (1425, 1200)
    assert output.ink > 0.05
    for words in ("Held-out flight", "flight", "published signs", "consistent signs"):
        assert f">{words}<" in output.page


def test_the_options_reach_the_story(study, tmp_path):
    output = run_main(basis_model, study, tmp_path, "--ridge=2.5", "--seed=4")
    assert output.asked.call_args.args[:2] == (2.5, 4)


def test_a_negative_ridge_is_one_sentence(capsys):
    assert run(lambda: basis_model.main(["--headless", "--ridge", "-1"])) == 2
    assert "the ridge is -1.0; expected a finite ridge >= 0" in capsys.readouterr().err
