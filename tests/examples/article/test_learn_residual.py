"""The loop of learning, in two ways beside a planner that knows the truth."""

import pytest

import learn_residual
from glider.physics.model import GliderModel
from learn_residual import weight_changes
from tests.helpers.examples import run_main

pytestmark = pytest.mark.nightly

OPTIONS = ("--truth=head_wind", "--weights=2", "--traced=2", "--launches=3")


@pytest.fixture(scope="module")
def found():
    return learn_residual.run(
        GliderModel.load("head_wind"), weights=2, traced=2, launches=3
    )


@pytest.fixture(scope="module")
def output(found, tmp_path_factory):
    return run_main(learn_residual, found, tmp_path_factory.mktemp("learned"), *OPTIONS)


def test_learning_reaches_a_planner_that_knows_the_truth(found):
    weights, traced, oracle = found.weights, found.traced, found.oracle
    assert len(weights) == len(traced) == 2
    assert found.launches == len(traced[1].flights) == 3
    assert weights[0].miss == traced[0].miss > 5.0 * oracle
    assert [turn.identified.effects for turn in traced] == [(), ("wind",)]
    assert traced[1].miss < max(1.5 * oracle, 0.01)
    assert weights[1].miss < 0.5 * weights[0].miss
    assert traced[1].terminal_cost < 0.2 * traced[0].terminal_cost
    [change] = weight_changes(weights)
    assert change > 0.0


def test_the_result_is_reported(output, found):
    figures = dict(output.figures)
    for name, rounds in (("rbf", found.weights), ("traced", found.traced)):
        summary = figures.pop(name)
        assert summary.pop("terminal_cost") == [turn.terminal_cost for turn in rounds]
        assert summary.pop("miss_m") == [turn.miss for turn in rounds]
        rest = {"weight_change": weight_changes(rounds)}
        assert summary == (rest if name == "rbf" else {"effects": [[], ["wind"]]})
    asked = {"truth": "head_wind", "launches": 3, "order": 4, "seed": 0}
    assert figures == {"oracle_miss_m": found.oracle, **asked}
    assert "traced to wind" in output.words
    assert f"the median miss is {1000 * found.oracle:.1f} mm" in output.words


def test_it_is_drawn_and_animated(output):
    assert output.size == (1950, 990)
    assert output.ink > 0.035  # A third of the width is the legends.
    assert ">Learning: head_wind<" in output.page
    for words in ("traced - last round", "weights - last round"):
        assert f">{words}<" in output.page
    assert ">nominal - first round<" in output.page


def test_the_options_reach_the_story(found, tmp_path):
    output = run_main(
        learn_residual, found, tmp_path, *OPTIONS, "--order=1", "--seed=5"
    )
    truth, *rounds = output.asked.call_args.args
    assert truth == GliderModel.load("head_wind")
    assert rounds == [2, 2]
    options = output.asked.call_args.kwargs
    assert (options["launches"], options["seed"]) == (3, 5)
    assert options["settings"].order == 1
    assert (output.figures["order"], output.figures["seed"]) == (1, 5)
