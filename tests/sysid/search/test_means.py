"""What all flights have is distinguished from what each has of its own."""

import pytest

from glider.physics.effects import KINDS
from tests.helpers.searches import search_among


def test_what_all_flights_have_is_no_spread():
    search, plate = search_among(KINDS["pitch_offset"](angle=0.03), "pitch_offset")
    spread = search.fit(plate)
    assert spread.scales.pitch_zero == pytest.approx(0.03, rel=0.3)
    found = search.improved(spread)
    assert found.kinds == ("pitch_offset",)
    slot = search.task.space.index["pitch_offset.angle"]
    assert found.theta[slot] == pytest.approx(0.03, abs=1e-3)
    assert found.scales.pitch_zero < 0.003
