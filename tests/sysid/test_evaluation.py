"""Innovations that are white are within the band; those that are not, outside."""

import numpy as np

from glider.sysid.evaluation import CHANNELS, correlations

FLIGHTS, ROWS, LAGS = 8, 120, 25
BAND = 1.96 / np.sqrt(FLIGHTS * ROWS)


def noise(seed=0):
    return list(np.random.default_rng(seed).normal(size=(FLIGHTS, ROWS, 3)))


def outside(values):
    return np.mean(np.abs(values) > BAND)


def test_white_noise_is_within_the_band_in_95_of_100():
    found = [correlations(noise(k), noise(k), LAGS) for k in range(20)]
    inside = [f[c][1:] for f in found for c in CHANNELS]
    assert 0.02 < outside(inside) < 0.08
    np.testing.assert_allclose([f[c][0] for f in found for c in CHANNELS], 1.0)


def test_noise_is_not_like_an_elevator_of_whatever_color():
    moves = [np.sin(np.arange(ROWS) / 9.0 + k)[:, None] for k in range(FLIGHTS)]
    found = [correlations(noise(k), moves, LAGS) for k in range(40)]
    assert outside([f[c] for f in found for c in CHANNELS]) < 0.08


def test_what_lasts_is_outside():
    lasting = []
    for flight in noise():
        flight[1:] += 0.6 * flight[:-1]
        lasting.append(flight)
    found = correlations(lasting, lasting, LAGS)
    assert all(found[c][1] > 5.0 * BAND for c in CHANNELS)


def test_a_late_answer_to_the_elevator_stands_at_its_lag():
    moves = [flight[:, :1] for flight in noise(1)]
    left = noise(2)
    for flight, moved in zip(left, moves, strict=True):
        flight[4:, 2] += 0.5 * moved[:-4, 0]
    found = correlations(left, moves, LAGS)
    assert np.argmax(found["pitch"]) == 4
    assert outside(found["x"]) < 0.2
