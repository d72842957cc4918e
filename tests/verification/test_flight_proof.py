"""The proof that no flight leaves: what it claims, resumes, refuses and tells.

`make proofs` proves the shipped funnels whole, which takes minutes.
"""

import dataclasses
import json
import re
import shutil

import numpy as np
import pytest

from glider.errors import InputError
from glider.paths import PACKAGE, models_path
from glider.report.check_funnel import describe_proof
from glider.verification.dynamics.nominal import open_loop_rates
from glider.verification.funnel.funnel import load_funnel
from glider.verification.proof import flight_proof
from glider.verification.proof.check import check_funnel
from glider.verification.proof.flight_proof import (
    FlightProof,
    prove_flights,
    remainder_status,
)
from glider.verification.proof.interval_proof import (
    IntervalProof,
    prove_interval,
    worst_candidate,
)


@pytest.fixture(scope="module")
def short(proven):
    """Three intervals of the shipped funnel that are proven in a second each."""
    return proven.between(60, 63)


@pytest.fixture
def fake(monkeypatch):
    """Intervals that are proven at once, but for those that start at these times."""
    bad: list[float] = []

    def prove(piece, budget):
        fault = "a test says so" if piece.nominal.times[0] in bad else ""
        return IntervalProof(fault=fault, boxes=10, parts=1, ratio=0.5)

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


def test_every_flight_is_only_said_of_every_interval(proven, fake):
    proof = prove_flights(proven, every=100, workers=1)
    assert proof.complete and not proof.is_whole
    assert list(proof.outcomes) == [0, 100, 199]
    words = describe_proof(proven, proof)
    assert "every flight" not in words
    assert "3 of its 200 intervals" in words
    assert "nothing is proven of the others" in words
    assert remainder_status(proven, proof).endswith("in 3 of 200 intervals")
    bare = dataclasses.replace(proven, beta=0.0 * proven.beta)
    assert "accounts for no remainder" in describe_proof(bare, proof)


def test_the_first_interval_that_fails_is_told_with_a_state(proven, fake):
    times = proven.nominal.times
    fake += [times[100], times[150]]
    proof = prove_flights(proven, every=50, workers=1)
    assert not proof.complete
    assert (proof.failed, proof.fault) == (100, "a test says so")
    assert proof.until == times[100]
    assert proof.count == 2
    worst = proof.candidate
    assert times[100] <= worst.time <= times[101]
    assert proven.level(worst.time, np.array(worst.state)) == pytest.approx(1.0)
    assert worst.growth < 0.0
    words = describe_proof(proven, proof)
    assert f"Not proven from {times[100]:.4f} to {times[101]:.4f} s" in words
    assert "a test says so" in words
    assert "no counterexample" in words
    assert remainder_status(proven, proof) == f"rigorous until t={times[100]:.4f}"
    fake.append(0.0)
    proof = prove_flights(proven, every=50, workers=1)
    assert remainder_status(proven, proof) == "sampled"


@pytest.mark.parametrize("bend", [0.0, 10.0])
def test_a_candidate_is_where_v_rises(proven, bend):
    """With what is known of a held command's error."""
    piece = proven.between(60, 61)
    bends = bend * np.array([np.ones((7, 7)), 2.0 * np.eye(7)])
    nominal = dataclasses.replace(piece.nominal, bends=bends)
    wide = dataclasses.replace(
        piece, nominal=nominal, S=0.3 * piece.S, slopes=0.3 * piece.slopes
    )
    worst = worst_candidate(wide)
    assert worst.growth > 0.0
    nominal, (start, stop) = wide.nominal, wide.nominal.times
    state = np.array(worst.state)

    def command(time):
        share = (time - start) / (stop - start)
        u0, gains, M = (
            (1.0 - share) * ends[0] + share * ends[1]
            for ends in (nominal.inputs, nominal.gains, nominal.bends)
        )
        e = state - wide.center(time)
        return u0 - gains @ e + e @ M @ e

    rate = np.array(
        open_loop_rates(nominal.model, list(state), command(worst.time)), dtype=float
    )
    step = 1e-6 if worst.time < 0.5 * (start + stop) else -1e-6
    rise = wide.level(worst.time + step, state + step * rate)
    rise -= wide.level(worst.time, state)
    assert rise / step == pytest.approx(worst.growth, rel=1e-3)


