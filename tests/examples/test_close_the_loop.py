"""Closing the loop on a campaign, output in a few lines."""

import dataclasses

import pytest

from examples import close_the_loop
from glider.campaign.reader import load_campaign
from glider.campaign.writer import save_campaign
from glider.physics.model import GliderModel
from tests.helpers.campaigns import campaign_path
from tests.helpers.examples import run_main


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A few flights of the sample campaign."""
    campaign = load_campaign(campaign_path("attached_lift"))
    few = dataclasses.replace(campaign, flights=campaign.flights[:8])
    path = tmp_path_factory.mktemp("few") / "attached_lift"
    save_campaign(path, few)
    return path


@pytest.fixture(scope="module")
def found(folder):
    return close_the_loop.run(folder)


def test_the_effect_is_found_and_worth_something(found):
    assert found.verdict == "effect_found"
    assert [effect.kind for effect in found.effects] == ["attached_lift"]
    errors = {name: error.position_rms_m for name, error in found.errors.items()}
    assert errors["corrected"] < 0.05 * errors["nominal"]


def test_the_result_is_reported(found, folder, tmp_path):
    model = tmp_path / "model.yaml"
    arguments = (str(folder), f"--model={model}")
    output = run_main(close_the_loop, found, tmp_path, *arguments, writes=("--json",))
    assert output.figures == {"verdict": "effect_found", "effects": ["attached_lift"]}
    assert "attached_lift: effect_found" in output.words
    assert "slope = " in output.words
    assert output.asked.call_args.args[0] == folder
    assert GliderModel.load(model) == found.model
