"""Vehicles known, partly known and unknown, with and without a servo."""

import dataclasses

import numpy as np
import pytest

from glider.campaign.checks.inspection import inspect
from glider.campaign.logs import CLOCK_STD
from glider.campaign.motion_capture import MotionCapture
from glider.errors import InputError
from glider.physics.effects import KINDS
from glider.physics.model import GliderModel
from glider.simulation.campaigns import CampaignPlan
from glider.sysid.pipeline import close_the_loop
from glider.sysid.replay.vehicle import _DRIFT_SPREAD, make_vehicle

DRAG = GliderModel(effects=(KINDS["profile_drag"](cd0=0.06),))


NIGHTLY = pytest.mark.nightly  # The other case of each pair runs with make test.


@pytest.fixture(scope="module")
def campaign():
    plan = CampaignPlan(flights=6)
    return plan.simulate(DRAG, np.random.default_rng(5))


def without(campaign, *names):
    known = {k: v for k, v in campaign.vehicle.items() if k not in names}
    return dataclasses.replace(campaign, vehicle=known)


def without_servo(campaign, elevator):
    """The same flights with the elevator locked at zero and not logged."""
    flights = tuple(
        dataclasses.replace(f, elevator=None, command=None) for f in campaign.flights
    )
    return dataclasses.replace(campaign, flights=flights, elevator=elevator)


UNKNOWN = ("mass", "pitch_inertia", "wing_area", "elevator_area", "wing_offset")


def test_a_full_nominal_model_leaves_the_clocks_alone_to_guess(campaign):
    vehicle = make_vehicle(campaign)
    assert vehicle.is_known and vehicle.nuisance == vehicle.of_log
    assert set(vehicle.of_log.values()) == {CLOCK_STD, _DRIFT_SPREAD}
    assert not vehicle.notes


def test_without_mass_and_areas_all_is_per_kilogram(campaign):
    vehicle = make_vehicle(without(campaign, *UNKNOWN))
    assert not vehicle.is_known
    assert any("per kg" in note for note in vehicle.notes)
    assert not {"mass", "inertia", "elevator_area"} & set(vehicle.kinds)


def test_no_servo_no_servo_effects(campaign):
    vehicle = make_vehicle(without_servo(campaign, "fixed_per_flight"))
    assert not {"servo_lag", "command_delay", "elevator_trim"} & set(vehicle.kinds)
    assert vehicle.per_flight_trims
    assert not vehicle.of_log  # Nor clocks of one.


def test_an_elevator_that_never_moves_shows_no_effect_of_it_and_is_warned_of(campaign):
    still = tuple(
        dataclasses.replace(f, elevator=0.0 * f.elevator, command=0.0 * f.command)
        for f in campaign.flights
    )
    found = inspect(dataclasses.replace(campaign, flights=still))
    [warning] = found.warnings
    assert warning.startswith("The logged 'elevator' does not move in any flight")
    vehicle = make_vehicle(found.campaign)
    assert not {"servo_lag", "elevator_scale", "elevator_trim"} & set(vehicle.kinds)
    assert not vehicle.of_log


@pytest.mark.nightly
@pytest.mark.parametrize("missing", [("mass", "pitch_inertia"), UNKNOWN], ids=str)
def test_drag_is_found_whatever_is_known(campaign, missing):
    result = close_the_loop(without(campaign, *missing))
    assert [e.kind for e in result.effects] == ["profile_drag"]
    found = result.effects[0].coefficients["cd0"]
    assert found.value == pytest.approx(0.06, rel=0.1)
    assert result.errors["nominal"] is None
    corrected, plate = result.errors["corrected"], result.errors["refitted"]
    assert corrected.position_rms_m < 0.25 * plate.position_rms_m


@pytest.mark.slow
@pytest.mark.parametrize(
    ("elevator", "missing"),
    [pytest.param("fixed", (), marks=NIGHTLY), ("fixed_per_flight", UNKNOWN)],
    ids=["known", "unknown"],
)
def test_drag_is_found_without_a_servo(monkeypatch, elevator, missing):
    monkeypatch.setattr(
        "glider.simulation.campaigns.random_commands", lambda count, *_: np.zeros(count)
    )
    plan = CampaignPlan(flights=6)
    flown = plan.simulate(DRAG, np.random.default_rng(6))
    result = close_the_loop(without(without_servo(flown, elevator), *missing))
    assert [e.kind for e in result.effects] == ["profile_drag"]
    found = result.effects[0].coefficients["cd0"]
    assert found.value == pytest.approx(0.06, rel=0.1)


