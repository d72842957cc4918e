"""What sums of squares prove of the oscillator's region, with V of three degrees."""

import numpy as np
import pytest

import van_der_pol
from planar import values
from tests.helpers.examples import tell
from van_der_pol import SIZE, is_proved, limit_cycle, true_area


@pytest.fixture(scope="module")
def found():
    return van_der_pol.run(rounds=1)


@pytest.fixture(scope="module")
def told(found, tmp_path_factory):
    folder, writes = tmp_path_factory.mktemp("region"), ("--json", "--figure")
    arguments = ("--rounds=1", "--headless")
    return tell(van_der_pol, found, folder, *arguments, writes=writes)


def test_a_v_of_higher_degree_proves_more(found):
    assert found.level == pytest.approx(2.3045, abs=0.0005)
    shares = found.shares
    assert list(shares) == [2, 4, 6]
    assert 0.47 < shares[2] < shares[4] < 1.0
    assert shares[2] < shares[6] < 1.0


def test_what_is_found_is_proved_and_true(found):
    for region in found.proved.values():
        assert is_proved(region)
        assert np.min(values(region.polynomial, limit_cycle() / SIZE)) > 1.0


def test_it_is_told_as_it_is(told, found):
    figures = told.figures
    assert figures["rho"] == found.level
    assert figures["degree"] == {str(k): share for k, share in found.shares.items()}
    assert (figures["rounds"], figures["true_area"]) == (1, true_area())
    assert figures["seconds"] >= 0.0
    assert "the level is 2.3045" in told.words
    assert told.asked.call_args.args[0] == 1


def test_it_is_drawn(told):
    assert told.size == (1275, 975)
    assert told.ink > 0.2  # The true region is shaded.
