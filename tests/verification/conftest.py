"""Fixtures of the tests of verification."""

import pytest

from glider.paths import models_path
from glider.verification.funnel import funnel as funnel_file
from glider.verification.funnel.funnel import load_funnel
from glider.verification.proof import check
from tests.helpers.funnels import UNPROVEN
from tests.verification.clocked import make_clocked


@pytest.fixture(scope="session")
def funnel():
    """The nominal model's funnel, of Taylor polynomials without a remainder."""
    return load_funnel(UNPROVEN / "drawn.npz")


@pytest.fixture(scope="session")
def proven():
    """The same with a remainder, as it ships: it is proven that no flight leaves."""
    return load_funnel(models_path("funnels", "drawn.npz"))


@pytest.fixture(scope="session")
def clocked(proven):
    return make_clocked(proven)


@pytest.fixture(scope="session")
def coefficients(funnel):
    return funnel.nominal.closed_loop


@pytest.fixture(scope="session")
def seen():
    """What was found of files whose certificate was checked."""
    return {}


@pytest.fixture
def checked_once(monkeypatch, seen):
    """What takes longest of a file's check is done once: it is the same each time."""

    def once(name):
        function = getattr(check, name)

        def call(funnel, *given):
            assert funnel.sha256, "expected a funnel as it is in a file"
            which = [value for value in given if isinstance(value, int | list)]
            key = name, funnel.sha256, str(which)
            if key not in seen:
                seen[key] = function(funnel, *given)
            return seen[key]

        monkeypatch.setattr(check, name, call)

    for name in ("_certificate_faults", "remainder_seen"):
        once(name)
    make = funnel_file.make_moving_center

    def make_once(nominal, confidence, held):
        given = nominal.states, nominal.gains, confidence.factor
        key = "centers", *(array.tobytes() for array in given), held
        if key not in seen:
            seen[key] = make(nominal, confidence, held)
        return seen[key]

    monkeypatch.setattr(funnel_file, "make_moving_center", make_once)
