"""What an effect of the library does to a log is no fault of the log."""

import dataclasses

import numpy as np
import pytest

from glider.campaign.checks.inspection import inspect
from glider.physics.effects import KINDS
from glider.physics.model import GliderModel
from glider.simulation.campaigns import CampaignPlan

STRONG = [
    ("wind", {"x": -3.0}),
    ("wind", {"x": 3.0}),
    ("wind", {"x": -2.0, "z": 1.0}),
    ("wind", {"z": -1.5}),
    ("frame_tilt", {"angle": -0.5}),
    ("frame_tilt", {"angle": 0.5}),
    ("position_scale", {"x": 0.1, "z": 0.1}),
    ("position_scale", {"x": -0.1}),
    ("pitch_offset", {"angle": -0.7}),
    ("pitch_offset", {"angle": 0.7}),
    ("thrust", {"force": 0.5}),
    ("thrust", {"force": -0.3}),
    ("mass", {"change": -0.5}),
    ("mass", {"change": 3.0}),
    ("wing_incidence", {"angle": 0.5}),
    ("elevator_trim", {"angle": 0.6}),
    ("servo_lag", {"time_constant": 0.3}),
    ("command_delay", {"delay": 0.3}),
    ("pose_latency", {"latency": 0.2}),
    ("marker_offset", {"ahead": 0.3, "above": 0.2}),
    ("marker_offset", {"ahead": -0.5}),
    ("profile_drag", {"cd0": 1.0}),
    ("added_mass", {"mass": 0.2}),
    ("attached_lift", {"slope": 4.0}),
    ("dynamic_stall", {"strength": 2.0}),
    ("ground_effect", {"strength": 0.04}),
    ("angle_sign", {"pitch": -1.0}),
    ("angle_sign", {"pitch": -1.0, "elevator": -1.0, "command": -1.0}),
    ("angle_sign", {"command": -1.0}),
]


def fly(effects, seed=1, flights=5):
    model = GliderModel(effects=effects)
    rng = np.random.default_rng(seed)
    return CampaignPlan(flights=flights).simulate(model, rng)


@pytest.mark.parametrize(("kind", "values"), STRONG)
def test_a_strong_effect_passes(kind, values):
    found = inspect(fly((KINDS[kind](**values),)))
    assert found.excluded == ()
    assert found.warnings == ()


@pytest.mark.nightly
def test_clean_noise_costs_less_than_a_row_in_ten_thousand():
    """The threshold of six deviations: 1e-8 of rows; here none of 20,000."""
    campaign = fly((), flights=6)
    rng = np.random.default_rng(5)
    rows = faulty = 0
    for _ in range(32):
        flights = tuple(
            dataclasses.replace(
                f, pose=f.pose + rng.normal(size=f.pose.shape) * [0.002, 0.002, 0.01]
            )
            for f in campaign.flights
        )
        found = inspect(dataclasses.replace(campaign, flights=flights))
        rows += sum(len(m.pose) for m in found.masks.values())
        faulty += sum(int(m.pose.sum()) for m in found.masks.values())
    assert rows > 19_000
    assert faulty == 0


def test_logs_without_noise_pass():
    """Kinks of the elevator's rate are then all that fourth differences see."""
    plan = CampaignPlan(flights=8)
    quiet = dataclasses.replace(plan.capture, position=0.0, pitch=0.0, elevator=0.0)
    model = GliderModel()
    campaign = dataclasses.replace(plan, capture=quiet).simulate(
        model, np.random.default_rng(2)
    )
    found = inspect(campaign)
    assert found.excluded == ()
    (warning,) = found.warnings
    assert "simulated without noise" in warning
