"""The test of what is left: silent on noise, loud on slow structure."""

import numpy as np
import pytest

from glider.sysid.fit.whiteness import spectrum_test


def fitted_noise(rng, flights=20, n=104, channels=4):
    """White noise less the slow part that a fitted launch state takes."""
    errors = []
    for _ in range(flights):
        error = rng.normal(size=(n, channels))
        basis, _ = np.linalg.qr(np.vander(np.linspace(-1, 1, n), 2))
        error[:, :3] -= basis @ (basis.T @ error[:, :3])
        error[:, 3] -= error[:, 3].mean()
        errors.append(error)
    return errors


@pytest.mark.parametrize("level", [0.5, 1.0, 3.0])
def test_white_noise_of_any_level_is_silent(level):
    rng = np.random.default_rng(0)
    scores = [
        spectrum_test([level * e for e in fitted_noise(rng)]).z for _ in range(60)
    ]
    assert abs(np.mean(scores)) < 0.4
    assert 0.7 < np.std(scores) < 1.3


def test_a_slow_error_of_half_the_noise_is_heard():
    rng = np.random.default_rng(1)
    errors = fitted_noise(rng)
    slow = 0.5 * np.sin(2 * np.pi * np.linspace(0, 1, 104))
    for error in errors:
        error[:, 0] += slow
    result = spectrum_test(errors)
    assert result.z > 4.0
    assert max(result.by_channel, key=result.by_channel.get) == "x"
