"""Effects planted in a campaign are traced, each with its coefficients."""

import pytest

from glider.sysid.pipeline import close_the_loop
from tests.helpers.tasks import fly, typical


@pytest.mark.slow
@pytest.mark.parametrize(
    "kinds",
    [
        ("command_delay",),
        ("tail_wake",),
        ("pose_latency",),
        ("marker_offset",),
        ("pitch_rate_lift",),
        ("axial_drag",),
        ("elevator_blowback",),
        ("stalled_downwash",),
        ("wind_shear",),
        ("added_mass",),
        ("inertia",),  # Which added_mass holds too.
    ],  # More kinds: lifelike campaigns; and pairs: bench_tracing.
    ids="+".join,
)
def test_planted_effects_are_traced(kinds):
    effects = [typical(kind) for kind in kinds]
    result = close_the_loop(fly(*effects, flights=8))
    assert sorted(effect.kind for effect in result.effects) == sorted(kinds)
    for effect in effects:
        found = next(e for e in result.effects if e.kind == effect.kind.kind)
        for coefficient, truth in effect.to_dict().items():
            assert found.coefficients[coefficient].value == pytest.approx(
                truth, rel=0.15
            )
