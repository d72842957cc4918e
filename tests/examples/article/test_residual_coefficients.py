"""Coefficients learned from a campaign: what they are worth on flights left out."""

import dataclasses

import numpy as np
import pytest

import residual_coefficients
from coefficients import basis_values
from diagrams.programs.program import run
from glider.campaign.reader import load_campaign
from glider.campaign.writer import save_campaign
from glider.physics.effects.free_functions import COEFFICIENTS
from glider.physics.model import GliderModel
from glider.simulation.refly import position_errors, refly
from glider.systems.plant import GliderPlant
from tests.examples.article.test_coefficients import coefficients_of
from tests.helpers.campaigns import campaign_path
from tests.helpers.examples import run_main


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A dozen flights of the sample campaign."""
    campaign = load_campaign(campaign_path("attached_lift"))
    few = dataclasses.replace(campaign, flights=campaign.flights[:12])
    path = tmp_path_factory.mktemp("few") / "attached_lift"
    save_campaign(path, few)
    return path


@pytest.fixture(scope="module")
def found(folder):
    return residual_coefficients.fly(load_campaign(folder))


@pytest.fixture(scope="module")
def output(found, folder):
    model = folder.parent / "glider.yaml"
    arguments = (str(folder), f"--model={model}")
    return run_main(residual_coefficients, found, folder.parent, *arguments)


def test_the_residual_pays_on_held_out_flights(found):
    models = found.study.models
    assert list(models) == ["plate", "26", "126"]
    plate, small, large = models.values()
    assert small.rms[0] < 0.9 * plate.rms[0]
    for learned in (small, large):
        assert learned.errors.equation.normal < 0.7 * plate.errors.equation.normal
        before, after = (m.errors.position_rms_m for m in (plate, learned))
        assert after < 0.6 * before


def test_rows_of_fitted_and_of_held_out_flights_are_counted(found, output, folder):
    campaign = load_campaign(folder)
    fitted, held_out = len(found.study.fitted.plate), len(found.study.held_out.plate)
    assert fitted + held_out == sum(len(f.time) - 6 for f in campaign.flights)
    assert fitted > held_out
    assert output.figures["rows"] == {"fitted": fitted, "held_out": held_out}


def test_flights_left_out_are_flown_again_by_each_model(found, folder):
    """Each of the four closer by one of the learned than by the plate."""
    assert list(found.motions) == ["measured", *found.models]
    measured, unseen = found.motions["measured"], found.study.unseen
    np.testing.assert_array_equal(measured.poses[:, :3], unseen[0].pose)
    campaign, closer = load_campaign(folder), 0
    for flight in unseen:
        motions = refly(campaign, flight, found.models)
        plate, *learned = (rms for rms, _ in position_errors(motions).values())
        closer += min(learned) < plate
    assert len(unseen) == 4 and closer == 4


def test_the_model_written_flies_with_its_residual(found, output, folder):
    model = GliderModel.load(folder.parent / "glider.yaml")
    assert model == found.models["26 weights"]
    [residual] = model.free_functions
    assert residual.kind == "rbf_residual"
    for name in COEFFICIENTS:
        assert len(residual.weights[name]) == 26
    state = np.array([0.0, 0.0, -0.3, 0.1, 6.0, -0.5, 0.0])
    alpha = np.array([np.arctan2(0.5, 6.0) + 0.3])
    variables = {"alpha": alpha, "elevator": state[3:4]}
    weights = np.array([residual.weights[name] for name in COEFFICIENTS]).T
    plate = GliderModel(parameters=model.parameters)
    with_field, without = (
        coefficients_of(GliderPlant(m), state) for m in (model, plate)
    )
    added = (basis_values(residual, variables) @ weights)[0]
    assert np.abs(added[0]) > 0.05
    np.testing.assert_allclose(with_field - without, added, atol=1e-6)


def test_the_result_is_reported(output, found):
    assert output.figures.keys() == {"campaign", "rows", "models"}
    assert output.figures["campaign"] == "attached_lift"
    for name, model in found.study.models.items():
        e = model.errors
        assert output.figures["models"][name] == {
            **dict(zip(COEFFICIENTS, model.rms.tolist(), strict=True)),
            "equation": {
                "tangential": e.equation.tangential,
                "normal": e.equation.normal,
                "pitch": e.equation.pitch,
            },
            "rollout": {
                "position_rms_m": e.position_rms_m,
                "position_end_m": e.rollout.position_end_m,
                "pitch_rms_rad": e.rollout.pitch_rms_rad,
            },
        }
    assert "126 weights: C_L 0." in output.words
    campaign, seed = output.asked.call_args.args
    assert (campaign.name, seed) == ("attached_lift", 0)


def test_it_is_drawn_and_animated(output, found):
    assert output.size == (1650, 990)
    assert output.ink > 0.05
    assert f">attached_lift, {found.study.unseen[0].name}<" in output.page
    for words in ("measured", "flat plate", "26 weights", "126 weights"):
        assert f">{words}<" in output.page


def test_a_vehicle_without_a_nominal_model_is_one_sentence(folder, tmp_path, capsys):
    campaign = load_campaign(folder)
    vehicle = {k: v for k, v in campaign.vehicle.items() if k != "pitch_inertia"}
    save_campaign(tmp_path / "c", dataclasses.replace(campaign, vehicle=vehicle))
    arguments = [str(tmp_path / "c"), "--headless"]
    assert run(lambda: residual_coefficients.main(arguments)) == 2
    error = capsys.readouterr().err
    assert "need all parameters" in error and "Traceback" not in error
