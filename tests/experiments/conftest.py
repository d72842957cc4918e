"""Fixtures: flights of a late servo, and throws proposed for them."""

import pytest

from tests.helpers.late import late_posterior, late_proposal


@pytest.fixture
def late():
    """Campaign, task, noise and explanations."""
    return late_posterior()


@pytest.fixture
def proposal():
    return late_proposal()
