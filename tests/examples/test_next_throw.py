"""Two rivals are output apart by throws that are proposed."""

import pytest

from examples import next_throw
from glider.errors import InputError
from tests.helpers.examples import run_main


@pytest.fixture(scope="module")
def found():
    return next_throw.run("command_delay", launches=4)


@pytest.mark.nightly
def test_few_throws_tell_the_hidden_effect(found):
    assert found.found == found.truth == "command_delay"
    assert found.probabilities[0]["command_delay"] < next_throw.ENOUGH
    assert found.probabilities[-1]["command_delay"] >= next_throw.ENOUGH
    assert 1 <= len(found.proposals) <= 4  # The clocks may explain a millisecond.
    assert len(found.flights) == next_throw.GIVEN + len(found.proposals)
    assert len(found.probabilities) == len(found.proposals) + 1


@pytest.mark.nightly
def test_the_result_is_reported(found, tmp_path):
    output = run_main(next_throw, found, tmp_path, "--effect=command_delay")
    assert output.figures == found.key_figures()
    assert output.figures["throws"] == len(found.proposals)
    assert "separate with probability" in output.words
    assert "the hidden effect was command_delay" in output.words
    assert output.asked.call_args.args[0] == "command_delay"
    assert output.ink > 0.02
    assert "proposed" in output.page


def test_an_effect_that_is_no_rival_is_reported():
    with pytest.raises(InputError, match="servo_lag"):
        next_throw.run("wind")
