"""The article's study: two numbers of the glider, known from nothing in flight."""

import dataclasses
import json

import numpy as np
import pytest

from examples import filter_parameters
from glider.errors import InputError
from glider.paths import models_path
from glider.physics.effects import THRUST
from glider.physics.model import GliderModel
from glider.physics.parameters import (
    GliderParameters,
    load_parameters,
)
from glider.studies.cruising import (
    cruise_gain,
    level_flight,
)
from glider.studies.filter_study import (
    CONSTANTS,
    RATE,
    draw_wind,
    slow_nees,
    watch_cruise,
    watch_perch,
)
from glider.systems.plant import GliderPlant
from tests.helpers.flights import policy

BEHIND = load_parameters(models_path("vehicles", "heavy_ekf.yaml"))


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """The example's JSON, with its other files beside it."""
    folder = tmp_path_factory.mktemp("filter")
    filter_parameters.main(
        [
            "--headless",
            "--launches=2",
            f"--json={folder / 'f.json'}",
            f"--figure={folder / 'f.png'}",
            f"--html={folder / 'f.html'}",
        ]
    )
    assert (folder / "f.html").stat().st_size > 1_000_000
    assert (folder / "f.png").stat().st_size > 10_000
    return json.loads((folder / "f.json").read_text())


def test_the_article_s_filter_finds_both_numbers(results):
    for flight, wing in (("cruise", -0.03), ("perch", 0.0)):
        for name, truth in (("l_w", wing), ("S_e", 0.0147)):
            estimate, std, true = results[flight][name]
            assert true == truth
            assert abs(estimate - true) < 3.0 * std < 0.06


def test_constants_become_known_far_better(results):
    for flight, wing in (("cruise", -0.03), ("perch", 0.0)):
        for name, truth in (("l_w", wing), ("S_e", 0.0147)):
            estimate, std, _ = results["constant"][flight][name]
            assert abs(estimate - truth) < 4.0 * std
            assert std < 0.3 * results[flight][name][1]
            assert std > results["least_std"][flight][name]


def test_only_flights_whose_filter_knows_how_sure_it_is_are_reported(results):
    """The constants' NEES over 20 flights; in a settled cruise it is 206."""
    sure = results["slow_nees"]
    assert sure.keys() == results["constant"].keys() == {"cruise", "perch"}
    assert max(sure.values()) < 3.0
    assert min(sure.values()) > 0.2
    assert "settled cruise" not in results


def test_deviations_and_the_least_of_them_are_of_one_time(results):
    """A cruise that went on to 4 s would know more than at the end of a perch."""
    end = round(results["seconds"] * RATE)
    watched = watch_cruise(BEHIND, np.random.default_rng(0), CONSTANTS)
    found = list(results["least_std"]["cruise"].values())
    np.testing.assert_allclose(found, watched.bound[end], rtol=0.1)
    assert np.all(watched.bound[-1] < 0.8 * watched.bound[end])
    found = results["constant"]["cruise"]["l_w"][1]
    assert found == pytest.approx(watched.std[end, 0], rel=0.1)
    assert watched.std[-1, 0] < 0.85 * watched.std[end, 0]


def test_a_perch_teaches_both_numbers():
    """The filter starts wrong about both, and ends far less so."""
    rng = np.random.default_rng(0)
    watched = watch_perch(GliderParameters(), policy(), rng, CONSTANTS)
    errors = np.abs(watched.slow - watched.truth)
    assert np.all(errors[0] > 0.01)
    assert np.all(errors[-1] < 0.35 * errors[0])


def test_slow_nees_is_one_where_errors_are_as_large_as_expected():
    watched = watch_cruise(BEHIND, np.random.default_rng(0), CONSTANTS)
    covariance = watched.estimates.covariances[0, 50, -2:, -2:]
    draws = np.random.default_rng(0).multivariate_normal([0, 0], covariance, 400)

    def erring(error):
        means = watched.estimates.means.copy()
        means[0, 50, -2:] = watched.truth + error
        estimates = dataclasses.replace(watched.estimates, means=means)
        return dataclasses.replace(watched, estimates=estimates)

    assert slow_nees([erring(e) for e in draws], 50) == pytest.approx(1.0, abs=0.1)


