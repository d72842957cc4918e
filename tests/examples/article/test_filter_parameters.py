"""Two numbers of the glider, known from nothing in flight; a filter that perches."""

import numpy as np
import pytest

import filter_parameters
from filter_study import CONSTANTS, RATE, watch_cruise
from glider.paths import models_path
from glider.physics.parameters import load_parameters
from tests.helpers.examples import run_main

pytestmark = pytest.mark.nightly

TRUTH = {"cruise": {"l_w": -0.03, "S_e": 0.0147}, "perch": {"l_w": 0.0, "S_e": 0.0147}}


@pytest.fixture(scope="module")
def found():
    return filter_parameters.fly(launches=2)


@pytest.fixture(scope="module")
def output(found, tmp_path_factory):
    folder = tmp_path_factory.mktemp("filter")
    return run_main(filter_parameters, found, folder, "--launches=2")


def known(found):
    """Returns what the filter of constants knows when a perch is over."""
    return {name: w.numbers(found.end) for name, w in found.constant[0].items()}


def test_the_article_s_filter_finds_both_numbers(found):
    for flight, truths in TRUTH.items():
        for name, (estimate, std, true) in found.drifting[flight].numbers().items():
            assert true == truths[name]
            assert abs(estimate - true) < 3.0 * std < 0.06


def test_constants_become_known_far_better(found):
    for flight, truths in TRUTH.items():
        drifting, least = found.drifting[flight].numbers(), found.least[flight]
        for k, (name, (estimate, std, _)) in enumerate(known(found)[flight].items()):
            assert abs(estimate - truths[name]) < 4.0 * std
            assert std < 0.3 * drifting[name][1]
            assert std > least[k]


def test_only_flights_whose_filter_knows_how_sure_it_is_are_reported(found, output):
    """The constants' NEES over 20 flights; in a settled cruise it is 206."""
    assert len(found.constant) == 20
    sure = found.slow_nees
    assert sure.keys() == found.constant[0].keys() == {"cruise", "perch"}
    assert max(sure.values()) < 3.0
    assert min(sure.values()) > 0.2
    assert "settled cruise" not in output.figures
    assert output.figures["slow_nees"] == sure


def test_deviations_and_the_least_of_them_are_of_one_time(found):
    """A cruise that went on to 4 s would know more than at the end of a perch."""
    assert found.end == round(found.plan.duration * RATE)
    behind = load_parameters(models_path("vehicles", "heavy_ekf.yaml"))
    watched = watch_cruise(behind, np.random.default_rng(0), CONSTANTS)
    np.testing.assert_allclose(
        found.least["cruise"], watched.bound[found.end], rtol=0.1
    )
    assert np.all(watched.bound[-1] < 0.8 * watched.bound[found.end])
    std = known(found)["cruise"]["l_w"][1]
    assert std == pytest.approx(watched.std[found.end, 0], rel=0.1)
    assert watched.std[-1, 0] < 0.85 * watched.std[found.end, 0]


def test_a_perch_tells_more_than_a_settled_cruise(found):
    perch, settled = (found.least[name] for name in ("perch", "settled cruise"))
    assert settled[0] > 4.0 * perch[0]
    assert settled[1] > 10.0 * perch[1]


def test_the_filter_is_consistent_and_perches(found):
    trusted = found.consistency
    assert np.mean(trusted.nees) == pytest.approx(1.0, abs=0.06)
    assert np.mean(trusted.nis) == pytest.approx(1.0, abs=0.03)
    assert min(trusted.nees_inside, trusted.nis_inside) > 0.8
    assert len(found.flown.on_estimate) == len(found.flown.on_state) == 2
    assert found.flown.on_estimate.worst.miss < 0.03


def test_the_result_is_reported(output, found):
    figures, trusted = output.figures, found.consistency
    for name, watched in found.drifting.items():
        assert figures[name] == watched.numbers()
    assert figures["constant"] == known(found)
    assert figures["least_std"] == {
        name: dict(zip(("l_w", "S_e"), bound, strict=True))
        for name, bound in found.least.items()
    }
    assert figures["seconds"] == found.end / RATE
    assert figures["nees"] == np.mean(trusted.nees)
    assert figures["nis"] == np.mean(trusted.nis)
    inside = figures["nees_inside"], figures["nis_inside"]
    assert inside == (trusted.nees_inside, trusted.nis_inside)
    assert "120 Hz" in figures["consistency_of"]
    assert "over 200 perches" in figures["consistency_of"]
    for seen in ("state", "estimate"):
        flights = getattr(found.flown, f"on_{seen}")
        assert figures[f"on_{seen}"] == flights.key_figures()
    assert (figures["launches"], figures["seed"]) == (2, 0)
    assert "On its estimate 2 of 2 launches perch" in output.words
    assert "NEES over 20 flights" in output.words
    assert output.asked.call_args.args[:2] == (2, 0)


def test_it_is_drawn_and_animated(output):
    assert output.size == (1425, 1260)
    assert output.ink > 0.05
    for words in ("Perch on an estimate", "worst launch on the estimate", "plan"):
        assert f">{words}<" in output.page


def test_the_help_says_what_the_json_holds_and_of_what(capsys):
    with pytest.raises(SystemExit):
        filter_parameters.main(["--help"])
    output = capsys.readouterr().out
    for words in ("--json: {", "consistency_of", "120 Hz", "no perch plan"):
        assert words in output
