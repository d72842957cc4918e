"""Gliders that roll, where their logs do not say so."""

import dataclasses

import numpy as np
import pytest

from benchmarks.bench_roll import draw
from benchmarks.rolling_flight import FIN_ARM, YAW_INERTIA, Rolls, fly_rolling
from glider.campaign.logs import split_flights
from glider.physics.parameters import GliderParameters
from glider.progress import silent
from glider.sysid.pipeline import close_the_loop
from glider.sysid.roll import RollSearch, attitudes_of
from glider.sysid.search.moves import Search
from glider.sysid.search.tracing import trace
from tests.helpers.known_truth import task_of
from tests.helpers.lifelike import draw_commands, draw_starts
from tests.helpers.lifelike_flight import Glider, elevator_paths, fly, shown_pose


def some_flights(count=3, steps=600):
    rng = np.random.default_rng(0)
    glider = Glider()
    commands = draw_commands(rng, count)
    path = elevator_paths(
        glider.servo, commands, 0.02, 2 * steps, glider.elevator_limits
    )
    return glider, draw_starts(rng, count), path


def test_what_does_not_roll_flies_in_its_plane():
    glider, start, path = some_flights()
    level = Rolls(first=np.zeros(3), last=np.zeros(3), fin=0.01)
    pose, aside = fly_rolling(glider, level, start, path)
    assert not aside.any()
    planar = shown_pose(glider, fly(glider, start, path))
    np.testing.assert_allclose(pose, planar, atol=1e-12)


def unlogged(campaign):
    """The campaign without roll and yaw."""
    flights = [dataclasses.replace(own, attitude=None) for own in campaign.flights]
    return dataclasses.replace(campaign, flights=tuple(flights))


@pytest.mark.parametrize("seed", [2, 4, 6])
def test_the_motion_across_the_plane_follows_from_the_one_in_it(seed):
    """Roll, yaw and y of the simulator in three dimensions, from x, z and pitch."""
    campaign, rolls = draw(0.2, seed, "none", logged=True)
    task, _ = task_of(unlogged(campaign))
    banks = np.column_stack([rolls.first, rolls.last])
    fin = 1.204 * rolls.fin * FIN_ARM / YAW_INERTIA
    vehicle = vars(GliderParameters()) | campaign.vehicle
    found = attitudes_of(task.records, banks, fin, vehicle)
    assert np.ptp(rolls.last) > 0.2
    for flight, own in zip(campaign.flights, found, strict=True):
        assert np.max(np.abs(own - flight.attitude)) < 0.03


def found_in(campaign, kinds=()):
    """Searches some effects, and a roll, in the flights to fit; and their rows."""
    fitted, _ = split_flights(campaign, 0.2, 0)
    everything, noise = task_of(campaign)
    names = {flight.name for flight in fitted}
    task = everything.on([r for r in everything.records if r.name in names])
    search = Search(task.offering(kinds), silent)
    traced = trace(search, noise)
    rolls = RollSearch(search=search, campaign=campaign, noise=noise, masks={})
    rows = [int(record.name[7:10]) for record in task.records]
    return rolls.find(traced), rows


@pytest.mark.parametrize(
    "size, seed", [(0.06, 8), pytest.param(0.2, 2, marks=pytest.mark.nightly)]
)
def test_the_bank_is_found(size, seed):
    campaign, rolls = draw(size, seed, "none")
    found, rows = found_in(campaign)
    true = np.sqrt(np.mean(rolls.last[rows] ** 2))
    assert found.bank == pytest.approx(true, rel=0.25)


@pytest.mark.parametrize("seed", [2, 3])
def test_nothing_rolls_where_nothing_does(seed):
    """Also in moving air."""
    assert found_in(draw(0.0, seed, "none")[0])[0].bank is None


def test_an_effect_acts_beside_the_roll():
    """What an error of the camera imitates is the roll's; the drag stays."""
    campaign, _ = draw(0.2, 0, "profile_drag")
    found, _ = found_in(campaign, ("profile_drag", "frame_tilt", "position_scale"))
    assert found.model.kinds == ("profile_drag",)
    assert found.evidence.keys() == found.names.keys() == {"profile_drag"}
    assert found.bank is not None


@pytest.mark.nightly
def test_a_glider_that_rolls_has_no_effect():
    """The verdict asks for its roll, and names nothing."""
    result = close_the_loop(draw(0.2, 2, "none")[0])
    assert result.verdict == "unexplained"
    assert not [own for own in result.effects if np.isfinite(own.evidence)]
    assert result.reason.startswith("Flights lose lift as a banked wing does, about 0.")
    assert "log roll and yaw" in result.reason
