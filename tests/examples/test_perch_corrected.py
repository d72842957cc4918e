"""Closing the loop on an effect that the model lacks: perches before and after."""

from types import SimpleNamespace

import numpy as np
import pytest

from examples import perch_corrected
from examples.perch_corrected import Correction, Rehearsal, name_effects, rehearse
from glider.physics.effects import PITCH_DAMPING, WIND
from glider.physics.model import GliderModel
from glider.planning.problem import PerchingProblem
from glider.simulation.flown_flights import Perches
from tests.helpers.examples import run_main
from tests.helpers.physics import FREE

LAUNCHES = 6


@pytest.fixture(scope="module")
def flown():
    return perch_corrected.fly(GliderModel.load("head_wind"), launches=LAUNCHES, seed=3)


@pytest.fixture(scope="module")
def output(flown, tmp_path_factory):
    folder = tmp_path_factory.mktemp("corrected")
    asked = f"--launches={LAUNCHES}", "--seed=3"
    return run_main(perch_corrected, flown, folder, *asked)


@pytest.mark.slow
def test_the_corrected_model_perches_where_the_nominal_one_misses(flown):
    assert [effect.kind for effect in flown.found.effects] == ["wind"]
    assert flown.before.flights.perched <= 2
    assert flown.after.flights.perched == len(flown.after.flights) == LAUNCHES
    assert max(flown.after.flights.misses) < 0.05 < min(flown.before.flights.misses)


@pytest.mark.nightly
def test_of_a_hundred_launches_the_wind_is_found_and_nothing_else():
    """As README.md and the tables of the docs run it."""
    flown = perch_corrected.fly(GliderModel.load("head_wind"), launches=100, seed=0)
    assert flown.found.verdict == "effect_found"
    assert [effect.kind for effect in flown.found.effects] == ["wind"]


@pytest.mark.slow
def test_the_result_is_reported(output, flown):
    figures = output.figures
    assert figures["effect_true"] == "wind"
    assert figures["effect_found"] == ["wind"]
    for name, rehearsal in (("before", flown.before), ("after", flown.after)):
        assert figures[name] == rehearsal.flights.key_figures()
    assert (figures["launches"], figures["seed"]) == (LAUNCHES, 3)
    assert "planned corrected: 6 of 6 launches perch" in output.words
    truth, *asked = output.asked.call_args.args[:3]
    assert asked == [LAUNCHES, 3]
    assert truth == GliderModel.load("head_wind")


@pytest.mark.slow
def test_it_is_drawn_and_animated(output):
    assert output.size == (1425, 1050)
    assert output.ink > 0.02
    assert ">Before and after: head_wind<" in output.page
    for words in ("planned corrected", "planned nominal", "plan of the nominal model"):
        assert f">{words}<" in output.page


def test_a_rehearsal_is_repeatable_and_its_logs_are_of_the_flights():
    problem, nominal = PerchingProblem(wire=[-0.2, -0.1]), GliderModel()
    starts = problem.draw_launches(3, np.random.default_rng(0))
    first, again = (
        rehearse(nominal, nominal, problem, starts, np.random.default_rng(1))
        for _ in range(2)
    )
    assert first.flights.misses == again.flights.misses
    assert first.flights.perched == 3
    assert [f.name for f in first.flights.campaign.flights] == [
        f"flight_{k:03d}.csv" for k in range(3)
    ]
    for flight, log in zip(first.flights, first.flights.campaign.flights, strict=True):
        path = np.array(
            [np.interp(log.time, flight.times, column) for column in flight.states.T]
        )
        # Between the integrator's steps a straight line is a millimeter off.
        np.testing.assert_allclose(log.pose[:, :2], path[:2].T, atol=0.004)
        assert not np.allclose(log.pose[:, 2], path[2], atol=1e-4)  # Noise.


@pytest.mark.parametrize(
    ("truth", "expected"),
    [
        (GliderModel(), "nothing"),
        (GliderModel(effects=(WIND(x=-1.0), PITCH_DAMPING())), "wind + pitch_damping"),
        (
            GliderModel(effects=(WIND(x=-1.0),), free_functions=FREE),
            "wind + rbf_residual",
        ),
    ],
)
def test_what_is_true_is_reported(tmp_path, truth, expected):
    """Of files with several effects or none."""
    truth.save(tmp_path / "truth.yaml")
    assert name_effects(GliderModel.load(str(tmp_path / "truth.yaml"))) == expected


def test_a_correction_tells_its_truth_and_its_effects():
    """Nothing is flown here."""
    flown = Rehearsal(plan=None, flights=Perches([]))
    found = SimpleNamespace(effects=(SimpleNamespace(kind="wind"),))
    truth = GliderModel.load("head_wind")
    correction = Correction(truth=truth, before=flown, found=found, after=flown)
    none = Perches([]).key_figures()
    assert none["perched"] == 0
    assert correction.key_figures() == {
        "effect_true": "wind",
        "effect_found": ["wind"],
        "before": none,
        "after": none,
        "launches": 0,
    }
