"""Fixtures of the tests of verification."""

import pytest

from glider.paths import models_path
from glider.verification.funnel.funnel import load_funnel


@pytest.fixture(scope="session")
def funnel():
    """The nominal model's funnel, as it ships."""
    return load_funnel(models_path("funnels", "drawn.npz"))


@pytest.fixture(scope="session")
def proven():
    """The same with a remainder, of which it is proven that no flight leaves."""
    return load_funnel(models_path("funnels", "proven", "drawn.npz"))


@pytest.fixture(scope="session")
def coefficients(funnel):
    return funnel.nominal.closed_loop
