"""One flight of another kind is found; flights of one glider never are."""

import dataclasses

import numpy as np
import pytest

from glider.physics.effects import KINDS
from glider.sysid.likelihood.candidates import Candidates
from glider.sysid.likelihood.outliers import (
    _mean_squares,
    _stand_out,
    find_extreme,
    find_outlying,
    find_unexplained,
)
from tests.campaign.checks import breaking as b
from tests.helpers.tasks import fit_kinds, fly, task_of

ODD = 3
NAME = f"flight_{ODD:03d}.csv"


@pytest.fixture(scope="module")
def campaign():
    """Lift is missing from the model: that is no fault of any flight."""
    return fly(KINDS["attached_lift"](slope=2.0), flights=8, duration=0.6)


def outlying(campaign):
    return find_outlying(*task_of(campaign))


def test_flights_of_one_glider_do_not_stand_out(campaign):
    assert outlying(campaign) == {}


@pytest.mark.parametrize(
    "edit",
    [
        b.scale(1, -1, 1),
        b.scale(1, 1, -1),
        b.tilt(0.3),
        b.hit(30, (-1.0, 0.5, 4.0)),
        b.with_servo(lambda f: -f.elevator),
        b.shift_commands(0.06),
    ],
    ids=["z down", "pitch sign", "tilted", "hit", "elevator sign", "late commands"],
)
def test_a_broken_flight_stands_out_alone(campaign, edit):
    found = outlying(b.change(campaign, edit, only=ODD))
    assert set(found) == {NAME}
    assert found[NAME] > 2.0


def test_few_flights_judge_no_other(campaign):
    few = dataclasses.replace(campaign, flights=campaign.flights[:4])
    assert outlying(b.change(few, b.scale(1, -1, 1), only=ODD)) == {}


def test_only_exceptions_stand_out():
    squares = np.exp(np.random.default_rng(0).normal(0.0, 0.1, 20))
    assert not _stand_out(squares).any()
    squares[4] *= 10.0
    assert list(np.flatnonzero(_stand_out(squares))) == [4]
    squares[:7] *= 10.0
    assert not _stand_out(squares).any()


def test_flights_without_any_error_have_no_outliers(campaign, monkeypatch):
    """What is left of them is rounding: zero, or of any size and sign."""
    task, noise = task_of(campaign)
    grams = Candidates.grams
    for share in (0.0, 1e-18):
        monkeypatch.setattr(
            Candidates, "grams", lambda *a, share=share: share * grams(*a)
        )
        assert np.isfinite(_mean_squares(task, noise)).all()
        assert find_outlying(task, noise) == {}


def test_a_flight_that_needs_far_other_values_is_apart():
    """Its lengths are another's: own values take that up, and no square stands out."""
    campaign = fly(KINDS["profile_drag"](cd0=0.05), flights=10, duration=0.6)
    assert find_extreme(*fit_kinds(campaign, "profile_drag")) == {}
    odd = b.change(campaign, b.scale(1.06, 1.06, 1), only=ODD)
    assert outlying(odd) == {}
    found = find_extreme(*fit_kinds(odd, "profile_drag"))
    assert set(found) == {NAME}
    assert "no other flight needs" in found[NAME]


@pytest.mark.nightly
def test_a_flight_that_a_model_cannot_explain_as_the_others_is_found():
    """Its elevator moves for a while by 40 mrad: no flight of another glider does."""
    campaign = fly(KINDS["profile_drag"](cd0=0.05), flights=10, duration=0.6)
    task, model = fit_kinds(campaign, "profile_drag")
    assert find_unexplained(task, model) == []

    def turned(flight):
        angle = flight.elevator + 0.04 * (flight.time > 0.3)
        return dataclasses.replace(flight, elevator=angle)

    odd = b.change(campaign, turned, only=ODD)
    assert outlying(odd) == {}
    assert find_unexplained(fit_kinds(odd, "profile_drag")[0], model) == [NAME]
