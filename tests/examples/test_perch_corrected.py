"""What closing the loop buys: an effect that the model lacks, before and after."""

import pytest

from diagrams.program import load_truth
from examples import perch_corrected
from tests.helpers.examples import tell

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def flown():
    return perch_corrected.fly(load_truth("head_wind"), launches=10, seed=3)


@pytest.fixture(scope="module")
def told(flown, tmp_path_factory):
    folder = tmp_path_factory.mktemp("corrected")
    return tell(perch_corrected, flown, folder, "--launches=10", "--seed=3")


def test_the_corrected_model_perches_where_the_nominal_one_misses(flown):
    assert [effect.kind for effect in flown.found.effects] == ["wind"]
    assert flown.before.flights.perched <= 2
    assert flown.after.flights.perched == len(flown.after.flights) == 10
    assert max(flown.after.flights.misses) < 0.05 < min(flown.before.flights.misses)


def test_it_is_told_as_it_is(told, flown):
    figures = told.figures
    assert figures["effect_true"] == "wind"
    assert figures["effect_found"] == ["wind"]
    for name, rehearsal in (("before", flown.before), ("after", flown.after)):
        assert figures[name] == rehearsal.flights.key_figures()
    assert (figures["launches"], figures["seed"]) == (10, 3)
    assert "planned corrected: 10 of 10 launches perch" in told.words
    truth, *asked = told.asked.call_args.args[:3]
    assert asked == [10, 3]
    assert truth == load_truth("head_wind")


def test_it_is_drawn_and_animated(told):
    assert told.size == (1425, 1050)
    assert told.ink > 0.02
    assert ">Before and after: head_wind<" in told.page
    for words in ("planned corrected", "planned nominal", "plan of the nominal model"):
        assert f">{words}<" in told.page
