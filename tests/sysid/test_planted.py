"""Effects planted in a campaign are traced, each with its coefficients."""

import pytest

from glider.physics.effects import KINDS
from glider.sysid.likelihood.task import start_of
from glider.sysid.pipeline import close_the_loop
from glider.sysid.search.moves import Search
from tests.helpers.tasks import fly, task_of, typical

SEARCHED = ("command_delay", "marker_offset", "added_mass")
"""One of each stage: actuator, sensor, inertia; of forces: search/test_moves.py."""

MORE = (
    *("pose_latency", "pitch_rate_lift", "axial_drag", "stalled_downwash"),
    *("elevator_blowback", "wind_shear"),
)
WHOLE = ("tail_wake", "inertia")  # Which added_mass holds too.
"""More kinds: lifelike campaigns; and pairs: bench_tracing."""


@pytest.mark.slow
@pytest.mark.parametrize(
    "kind", [*SEARCHED, *(pytest.param(k, marks=pytest.mark.nightly) for k in MORE)]
)
def test_the_search_finds_planted_effects(kind):
    effect = typical(kind)
    task, noise = task_of(fly(effect, flights=5))
    search = Search(task, lambda text: None)
    model = search.improved(start_of(task, noise))
    assert model.kinds == (kind,)
    for name, truth in effect.to_dict().items():
        found = model.theta[task.space.index[f"{kind}.{name}"]]
        assert found == pytest.approx(truth, rel=0.15), name


@pytest.mark.nightly
@pytest.mark.parametrize("kind", WHOLE)
def test_the_whole_pipeline_names_planted_effects(kind):
    effect = typical(kind)
    result = close_the_loop(fly(effect, flights=5))
    [found] = result.effects
    assert found.kind == kind
    for name, truth in effect.to_dict().items():
        assert found.coefficients[name].value == pytest.approx(truth, rel=0.15)


@pytest.mark.nightly
def test_a_wind_that_all_flights_share_is_in_the_model():
    """And no variation over flights about zero, of which no model has a mean."""
    planted = (KINDS["wind"](x=-0.4), KINDS["profile_drag"](cd0=0.03))
    result = close_the_loop(fly(*planted, flights=20, seed=24), seed=24)
    assert not result.spreads
    found = {effect.kind.kind: effect.to_dict() for effect in result.model.effects}
    assert found["wind"]["x"] == pytest.approx(-0.4, abs=2e-3)
    assert found["profile_drag"]["cd0"] == pytest.approx(0.03, abs=2e-4)
