"""Each way of logging angles with the other sign is recognised from few flights."""

import dataclasses

import numpy as np
import pytest

from glider.campaign.turning import Signs, turn_campaign
from glider.physics.effects import KINDS
from glider.sysid.replay.vehicle import make_vehicle
from glider.sysid.search.signs import find_signs
from tests.helpers.tasks import fly

FAULTS = [
    (pitch, elevator, command)
    for pitch in (1, -1)
    for elevator in (1, -1)
    for command in (1, -1)
]


@pytest.fixture(scope="module")
def campaign():
    """Drag is missing from the model, too: it is no wrong sign."""
    drag = KINDS["profile_drag"](cd0=0.1)
    return fly(drag, flights=2, duration=0.6)


@pytest.mark.parametrize("fault", FAULTS, ids=str)
def test_wrong_signs_are_found_and_right_ones_left(campaign, fault):
    pitch, elevator, command = fault
    wrong = Signs(pitch=pitch, elevator=elevator, command=command)
    log = turn_campaign(campaign, wrong)
    found = find_signs(log, log.flights, {}, make_vehicle(log))
    assert (found.pitch, found.elevator, found.command) == fault
    assert found.are_right == wrong.are_right
    assert (found.evidence > 0.0) == (not wrong.are_right)
    assert 0.0 <= found.share < 1.0


def test_without_a_servo_only_the_pitch_can_be_wrong(monkeypatch):
    monkeypatch.setattr(
        "glider.simulation.campaigns.random_commands", lambda count, *_: np.zeros(count)
    )
    flown = fly(flights=2, duration=0.6)
    flights = tuple(
        dataclasses.replace(f, elevator=None, command=None) for f in flown.flights
    )
    log = dataclasses.replace(flown, flights=flights, elevator="fixed")
    vehicle = make_vehicle(log)
    assert find_signs(log, log.flights, {}, vehicle).are_right
    turned = turn_campaign(log, Signs(pitch=-1))
    found = find_signs(turned, turned.flights, {}, vehicle)
    assert (found.pitch, found.elevator, found.command) == (-1, 1, 1)
