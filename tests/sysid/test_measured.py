"""Real throws of a real glider; third-party data, not part of this repository."""

from pathlib import Path

import pytest

from glider.sysid.pipeline import close_the_loop

THROWS = Path(__file__).parents[3] / "shared" / "measured" / "motion_studio_v3"

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        not THROWS.is_dir(), reason=f"needs the measured throws in {THROWS}"
    ),
]


@pytest.fixture(scope="module")
def throws():
    return close_the_loop(THROWS, grades=["A", "B"])


def test_pitch_zero_and_profile_drag_are_found(throws):
    found = {e.kind: e for e in throws.effects}
    assert throws.verdict == "effect_found"
    assert {"pitch_offset", "profile_drag"} <= set(found)
    drag = found["profile_drag"].coefficients["cd0"]
    assert drag.value > 4.0 * drag.std


def test_forces_predict_unseen_throws_better(throws):
    plate, corrected = throws.errors["refitted"], throws.errors["corrected"]
    assert throws.errors["as_drawn"] is None
    before = plate.measured_pitch_position_rms_m
    assert corrected.measured_pitch_position_rms_m < before / 1.3
    assert corrected.position_rms_m < plate.position_rms_m / 1.1
