"""Proposed throws tell rivals apart better than those of the present kind."""

import dataclasses

import numpy as np
import pytest

from glider.compiled.flight import fly_tapes
from glider.errors import InputError
from glider.experiments.explanations import UNKNOWN, Findings, load_findings
from glider.experiments.proposal import next_throw, propose, read_task
from glider.experiments.throw_limits import ThrowLimits
from glider.physics.effects import ANGLE_SIGN
from glider.physics.model import GliderModel
from glider.physics.state import VELOCITY
from glider.report.next_throw import is_done, sentences
from tests.helpers.late import DELAYED, LATE
from tests.helpers.tasks import fly, typical

FINDINGS = Findings(models=(LATE, DELAYED))


def test_both_explanations_are_left_and_weighed(late):
    explanations = late[3]
    assert {e.model.kinds for e in explanations} == {("servo_lag",), ("command_delay",)}
    assert sum(e.probability for e in explanations) == pytest.approx(1.0 - UNKNOWN)
    assert all(e.probability > 0.05 for e in explanations)
    best, *_, worst = explanations
    assert best.log_evidence >= worst.log_evidence


def test_a_campaign_is_read_again_with_the_flights_and_the_servo_that_were_found():
    campaign = fly(flights=6)
    low, high = campaign.elevator_limits
    told = dataclasses.replace(campaign, elevator_limits=(low, 0.5 * high))
    first, *names = [flight.name for flight in campaign.flights]
    reading = read_task(told, dataclasses.replace(FINDINGS, excluded=(first,)))
    assert [record.name for record in reading.task.records] == names
    assert reading.campaign.limits.high > 0.6 * high


def test_designed_throws_separate_the_explanations(late, proposal):
    assert proposal.chance_now == max(e.probability for e in late[3])
    assert proposal.chance_then > 0.95
    assert proposal.chance_then > proposal.chance_now
    assert proposal.ending_then < proposal.ending_now
    said = " ".join(sentences(proposal))
    assert "servo_lag" in said
    assert "command_delay" in said
    assert "With 2 such throws" in said
    assert not is_done(proposal)


def test_still_air_leaves_nothing_to_chance(proposal):
    """The flights differ by their launches, their commands and the sensors' noise."""
    assert proposal.is_still
    assert proposal.ending_air < proposal.noise
    assert "less than the noise of a measured position" in " ".join(sentences(proposal))


@pytest.mark.nightly
def test_the_same_seed_proposes_the_same(late, monkeypatch):
    monkeypatch.setattr("glider.experiments.throw_search._ROUNDS", 1)
    first, again = (propose(*late, traced=LATE, launches=1) for _ in range(2))
    for one, other in zip(first.throws, again.throws, strict=True):
        assert np.array_equal(one.commands, other.commands)
        assert np.array_equal(one.launch, other.launch)


def test_proposed_throws_are_safe_where_the_launch_is_missed(late, proposal):
    """Flown by the plate alone from launches as fast and as slow as given."""
    limits = proposal.place.limits
    for throw in proposal.throws:
        period = throw.times[1]
        tape = np.repeat(throw.commands, 10)
        for sign in (-1.0, 1.0):
            start = throw.launch.copy()
            start[VELOCITY] *= 1.0 + sign * limits.missed_speed / throw.speed
            states = fly_tapes(GliderModel(), start[None], tape[None], period / 10.0)[0]
            flown = states[: int(throw.duration / period * 10)]
            # The servo's two milliseconds move it by some millimetres.
            assert flown[:, 1].min() > limits.z[0] - 0.02
            assert np.linalg.norm(flown[:, VELOCITY], axis=1).max() < limits.speed


def test_a_floor_above_the_launch_leaves_no_throw(late, monkeypatch):
    monkeypatch.setattr("glider.experiments.throw_search._ROUNDS", 1)
    with pytest.raises(InputError, match="floor"):
        propose(*late, traced=LATE, launches=1, limits=ThrowLimits(z=[1.0, 2.0]))


def test_throws_differ(proposal):
    first, second = proposal.throws
    assert not np.array_equal(first.commands, second.commands)


def test_what_is_left_is_the_air_once_all_is_known(monkeypatch):
    """A slow servo, known to a thousandth, that was traced at one speed."""
    monkeypatch.setattr("glider.experiments.throw_search._ROUNDS", 1)
    campaign = fly(typical("servo_lag"), flights=6)
    traced = GliderModel(effects=(typical("servo_lag"),), flown={"V": (7.0, 7.0)})
    proposal = next_throw(campaign, Findings(models=(traced,)), launches=1)
    assert [e.model.kinds for e in proposal.explanations] == [("servo_lag",)]
    assert proposal.chance_now == pytest.approx(1.0 - UNKNOWN)
    assert is_done(proposal)
    assert "What remains differs from throw to throw" in sentences(proposal)[-1]
    [beyond] = proposal.beyond
    assert beyond.startswith("V from ") and beyond.endswith("(flown: 7 to 7)")


def test_what_cannot_be_proposed_for_is_reported():
    campaign = fly(flights=3)
    with pytest.raises(InputError, match="servo"):
        next_throw(dataclasses.replace(campaign, elevator="fixed"), FINDINGS)
    vehicle = {k: v for k, v in campaign.vehicle.items() if k != "mass"}
    with pytest.raises(InputError, match="mass"):
        next_throw(dataclasses.replace(campaign, vehicle=vehicle), FINDINGS)
    turned = GliderModel(effects=(ANGLE_SIGN(pitch=-1.0, elevator=1.0, command=1.0),))
    with pytest.raises(InputError, match="angle_sign"):
        next_throw(campaign, dataclasses.replace(FINDINGS, models=(turned,)))
    with pytest.raises(InputError, match="report's campaign is 'other'"):
        next_throw(campaign, dataclasses.replace(FINDINGS, campaign="other"))
    with pytest.raises(InputError, match="launches is 0"):
        next_throw(campaign, FINDINGS, launches=0)
    with pytest.raises(InputError, match="'z'"):
        next_throw(campaign, FINDINGS, limits=ThrowLimits(z=[2.0, 1.0]))


@pytest.mark.parametrize("text", ["{", "{}", "[]", '{"effects": 3}'])
def test_what_is_no_report_is_reported(tmp_path, text):
    with pytest.raises(InputError, match=r"report\.json"):
        load_findings(tmp_path)
    (tmp_path / "report.json").write_text(text)
    with pytest.raises(InputError, match=r"report\.json: "):
        load_findings(tmp_path)
