"""A logged flight flown again by models."""

import dataclasses

import numpy as np
import pytest

from glider.campaign.reader import load_campaign
from glider.campaign.turning import Signs, turn_campaign
from glider.errors import InputError
from glider.physics.effects import KINDS
from glider.physics.effects.free_functions import FreeFunction
from glider.physics.model import GliderModel
from glider.physics.parameters import GliderParameters
from glider.simulation.refly import (
    Motion,
    find_flight,
    nominal_model,
    nominal_parameters,
    position_errors,
    refly,
)
from glider.sysid.pipeline import close_the_loop
from glider.sysid.replay.record import measure_noise, prepare
from tests.helpers.campaigns import campaign_path

CORRECTED = GliderModel(
    effects=(KINDS["attached_lift"](slope=3.0, stall_angle=0.26, fade=0.05),)
)


@pytest.fixture(scope="module")
def campaign():
    names = [f"flight_{i:03d}" for i in range(5)]
    return load_campaign(campaign_path("attached_lift"), flights=names)


@pytest.fixture(scope="module")
def flight(campaign):
    return find_flight(campaign, "flight_003")


@pytest.fixture(scope="module")
def motions(campaign, flight):
    models = {"nominal": nominal_model(campaign), "corrected": CORRECTED}
    return refly(campaign, flight, models)


def test_the_measured_motion_is_the_log(motions, flight):
    measured = motions["measured"]
    assert np.array_equal(measured.poses[:, :3], flight.pose)
    assert np.array_equal(measured.poses[:, 3], flight.elevator)
    assert np.array_equal(measured.time, flight.time - flight.time[0])


def test_the_right_model_flies_as_the_glider_did(motions):
    measured = motions["measured"]
    nominal, _ = position_errors(motions)["nominal"]
    corrected, end = position_errors(motions)["corrected"]
    assert nominal > 0.1
    assert corrected < 0.005 and end < 0.01
    elevators = measured.poses[:, 3], motions["corrected"].poses[:, 3]
    assert np.max(np.abs(np.subtract(*elevators))) < 0.03


def force_error(measured, acceleration):
    """Returns the RMS distance of the plates' forces from m (a - g) [N]."""
    wing, elevator = measured.forces.T
    pitch, angle = measured.poses[:, 2], measured.poses[:, 3]
    x = wing * np.sin(pitch) + elevator * np.sin(pitch + angle)
    z = wing * np.cos(pitch) + elevator * np.cos(pitch + angle)
    needed = 0.08 * (acceleration + np.array([0.0, 9.81]))
    return np.sqrt(np.mean((x - needed[:, 0]) ** 2 + (z - needed[:, 1]) ** 2))


def test_the_last_models_forces_explain_the_measured_accelerations(
    motions, campaign, flight
):
    (record,) = prepare((flight,), campaign, measure_noise(campaign))
    acceleration = record.acceleration[:, :2]
    error = force_error(motions["measured"], acceleration)
    nominal = refly(campaign, flight, {"nominal": nominal_model(campaign)})
    assert error < 0.1  # The glider weighs 0.78 N.
    assert force_error(nominal["measured"], acceleration) > 3.0 * error


def test_a_model_flies_with_the_limits_of_its_own_servo(campaign, flight):
    low, high = campaign.elevator_limits
    told = dataclasses.replace(campaign, elevator_limits=(low, 0.2 * high))
    motions = refly(told, flight, {"nominal": nominal_model(told), "own": CORRECTED})
    assert motions["nominal"].poses[:, 3].max() < 0.21 * high
    assert motions["own"].poses[:, 3].max() > 0.5 * high


def test_the_free_functions_of_a_model_are_flown_too(campaign, flight):
    wind = GliderModel(effects=(KINDS["wind"](x=-1.0, z=0.3),))
    weights = {"wind_x": [-1.0], "wind_z": [0.3]}
    pushed = GliderModel(free_functions=[FreeFunction(constant=True, weights=weights)])
    flown = refly(campaign, flight, {"wind": wind, "free": pushed})
    assert np.allclose(flown["wind"].poses, flown["free"].poses, atol=1e-8)


def test_a_held_out_flight_is_flown_as_closing_the_loop_did(campaign):
    result = close_the_loop(campaign, effects=["attached_lift"])
    held_out = result.held_out[0]
    nominal = nominal_model(campaign)
    models = {"nominal": nominal, "corrected": result.model}
    flown = refly(campaign, find_flight(campaign, held_out.name), models)
    for name, tolerance in (("nominal", 5e-3), ("corrected", 1e-3)):
        # Held-out flights, too, are asked here how much differs between flights.
        error = flown[name].poses[:, :3] - held_out.flown[name]
        assert np.abs(error).max() < tolerance
    nominal = held_out.flown["nominal"] - held_out.measured
    assert np.abs(nominal).max() > 0.1


def test_a_log_with_a_wrong_sign_is_seen_as_it_was_flown(motions, campaign):
    turned = turn_campaign(campaign, Signs(pitch=-1, elevator=-1))
    effect = KINDS["angle_sign"](pitch=-1.0, elevator=-1.0, command=1.0)
    model = dataclasses.replace(CORRECTED, effects=(effect, *CORRECTED.effects))
    models = {"nominal": nominal_model(campaign), "corrected": model}
    seen = refly(turned, find_flight(turned, "flight_003"), models)
    for name in ("measured", "corrected"):
        assert np.allclose(seen[name].poses, motions[name].poses)
    # The nominal model met the log as it was written, and could not fly that.
    poses, others = seen["nominal"].poses, motions["nominal"].poses
    rows = min(len(poses), len(others))
    assert np.abs(poses[:rows, 2] - others[:rows, 2]).max() > 0.5


def test_a_model_that_blows_up_is_shown_until_then(campaign, flight):
    wild = GliderModel(parameters=GliderParameters(mass=1e-5, pitch_inertia=1e-7))
    flown = refly(campaign, flight, {"wild": wild})["wild"]
    assert 1 <= len(flown.time) == len(flown.poses) < len(flight.time)
    assert np.all(np.isfinite(flown.poses))
    assert np.max(np.abs(flown.poses)) < 100.0


def test_of_an_unknown_vehicle_there_is_no_nominal_model_and_there_are_no_forces(
    campaign, flight
):
    unknown = dataclasses.replace(campaign, vehicle={"hinge_offset": 0.2})
    assert nominal_model(unknown) is None
    assert nominal_parameters(unknown).hinge_offset == 0.2
    assert refly(unknown, flight, {"corrected": CORRECTED})["measured"].forces is None


def test_flights_are_found_with_and_without_their_ending(campaign, flight):
    assert find_flight(campaign, "flight_003.csv") is flight
    with pytest.raises(
        InputError, match=r"no flight 'x'; expected one of flight_000, fl"
    ):
        find_flight(campaign, "x")


def test_the_position_error_counts_the_rows_that_were_flown():
    poses = np.zeros((4, 4))
    measured = Motion(time=np.arange(4.0), poses=poses)
    off = poses[:3].copy()
    off[:, 0], off[2, 1] = 3.0, 4.0
    flown = Motion(time=np.arange(3.0), poses=off)
    rms, end = position_errors({"measured": measured, "model": flown})["model"]
    assert rms == pytest.approx(np.sqrt((9 + 9 + 25) / 3))
    assert end == pytest.approx(5.0)