def test_a_proof_goes_on_where_it_was_broken_off(proven, fake, tmp_path, monkeypatch):
    path, times = tmp_path / "proof.jsonl", proven.nominal.times
    fake.append(times[100])
    first = prove_flights(proven, every=50, workers=1, resume=path)
    assert first.from_file == 0
    assert len(path.read_text().splitlines()) == 3  # Not of what failed.
    with path.open("a") as stream:
        stream.write('{"interval": 100, "fau')  # As the power went.
    fake.clear()
    tried = []
    prove = flight_proof.prove_interval

    def counted(piece, budget):
        tried.append(float(piece.nominal.times[0]))
        return prove(piece, budget)

    monkeypatch.setattr(flight_proof, "prove_interval", counted)
    second = prove_flights(proven, every=50, workers=1, resume=path)
    assert tried == [times[100], times[150], times[199]]
    assert second.complete
    assert second.from_file == 2
    assert "2 of the intervals were read from the file" in describe_proof(
        proven, second
    )
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    assert [line["interval"] for line in lines[1:]] == [0, 50, 100, 150, 199]
    other = dataclasses.replace(proven, sha256="of another file")
    with pytest.raises(InputError, match="cannot be resumed: it is of another funnel"):
        prove_flights(other, every=50, workers=1, resume=path)
    path.write_text("no\n")
    with pytest.raises(InputError, match="line 1: not readable as JSON"):
        prove_flights(proven, every=50, workers=1, resume=path)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ('{"interval": 0}', "not written by --resume"),
        ('{"interval": 0, "seal": "é"}', "not written by --resume"),
        ('{"interval": 0, "boxes": "many"}', "field 'boxes' is 'many'"),
        ('{"interval": 0, "boxes": -1}', "field 'boxes' is -1"),
        ('{"interval": 0.5}', "field 'interval' is 0.5"),
        ('{"interval": 0, "ratio": 1e999}', "field 'ratio' is inf"),
        ('{"interval": 0, "proof": 1}', "unknown field 'proof'"),
        ("[0]", "a mapping of fields"),
        ("{}", "'interval' is missing"),
    ],
)
def test_a_forged_record_of_a_proof_is_refused(line, words, proven, fake, tmp_path):
    path = tmp_path / "proof.jsonl"
    prove_flights(proven, every=200, workers=1, resume=path)
    with path.open("a") as stream:
        stream.write(line + "\n")
    with pytest.raises(InputError, match=re.escape(words)) as error:
        prove_flights(proven, every=200, workers=1, resume=path)
    assert str(error.value).startswith(f"{path}: line 4: ")


def test_a_record_counts_for_its_own_header_and_program_only(
    proven, fake, tmp_path, monkeypatch
):
    """Not in a file of another funnel, nor after an edit of the checker."""
    path, other = tmp_path / "proof.jsonl", tmp_path / "other.jsonl"
    prove_flights(proven, every=200, workers=1, resume=path)
    forged = dataclasses.replace(proven, sha256="of another file")
    prove_flights(forged, every=200, workers=1, resume=other)
    lines = other.read_text().splitlines()[:1] + path.read_text().splitlines()[1:]
    other.write_text("\n".join(lines) + "\n")
    with pytest.raises(InputError, match="line 2: cannot be resumed: it was not"):
        prove_flights(forged, every=200, workers=1, resume=other)
    kept = prove_flights(proven, every=200, workers=1, resume=path)
    assert kept.from_file == 2
    with pytest.raises(InputError, match="another version of this program"):
        prove_flights(proven, every=200, budget=7, workers=1, resume=path)
    monkeypatch.setattr(flight_proof, "checker_hash", lambda: "of another program")
    with pytest.raises(InputError, match="another version of this program"):
        prove_flights(proven, every=200, workers=1, resume=path)


def test_the_hash_is_of_every_source_of_the_checker(tmp_path, monkeypatch):
    before = flight_proof.checker_hash.__wrapped__()
    shutil.copytree(PACKAGE, tmp_path / "glider", ignore=shutil.ignore_patterns("_*"))
    monkeypatch.setattr(flight_proof, "PACKAGE", tmp_path / "glider")
    found = {before, flight_proof.checker_hash.__wrapped__()}
    names = "verification/proof/boxes.py", "physics/chain.py", "control/predictor.py"
    for name in names:
        with (tmp_path / "glider" / name).open("a") as stream:
            stream.write("# Edited.\n")
        found.add(flight_proof.checker_hash.__wrapped__())
    assert len(found) == 5


def test_a_record_of_a_size_that_nobody_wrote_is_not_read(proven, tmp_path):
    path = tmp_path / "proof.jsonl"
    with path.open("wb") as stream:
        stream.truncate(10**11)
    with pytest.raises(InputError, match="expected a smaller file"):
        prove_flights(proven, every=200, workers=1, resume=path)


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
    assert check_funnel(forged, every=49).holds  # At 196, too.
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
    good = IntervalProof(boxes=3, parts=1, ratio=0.5)
    proof = FlightProof(
        times=proven.nominal.times,
        outcomes={0: good, 1: good},
        from_file=0,
        candidate=None,
    )
    assert (proof.boxes, proof.count) == (6, 2)
    assert proof.until == proven.nominal.times[2]
    assert not proof.is_whole
