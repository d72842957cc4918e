"""Smoothing finds the noise and does not bend what it smooths."""

import numpy as np
import pytest

from glider.campaign.smoothing import estimate_noise, smoothing_maps


def wave(t):
    return np.sin(4.0 * t), 4.0 * np.cos(4.0 * t), -16.0 * np.sin(4.0 * t)


@pytest.mark.parametrize("noise", [1e-4, 1e-3, 1e-2])
def test_noise_is_found_within_its_standard_error(noise):
    rng = np.random.default_rng(1)
    times = [np.arange(100) / 120.0 for _ in range(20)]
    values = [(wave(t)[0] + noise * rng.normal(size=100))[:, None] for t in times]
    (found,) = estimate_noise(times, values)
    standard_error = noise / np.sqrt(2.0 * 20 * 100)
    assert abs(found.noise - noise) < 4.0 * standard_error


def test_channels_are_told_apart():
    rng = np.random.default_rng(2)
    t = np.arange(200) / 120.0
    value = wave(t)[0][:, None] + rng.normal(size=(200, 2)) * [1e-3, 1e-2]
    first, second = estimate_noise([t], [value])
    assert second.noise / first.noise == pytest.approx(10.0, rel=0.3)


@pytest.mark.parametrize("gap", [False, True])
def test_derivatives_are_right_on_irregular_times(gap):
    rng = np.random.default_rng(3)
    t = np.sort(rng.uniform(0.0, 1.0, 150))
    if gap:
        t = t[(t < 0.45) | (t > 0.5)]
    query = np.linspace(0.1, 0.9, 40)
    maps = smoothing_maps(t, query, 1e12)
    value, rate, acceleration = (m @ wave(t)[0] for m in maps)
    truth = wave(query)
    np.testing.assert_allclose(value, truth[0], atol=1e-4)
    np.testing.assert_allclose(rate, truth[1], atol=1e-2)
    np.testing.assert_allclose(acceleration, truth[2], atol=0.5)


def test_a_parabola_passes_unchanged():
    """The free parabola is not penalised, whatever the smoothness."""
    t = np.linspace(3.0, 4.0, 50)
    y = 2.0 - 3.0 * t + 4.0 * t**2
    for ratio in (1e-3, 1.0, 1e6):
        value, rate, acceleration = (m @ y for m in smoothing_maps(t, t, ratio))
        np.testing.assert_allclose(value, y, rtol=1e-6)
        np.testing.assert_allclose(rate, 8.0 * t - 3.0, rtol=1e-5)
        np.testing.assert_allclose(acceleration, 8.0, rtol=1e-4)
