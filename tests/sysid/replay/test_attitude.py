"""A rolled and yawed wing, in the plane of flight, against vectors in space."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from glider.campaign.checks.planarity import _normal, in_plane, planar_pitch
from glider.sysid.replay.record import measure_noise, prepare
from tests.helpers.tasks import fly

ATTITUDES = [
    (0.0, 0.0, 0.0),
    (0.2, 0.5, 0.0),
    (-0.3, 0.0, 0.4),
    (0.4, -0.6, 0.3),
    (-1.2, 0.3, -0.5),
]
"""Pitch, roll, yaw [rad]."""


def turned(pitch, roll, yaw):
    """Yaw about z, then pitch about y, then roll about x, each about the new axis."""
    return Rotation.from_euler("ZYX", [yaw, pitch, roll])


@pytest.mark.parametrize("attitude", ATTITUDES, ids=str)
def test_the_normal_is_the_bodys_third_axis(attitude):
    pitch, roll, yaw = (np.array([a]) for a in attitude)
    expected = turned(*attitude).apply([0.0, 0.0, 1.0])
    np.testing.assert_allclose(_normal(pitch, roll, yaw)[0], expected, atol=1e-12)


@pytest.mark.parametrize("attitude", ATTITUDES, ids=str)
def test_the_planar_force_is_the_shadow_of_the_force_in_space(attitude):
    """A plate's force is -½ ρ S |v| (v·n) n; here all but v·n and n is left out."""
    velocity = np.array([6.0, 0.8, -1.5])
    n = turned(*attitude).apply([0.0, 0.0, 1.0])
    force = (velocity @ n) * n
    pitch, roll, yaw = attitude
    bank, air = in_plane(
        np.full(2, pitch), np.tile([roll, yaw], (2, 1)), np.full(2, velocity[1])
    )
    assert bank.shape == (1,) and air.shape == (1, 2)
    theta = np.arctan2(n[0], n[2])
    planar = np.array([np.sin(theta), np.cos(theta)])
    through = velocity[[0, 2]] - air[0]
    np.testing.assert_allclose(
        bank[0] * (through @ planar) * planar, force[[0, 2]], atol=1e-12
    )


def test_a_level_wing_is_left_alone():
    pitch = np.linspace(-0.5, 0.5, 5)
    bank, air = in_plane(pitch, np.zeros((5, 2)), np.full(5, 0.7))
    np.testing.assert_allclose(bank, 1.0)
    np.testing.assert_allclose(air, 0.0, atol=1e-12)


def test_a_rolled_flight_has_the_pitch_of_its_shadow():
    flight = fly(flights=1, duration=0.3).flights[0]
    count = len(flight.time)
    attitude = np.column_stack([np.zeros(count), np.full(count, 0.4), np.zeros(count)])
    rolled = dataclasses.replace(flight, attitude=attitude)
    rows = np.arange(count)
    n = [turned(p, 0.4, 0.0).apply([0.0, 0.0, 1.0]) for p in flight.pose[:, 2]]
    expected = [np.arctan2(a[0], a[2]) for a in n]
    np.testing.assert_allclose(planar_pitch(rolled, rows), expected, atol=1e-12)


def test_records_carry_what_attitude_makes_of_a_flight():
    """A steady roll of 0.4 and a drift of 0.5 m/s."""
    campaign = fly(flights=2, duration=0.3)
    noise = measure_noise(campaign)
    plain, flight = prepare(campaign.flights, campaign, noise)[0], campaign.flights[0]
    count = len(flight.time)
    drift = 0.5 * flight.time
    attitude = np.column_stack([drift, np.full(count, 0.4), np.zeros(count)])
    rolled = dataclasses.replace(flight, attitude=attitude)
    (record,) = prepare((rolled,), campaign, noise)
    assert np.all(plain.bank == 1.0) and np.all(plain.side_wind == 0.0)
    middle = 0.5 * (plain.nodes[1:, 2] + plain.nodes[:-1, 2])
    n = np.array([turned(p, 0.4, 0.0).apply([0.0, 0.0, 1.0]) for p in middle])
    square = n[:, 0] ** 2 + n[:, 2] ** 2
    np.testing.assert_allclose(record.bank, square, atol=1e-3)
    wind = -0.5 * (n[:, 1] / square)[:, None] * n[:, [0, 2]]
    np.testing.assert_allclose(record.side_wind, wind, atol=1e-3)
