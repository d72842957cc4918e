"""The ascent to where V rises most finds it at all times, from few points."""

import numpy as np
import pytest

from glider.verification.funnel.boundary import boundary_forms
from glider.verification.funnel.build import _STARTS
from glider.verification.funnel.growth import largest_growth
from tests.verification.points import sphere_points


@pytest.fixture(scope="module")
def forms(proven):
    """V̇/V on the boundary at 50 times, as the certificate has it."""
    part = proven.between(40, 89)
    return boundary_forms(part, part.nominal.push_slopes)


def test_the_largest_growth_is_found_from_few_points(forms):
    """A funnel with a margin of 0.03 1/s is certified where 0.012 are missed."""
    found = [
        largest_growth(forms, sphere_points(_STARTS, 7, seed=seed))
        for seed in (1, 2, 3)
    ]
    most = np.max(found, axis=0)
    assert np.all(most < 0.0)
    assert np.all(most - found < 0.012)


def test_what_neighbors_in_time_found_leads_to_more(forms):
    most = largest_growth(forms, sphere_points(_STARTS, 7, seed=1))
    for seed in (3, 4):
        assert np.all(most - largest_growth(forms, sphere_points(12, 7, seed)) < 0.012)
