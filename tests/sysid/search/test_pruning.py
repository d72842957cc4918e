"""Effects that are not needed go, one by one and all at once."""

from glider.physics.effects import KINDS
from glider.sysid.search.moves import prune, with_fewer
from tests.helpers.searches import kinds_fitted, search_among


def test_a_tilted_frame_is_no_turned_pitch_with_a_thrust():
    offered = ("frame_tilt", "pitch_offset", "thrust")
    search, plate = search_among(KINDS["frame_tilt"](angle=0.02), *offered)
    pair = kinds_fitted(search, plate, "pitch_offset", "thrust")
    found = with_fewer(search, pair)
    assert found is not None
    assert found.kinds == ("frame_tilt",)
    assert search.penalized_cost(found) < search.penalized_cost(pair)
    assert with_fewer(search, found) is None


def test_what_is_not_needed_is_dropped():
    offered = ("frame_tilt", "mass")
    search, plate = search_among(KINDS["frame_tilt"](angle=0.02), *offered)
    model, evidence = prune(search, kinds_fitted(search, plate, *offered))
    assert model.kinds == ("frame_tilt",)
    assert evidence["frame_tilt"] > 100.0
