"""The proof that no flight leaves: what it claims, refuses and says.

`make proofs` proves the shipped funnels whole, which takes minutes.
"""

import dataclasses
import re

import numpy as np
import pytest

from glider.paths import models_path
from glider.report.check_funnel import describe_proof
from glider.verification.funnel.funnel import load_funnel
from glider.verification.proof import flight_proof, interval_proof
from glider.verification.proof.check import check_funnel
from glider.verification.proof.flight_proof import FlightProof, prove_flights
from glider.verification.proof.interval_proof import IntervalProof, prove_interval


@pytest.fixture(scope="module")
def short(proven):
    """Three intervals of the shipped funnel that are proven in a second each."""
    return proven.between(60, 63)


@pytest.fixture
def fake(monkeypatch):
    """Intervals that are proven at once, but for those that start at these times."""
    bad: list[float] = []

    def prove(piece, **given):
        fault = "a test says so" if piece.nominal.times[0] in bad else ""
        return IntervalProof(fault=fault, boxes=10, ratio=0.5)

    monkeypatch.setattr(flight_proof, "prove_interval", prove)
    return bad


def test_every_interval_of_a_part_is_proven(short):
    shares = []
    proof = prove_flights(short, workers=1, progress=shares.append)
    assert proof.is_whole
    assert list(proof.outcomes) == [0, 1, 2]
    assert shares == pytest.approx([1 / 3, 2 / 3, 1.0])
    assert proof.until == short.nominal.times[-1]
    assert 300 < proof.boxes < 10_000
    assert "every flight" in describe_proof(short, proof)


@pytest.mark.parametrize("is_checked", [False, True])
def test_a_proof_proves_the_certificate_unless_it_was(short, is_checked, monkeypatch):
    monkeypatch.setattr(interval_proof, "_certificate_fault", lambda piece: "no")
    piece = short.between(0, 1)
    proof = prove_flights(piece, workers=1, is_checked=is_checked)
    assert proof.is_whole == is_checked
    assert proof.fault == ("" if is_checked else "no")


def test_every_flight_is_only_said_of_every_interval(proven, fake):
    proof = prove_flights(proven, every=100, workers=1)
    assert proof.complete and not proof.is_whole
    assert list(proof.outcomes) == [0, 100, 199]
    words = describe_proof(proven, proof)
    assert "every flight" not in words
    assert "3 of its 200 intervals" in words
    assert "nothing is proven of the others" in words
    bare = dataclasses.replace(proven, beta=0.0 * proven.beta)
    assert "accounts for no remainder" in describe_proof(bare, proof)


def test_the_first_interval_that_fails_is_named(proven, fake):
    times = proven.nominal.times
    fake += [times[100], times[150]]
    proof = prove_flights(proven, every=50, workers=1)
    assert not proof.complete
    assert (proof.failed, proof.fault) == (100, "a test says so")
    assert proof.until == times[100]
    assert proof.count == 2
    words = describe_proof(proven, proof)
    assert f"Not proven from {times[100]:.4f} to {times[101]:.4f} s" in words
    assert "a test says so" in words


def with_stop(funnel, stop):
    """The funnel of a glider whose elevator stops there."""
    model = funnel.nominal.model
    limits = [model.parameters.elevator_limits[0], stop]
    parameters = dataclasses.replace(model.parameters, elevator_limits=limits)
    model = dataclasses.replace(model, parameters=parameters)
    nominal = dataclasses.replace(funnel.nominal, model=model)
    return dataclasses.replace(funnel, nominal=nominal)


def test_what_is_wrong_between_the_times_only_is_refused(proven):
    """A forged stop that no set meets at any of the times, and one does between."""
    forged = with_stop(proven, 0.94498)
    [fault] = check_funnel(forged, every=49).faults  # At 196, too.
    assert "The servo would meet its limits from" in fault
    outcome = prove_interval(forged.between(196, 197))
    assert outcome.fault == "the servo would meet its limits"
    assert prove_interval(forged.between(60, 61)).proven


def moved(nominal, by):
    return dataclasses.replace(nominal, states=nominal.states + by)


CHANGES = {
    "no remainder": (lambda p: {"beta": 0.0 * p.beta}, "accounts for no remainder"),
    "weights of zero": (lambda p: {"weights": 0.0 * p.weights}, "a weight"),
    "not an ellipsoid": (lambda p: {"S": -p.S}, "not an ellipsoid"),
    "half of the remainder": (lambda p: {"beta": 0.5 * p.beta}, "the remainder is"),
    "sets that widen": (
        lambda p: {"slopes": p.slopes + 3.0 * p.S},
        "V was not proven to fall",
    ),
    "a nominal that drifts": (
        lambda p: {"nominal": moved(p.nominal, 0.1 * np.eye(2, 7))},
        "V was not proven to fall",
    ),
    "no flight at all": (lambda p: {"nominal": moved(p.nominal, 1e200)}, "too large"),
}


@pytest.mark.parametrize("name", CHANGES)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_an_interval_of_a_corrupted_funnel_is_not_proven(name, proven):
    change, words = CHANGES[name]
    piece = proven.between(60, 61)
    outcome = prove_interval(dataclasses.replace(piece, **change(piece)))
    assert not outcome.proven
    assert words in outcome.fault


def test_a_bound_that_r_passes_on_the_boundary_is_named():
    """Boxes there have their centers outside the ball: none would do, however small."""
    piece = load_funnel(models_path("funnels", "head_wind_hook.npz")).between(26, 27)
    outcome = prove_interval(dataclasses.replace(piece, beta=0.9 * piece.beta))
    assert re.search(r"the remainder is 1\.0\d+ times its bound", outcome.fault)
    assert outcome.ratio > 1.0 and outcome.boxes < 50_000


def test_a_proof_counts_what_it_has(proven):
    good = IntervalProof(boxes=3, ratio=0.5)
    proof = FlightProof(times=proven.nominal.times, outcomes={0: good, 1: good})
    assert (proof.boxes, proof.count) == (6, 2)
    assert proof.until == proven.nominal.times[2]
    assert not proof.is_whole
