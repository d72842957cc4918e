"""Real throws of a real glider; third-party data, not part of this repository."""

import csv
from pathlib import Path

import pytest

from glider.sysid.pipeline import close_the_loop

THROWS = Path(__file__).parents[3] / "shared" / "measured" / "motion_studio_v3"

pytestmark = [
    pytest.mark.nightly,
    pytest.mark.slow,
    pytest.mark.skipif(
        not THROWS.is_dir(), reason=f"needs the measured throws in {THROWS}"
    ),
]


def planar():
    """Names of the throws that were graded planar by hand."""
    with (THROWS / "index.csv").open(encoding="utf-8") as index:
        rows = list(csv.DictReader(index))
    return [row["file"] for row in rows if row["grade"] in ("A", "B")]


@pytest.fixture(scope="module", params=[planar, lambda: None], ids=["planar", "all"])
def throws(request):
    """Those that are planar, and all: the others roll over by up to 95°."""
    return close_the_loop(THROWS, flights=request.param())


def test_camber_drag_and_lift_by_pitch_rate_are_found(throws):
    """Drag lies along the body: a pitch zero that is off is no name for it."""
    found = {e.kind: e for e in throws.effects}
    # Formulas leave centimetres where a perfect model in still air leaves millimetres.
    assert throws.verdict == "partly_explained"
    assert throws.left.ratio_to_floor > 10.0
    assert {"camber", "pitch_rate_lift"} <= set(found)
    assert {"axial_drag", "profile_drag"} & set(found)
    zero_lift = found["camber"].coefficients["zero_lift_angle"]
    assert -0.25 < zero_lift.value < -0.1
    if "pitch_offset" in found:
        assert abs(found["pitch_offset"].coefficients["angle"].value) < 0.05


def test_a_trim_spread_is_what_the_throws_show_not_the_prior_of_the_search(throws):
    spread = throws.spreads.get("elevator_trim")
    if spread is not None:  # Where it is fitted: 0.05 rad is what the search assumes.
        assert abs(spread.std - 0.05) > 1e-6
        assert 0.0 < spread.std_error < spread.std
        assert set(spread.values) == set(throws.flights.fit)


def test_forces_predict_unseen_throws_better(throws):
    plate, corrected = throws.errors["refitted"], throws.errors["corrected"]
    assert throws.errors["nominal"] is None
    before = plate.rollout_measured_pitch.position_rms_m
    assert corrected.rollout_measured_pitch.position_rms_m < min(before / 2.0, 0.055)
    assert corrected.position_rms_m < min(plate.position_rms_m / 2.0, 0.08)
