"""A glider flies under the plan and the feedback of a model that lacks something."""

from types import SimpleNamespace

import numpy as np
import pytest

from diagrams.program import load_truth
from diagrams.studies.rehearsal import Correction, Rehearsal, name_effects, rehearse
from glider.errors import InputError
from glider.paths import models_path
from glider.physics.effects import PITCH_DAMPING, WIND
from glider.physics.model import GliderModel, save_model
from glider.planning.problem import PerchingProblem
from glider.simulation.flown_flights import Perches
from glider.simulation.monte_carlo import LaunchSpread, draw_launches
from tests.helpers.physics import FIELD


def test_a_rehearsal_is_repeatable_and_its_logs_are_of_the_flights():
    problem, nominal = PerchingProblem(wire=[-0.2, -0.1]), GliderModel()
    starts = draw_launches(problem, LaunchSpread(), 3, np.random.default_rng(0))
    first, again = (
        rehearse(nominal, nominal, problem, starts, np.random.default_rng(1))
        for _ in range(2)
    )
    assert first.flights.misses == again.flights.misses
    assert first.flights.perched == 3
    assert [f.name for f in first.campaign.flights] == [
        f"flight_{k:03d}.csv" for k in range(3)
    ]
    for flight, log in zip(first.flights, first.campaign.flights, strict=True):
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
        (GliderModel(effects=(WIND(x=-1.0),), field=FIELD), "wind + rbf_residual"),
    ],
)
def test_what_is_true_is_told_as_it_is(tmp_path, truth, expected):
    """Of files with several effects or none."""
    save_model(tmp_path / "truth.yaml", truth)
    assert name_effects(load_truth(str(tmp_path / "truth.yaml"))) == expected


def test_a_correction_tells_its_truth_and_its_effects():
    """Nothing is flown here."""
    flown = Rehearsal(plan=None, flights=Perches([]), campaign=None)
    found = SimpleNamespace(effects=(SimpleNamespace(kind="wind"),))
    truth = load_truth("head_wind")
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


def test_every_shipped_truth_is_a_model_with_one_effect_or_a_field():
    names = [path.stem for path in models_path("truths").glob("*.yaml")]
    assert len(names) >= 6
    for name in names:
        truth = load_truth(name)
        assert (len(truth.effects) == 1) != (truth.field is not None)


def test_an_unknown_truth_is_refused_with_the_known_ones():
    with pytest.raises(InputError, match=r"'tail_wind'.*head_wind"):
        load_truth("tail_wind")