@pytest.mark.nightly
@pytest.mark.slow
def test_gaps_and_irregular_times_are_handled(campaign):
    rng = np.random.default_rng(0)

    def thin(flight):
        rows = np.sort(rng.choice(len(flight.time), 80, replace=False))
        return dataclasses.replace(
            flight,
            time=flight.time[rows] + 17.3,
            pose=flight.pose[rows],
            elevator=flight.elevator[rows],
            command=flight.command[rows],
        )

    thinned = dataclasses.replace(
        campaign, flights=tuple(thin(f) for f in campaign.flights)
    )
    result = close_the_loop(thinned)
    assert [e.kind for e in result.effects] == ["profile_drag"]
    found = result.effects[0].coefficients["cd0"]
    assert found.value == pytest.approx(0.06, rel=0.15)


@pytest.mark.nightly
def test_three_flights_are_enough_for_a_strong_effect(campaign):
    few = dataclasses.replace(campaign, flights=campaign.flights[:3])
    result = close_the_loop(few)
    assert [e.kind for e in result.effects] == ["profile_drag"]


@pytest.mark.nightly
def test_a_log_may_begin_with_the_elevator_anywhere_and_hold_a_computed_one():
    """Cut off its start: the elevator is where it was then, here without noise."""
    plan = CampaignPlan(flights=6, capture=MotionCapture(elevator=0.0))
    flown = plan.simulate(GliderModel(), np.random.default_rng(5))

    def late(flight):
        return dataclasses.replace(
            flight,
            time=flight.time[35:],
            pose=flight.pose[35:],
            elevator=flight.elevator[35:],
            command=flight.command[35:],
        )

    flights = tuple(late(f) for f in flown.flights)
    result = close_the_loop(dataclasses.replace(flown, flights=flights))
    assert result.verdict == "no_effect"
    assert result.air.std_m_s < 0.02


@pytest.mark.nightly
@pytest.mark.parametrize(
    "elevator", [pytest.param("fixed", marks=NIGHTLY), "fixed_per_flight"]
)
def test_an_elevator_that_stands_off_zero_is_no_effect(monkeypatch, elevator):
    monkeypatch.setattr(
        "glider.simulation.campaigns.random_commands", lambda count, *_: np.zeros(count)
    )
    truth = GliderModel(effects=(KINDS["elevator_trim"](angle=-0.2),))
    plan = CampaignPlan(flights=10)
    flown = plan.simulate(truth, np.random.default_rng(6))
    result = close_the_loop(without_servo(flown, elevator))
    assert result.verdict == "no_effect"
    assert result.air.std_m_s < 0.02
    if elevator == "fixed":  # One angle for all: it belongs to the model.
        (trim,) = result.model.effects
        assert trim.to_dict()["angle"] == pytest.approx(-0.2, abs=0.005)


@pytest.mark.nightly
def test_real_errors_are_never_called_no_effect():
    truth = GliderModel(effects=(KINDS["command_delay"](delay=0.03),))
    plan = CampaignPlan(flights=8)
    flown = plan.simulate(truth, np.random.default_rng(8))
    verdict = close_the_loop(flown, effects=["angle_sign"]).verdict
    assert verdict in ("unexplained", "not_trusted")


def test_effects_that_these_logs_cannot_show_are_refused(campaign):
    fixed = without_servo(campaign, "fixed")
    with pytest.raises(InputError, match="servo_lag"):
        close_the_loop(fixed, effects=["servo_lag"])


def test_a_servo_that_nobody_told_is_not_invented(campaign):
    fixed = dataclasses.replace(campaign, elevator_limits=None)
    assert make_vehicle(fixed).parameters.elevator_limits is None
    assert make_vehicle(campaign).parameters.elevator_limits is not None
    fixed = dataclasses.replace(campaign, elevator_rate_limit=None)
    assert make_vehicle(fixed).parameters.elevator_rate_limit is None