def test_the_help_says_what_the_json_holds_and_of_what(capsys):
    with pytest.raises(SystemExit):
        filter_parameters.main(["--help"])
    told = capsys.readouterr().out
    for words in ("--json: {", "consistency_of", "120 Hz", "no perch plan"):
        assert words in told


def test_a_perch_tells_more_than_a_settled_cruise(results):
    perch, settled = (results["least_std"][k] for k in ("perch", "settled cruise"))
    assert settled["l_w"] > 4.0 * perch["l_w"]
    assert settled["S_e"] > 10.0 * perch["S_e"]


def test_the_filter_is_consistent_and_perches(results):
    assert "120 Hz" in results["consistency_of"]
    assert results["nees"] == pytest.approx(1.0, abs=0.06)
    assert results["nis"] == pytest.approx(1.0, abs=0.03)
    assert min(results["nees_inside"], results["nis_inside"]) > 0.8
    assert max(results["miss_on_estimate_m"]) < 0.03


def test_the_cruise_is_level_and_held():
    """The trim is Drake's plant's, at rest; the start's 0.5 m are gone after 4 s."""
    trim = level_flight(BEHIND, 9.0)
    assert trim[[4, 5]].tolist() == [9.0, 0.0]
    thrust = THRUST(force=float(trim[7]))
    plant = GliderPlant(GliderModel(parameters=BEHIND, effects=(thrust,)))
    context = plant.CreateDefaultContext()
    context.SetContinuousState(trim[:7])
    plant.GetInputPort("elevator_rate").FixValue(context, [0.0])
    rates = plant.EvalTimeDerivatives(context).CopyToVector()
    np.testing.assert_allclose(rates, [9.0, 0, 0, 0, 0, 0, 0], atol=1e-9)
    watched = watch_cruise(BEHIND, np.random.default_rng(0), CONSTANTS)
    assert abs(watched.flight.states[0, -1, 1]) < 0.1
    assert np.max(np.abs(watched.flight.inputs[0, :, 0])) == BEHIND.elevator_rate_limit


def test_the_gain_stabilizes_what_drake_linearizes():
    """Closed-loop poles of all states but x, by differences of the plant."""
    trim, step = level_flight(BEHIND, 9.0), 1e-6
    gain = cruise_gain(BEHIND, trim)

    def motion(point):
        x = point[:7]
        push = -gain @ (x - trim[:7])
        effects = (THRUST(force=float(trim[7] + push[1])),)
        plant = GliderPlant(GliderModel(parameters=BEHIND, effects=effects))
        context = plant.CreateDefaultContext()
        context.SetContinuousState(x)
        plant.GetInputPort("elevator_rate").FixValue(context, push[:1])
        return plant.EvalTimeDerivatives(context).CopyToVector()

    A = np.array(
        [(motion(trim[:7] + d) - motion(trim[:7] - d)) for d in step * np.eye(7)]
    ).T / (2.0 * step)
    assert np.max(np.linalg.eigvals(A[1:, 1:]).real) < -0.5
    assert np.all(gain[:, 0] == 0.0)


def test_a_glider_without_level_flight_is_refused():
    with pytest.raises(InputError, match="No level flight at 1 m/s"):
        level_flight(GliderParameters(), 1.0)


def test_the_wind_drifts_as_the_article_says():
    wind = draw_wind(20_000, np.random.default_rng(0), (-1.0, 0.5))
    assert wind[0].tolist() == [-1.0, 0.5]
    before, after = wind[:-1].ravel(), wind[1:].ravel()
    assert before @ after / (before @ before) == pytest.approx(0.999, abs=0.001)
    steps = wind[1:] - 0.999 * wind[:-1]
    np.testing.assert_allclose(steps.std(axis=0), 0.01, rtol=0.03)
    np.testing.assert_allclose(steps.mean(axis=0), 0.0, atol=3e-4)


@pytest.mark.parametrize(
    "arguments",
    [["--json", "nowhere/f.json"], ["--figure", "f.txt"]],
)
def test_bad_arguments_are_one_sentence_before_the_work(arguments, capsys):
    with pytest.raises(InputError):
        filter_parameters.main(["--headless", *arguments])
    assert capsys.readouterr().out == ""
