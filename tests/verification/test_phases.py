"""A loop at any phase between launch and clock: funnels that lead into others."""

import dataclasses
import json

import numpy as np
import pytest

from glider.__main__ import main
from glider.control.predictor import Hold
from glider.errors import InputError
from glider.paths import models_path
from glider.physics.confidence import SHAPES, make_confidence
from glider.physics.model import load_covariance
from glider.planning.problem import PerchingProblem
from glider.verification import phases
from glider.verification.funnel.funnel import load_funnel, save_funnel
from glider.verification.proof import check, flight_proof, latency
from glider.verification.proof.flight_proof import FlightProof
from glider.verification.proof.interval_proof import IntervalProof, prove_interval
from glider.verification.proof.latency import ProvenLatency
from glider.verification.proof.phases import (
    LEVEL,
    PREDICTED,
    first_commands,
    is_inside,
    phase_faults,
    phase_intervals,
)
from glider.verification.sos.sphere import normalized
from glider.verification.trials import as_flown
from glider.verification.trials.as_flown import FlownLoop, fly_loop
from glider.verification.trials.falsify import ESCAPE_LEVEL, boundary_states
from tests.helpers.second_flight import advance, rates_of
from tests.verification.forging import HELD, forge
from tests.verification.test_gliders import allowed_by, among

FOLDER = models_path("funnels", "any_phase")
RESTS = [FOLDER / f"phase_{k}.npz" for k in range(1, 5)]


@pytest.fixture(scope="module")
def launch():
    return load_funnel(FOLDER / "launch.npz")


@pytest.fixture(scope="module")
def rests():
    return [load_funnel(path) for path in RESTS]


def changed(funnel, **arrays):
    """Returns a funnel with other arrays, of its sets or of its nominal."""
    own = {name: arrays.pop(name) for name in ("S", "slopes") if name in arrays}
    nominal = dataclasses.replace(funnel.nominal, **arrays)
    return dataclasses.replace(funnel, nominal=nominal, **own)


def scaled(funnel, factor):
    """Returns a funnel whose sets are so many times as wide."""
    return changed(funnel, S=funnel.S / factor**2, slopes=funnel.slopes / factor**2)


def test_the_shipped_funnels_are_one_loop_at_any_phase(launch, rests):
    problem = PerchingProblem.load("perching_hook")
    assert phase_faults(launch, rests, problem) == []
    assert first_commands(launch, rests) == pytest.approx((0.01, 0.03), abs=1e-12)
    assert launch.half_widths()[1] > 0.1
    assert all(own.settings.wind >= 0.02 for own in (launch, *rests))
    model = models_path("identified", "head_wind.yaml")
    known = make_confidence(launch.nominal.model, load_covariance(model))
    assert all(own.allowed.covers(known) for own in (launch, *rests))


def test_the_launch_flies_without_commands(launch):
    """By another integrator: the nominal is a flight with an elevator that rests."""
    model, times = launch.nominal.model, launch.nominal.times
    x, still = launch.nominal.states[:1], np.zeros(1)
    for step, expected in zip(np.diff(times), launch.nominal.states[1:], strict=True):
        x = advance(lambda y, t: rates_of(model, y, still), x, np.array([[step]]))
        assert x[0] == pytest.approx(expected, abs=1e-7)


@pytest.mark.parametrize("k", [0, 11])
def test_a_flight_without_commands_is_proven(launch, k):
    """Nothing that is fed back moves the elevator: its command has no spread."""
    found = prove_interval(launch.between(k, k + 1))
    assert found.proven and found.boxes < 1000


def test_whatever_is_missing_is_said(launch, rests):
    for k in range(len(rests)):
        others = rests[:k] + rests[k + 1 :]
        [fault] = phase_faults(launch, others)
        assert "is not proven to be in any" in fault
        assert f"{10 + 5 * k} to" in fault
    wide = scaled(launch, 1.05)
    assert "is not proven to be in any" in phase_faults(wide, rests)[0]
    assert phase_faults(scaled(launch, 0.9), rests) == []
    late = PerchingProblem(launch=[-3.5, 0.1, 0.0, 0.0, 7.1, 0.0, 0.0])
    assert "starts with xdot = 7;" in phase_faults(launch, rests, late)[0]
    for name in ("inputs", "gains", "bends"):
        moved = changed(launch, **{name: getattr(launch.nominal, name) + 0.01})
        [fault] = phase_faults(moved, rests)
        assert "commands the elevator" in fault
    ticking = dataclasses.replace(launch, settings=rests[0].settings)
    assert "commands the elevator" in phase_faults(ticking, rests)[0]
    [fault] = phase_faults(launch, rests, latency=0.005)
    assert "a latency of 10 ms; expected 5 ms" in fault
    narrow = PerchingProblem(x_limits=[-3.45, 1.0], duration_limits=[0.5, 0.9])
    far, long = phase_faults(launch, rests, narrow)
    assert "passes x = -3.5 m" in far and "may last 0.9085 s" in long
    short = changed(launch, times=launch.nominal.times / 2.0)
    assert "ends after 15 ms" in phase_faults(short, rests)[0]
    settings = dataclasses.replace(rests[0].settings, period=0.01)
    slower = dataclasses.replace(rests[0], settings=settings)
    assert "held for 10, 20 ms" in phase_faults(launch, [slower, *rests[1:]])[0]
    assert "held for 0 ms" in phase_faults(launch, [launch])[0]
    other = load_funnel(models_path("funnels", "held_hook.npz"))
    assert "another glider" in phase_faults(launch, [other])[0]
    with pytest.raises(InputError, match="at least one"):
        phase_faults(launch, [])


def test_numbers_that_overflow_prove_nothing(launch, rests):
    piece = launch.between(10, 11)
    flat = [changed(rests[3], S=rests[3].S * factor) for factor in (0.0, -1.0, 1e300)]
    assert not any(is_inside(piece, own) for own in flat)
    huge = changed(piece, states=piece.nominal.states * 1e200)
    assert not is_inside(huge, rests[3])


def test_a_set_is_inside_exactly_where_no_point_is_outside(launch, rests):
    """By an ascent to the farthest point, which knows nothing of multipliers."""
    rng, decided = np.random.default_rng(3), {True: 0, False: 0}
    for _ in range(40):
        k, own = int(rng.choice(phase_intervals(launch, rests))), rests[rng.integers(4)]
        piece = scaled(launch.between(k, k + 1), rng.uniform(0.3, 1.3))
        states = (
            piece.nominal.states + 0.03 * rng.normal(size=(1, 7)) * own.half_widths()
        )
        piece = changed(piece, states=states)
        worst = max(
            farthest(piece, own, time) for time in np.linspace(*piece.nominal.times, 5)
        )
        if abs(worst - LEVEL) > 2e-3:
            decided[worst < LEVEL] += 1
            assert is_inside(piece, own) == (worst < LEVEL)
    assert min(decided.values()) > 5


def farthest(piece, own, time):
    """Returns the largest V, of another funnel's inlet, in a set at a time."""
    spread = np.linalg.inv(np.linalg.cholesky(piece.shape(time))).T
    R = np.linalg.cholesky(own.S[0]).T
    M, v = R @ spread, R @ (piece.center(time) - own.nominal.states[0])
    points = normalized(np.random.default_rng(0).normal(size=(60, 7)))
    for _ in range(400):
        points = normalized((points @ M.T + v) @ M)
    return np.max(np.sum((points @ M.T + v) ** 2, axis=1))


@pytest.mark.nightly
def test_flights_at_any_phase_stay(launch, rests, monkeypatch):
    monkeypatch.setattr(as_flown, "CLIMB_ROUNDS", 1)
    hold = Hold(period=0.02, latency=0.01, predicts=True)
    loop = FlownLoop(hold=hold, wind=0.02, command_error=0.01)
    found = fly_loop(launch, loop, 80, np.random.default_rng(1), rests=rests)
    assert found.escapes == found.astray == 0
    assert found.levels.max() > 0.99 and found.later.max() < 1.0
    assert 0.0 <= found.phases.min() < 0.002 and 0.018 < found.phases.max() < 0.02
    monkeypatch.setattr(as_flown, "CLIMB_ROUNDS", 0)
    windy = dataclasses.replace(loop, wind=1.0)
    blown = fly_loop(launch, windy, 20, np.random.default_rng(1), rests=rests)
    assert blown.escapes > 0
    early = dataclasses.replace(loop, hold=dataclasses.replace(hold, latency=0.005))
    with pytest.raises(InputError, match=r"the launch funnel's, 0\.01 s"):
        fly_loop(launch, early, 10, np.random.default_rng(1), rests=rests)


def test_flights_leave_where_a_phase_has_no_funnel(launch, rests, monkeypatch):
    """They start far from the inlet of the funnel that is left to them."""
    monkeypatch.setattr(as_flown, "CLIMB_ROUNDS", 0)
    loop = FlownLoop(hold=Hold(period=0.02, latency=0.01, predicts=True))
    found = fly_loop(launch, loop, 100, np.random.default_rng(1), rests=rests[:1])
    late = found.phases > 0.015
    assert np.all(found.levels[found.phases < 0.004] <= ESCAPE_LEVEL)
    assert np.mean(found.levels[late] > ESCAPE_LEVEL) > 0.2


def test_the_funnel_of_the_least_level_is_chosen(launch, rests):
    for k, own in enumerate(rests):
        state = launch.center(0.0125 + 0.005 * k)
        assert phases.rest_for(rests, state) is own


def test_a_wind_leaves_a_prediction_within_its_room(launch, rests):
    """0.005 of the inlets, by flights of the last 10 ms in a wind and without."""
    model, rng = launch.nominal.model, np.random.default_rng(2)
    directions, still, most = normalized(rng.normal(size=(200, 7))), np.zeros(200), 0.0
    for k in phase_intervals(launch, rests):
        states = boundary_states(launch, k - 4, directions)
        for angle in np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False):
            air = np.tile([np.cos(angle), np.sin(angle)], (200, 1))
            air *= launch.settings.wind
            ends = [
                advance(lambda x, t, w=w: rates_of(model, x, still, w), states, 0.01)
                for w in (None, air)
            ]
            for own in rests:
                calm, blown = (np.sqrt(own.level(0.0, end)) for end in ends)
                most = max(most, np.max(np.abs(calm - blown)))
    assert 1e-4 < most < PREDICTED
    assert np.sqrt(LEVEL) + 2.0 * PREDICTED <= 1.0


@pytest.fixture
def quick(monkeypatch, checked_once):
    """The command line without what takes minutes; proofs are as if they were whole."""
    monkeypatch.setattr(check, "held_faults", lambda funnel, progress: [])
    proofs = []

    def prove(funnel, every, **given):
        proofs.append(funnel)
        kept = funnel.nominal.flows.tolist()
        if len(proofs) == fails:
            kept = kept[:-1]
        whole = IntervalProof(boxes=1, parts=1, ratio=0.5)
        return FlightProof(
            times=funnel.nominal.times,
            outcomes=dict.fromkeys(kept, whole),
            from_file=0,
            candidate=None,
        )

    def prove_latency(predictions, least, progress):
        assert predictions[0].ends == pytest.approx((0.01, 0.03))
        return ProvenLatency(latency=0.01, error_left=left, least=least)

    fails, left = 0, 0.006
    monkeypatch.setattr(flight_proof, "prove_flights", prove)
    monkeypatch.setattr(latency, "prove_latency", prove_latency)

    def run(
        *arguments,
        launch=FOLDER / "launch.npz",
        rests=RESTS,
        failing=0,
        error_left=left,
    ):
        nonlocal fails, left
        fails, left, proofs[:] = failing, error_left, []
        files = [launch, "--phases", *rests]
        return main(["check-funnel", *map(str, files), "--every", "1000", *arguments])

    return run


@pytest.mark.nightly
def test_the_command_line_checks_all_of_them(quick, tmp_path, capsys, rests):
    assert quick("--hook", "--latency", "0.01") == 0
    words = capsys.readouterr().out
    assert "10 to 30 ms after the launch" in words and "one of the 4 others" in words
    assert words.count("the hook accepts all of it") == 4
    assert "Proven" not in words
    assert quick("--json") == 0
    report = json.loads(capsys.readouterr().out)
    assert report["any_phase"]["holds"] and not report["any_phase"]["proven"]
    assert "end" not in report and "end" in report["phases"][0]
    assert quick(rests=RESTS[1:]) == 1
    assert "not of one loop at any phase" in capsys.readouterr().out
    assert quick("--latency", "0.02") == 1
    assert quick("--least-inlet", "0.13") == 1  # That of the launch: the others' is.
    settings = dataclasses.replace(rests[0].settings, goal=(0.2, 0.2, *[9.0] * 5))
    path = tmp_path / "wide.npz"
    save_funnel(path, dataclasses.replace(rests[0], settings=settings))
    assert quick("--hook", rests=[path, *RESTS[1:]]) == 1
    assert "the hook accepts" in capsys.readouterr().out


@pytest.mark.nightly
def test_all_of_them_are_proven_or_nothing_is(quick, monkeypatch, capsys):
    monkeypatch.setattr(check.Verdict, "is_whole", True)
    bounds = ["--hold", "0.02", "--wind", "0.02", "--latency", "0.01"]
    assert quick("--prove", "--json", *bounds) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["latency"]["holds"] and report["latency"]["error_left"] == 0.006
    assert report["latency"]["first_command_is_predicted"]
    assert report["loop"]["commands"] == "none"
    report = report["any_phase"]
    loop = report["loop"]
    assert (loop["commands"], loop["state"], loop["jitter_s"]) == ("held", "true", 0.0)
    assert (loop["period_s"], loop["set_level"]) == (0.02, 0.95)
    assert loop["latency_s"] == pytest.approx(0.01)
    assert loop["command_error_rad_s"] == 0.006
    assert report["proven"] and report["wind_m_s"] == 0.02
    assert report["command_error_rad_s"] == 0.006
    assert quick("--prove", *bounds) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "Proven for a clock of any phase, with a latency of exactly 10 ms" in said
    assert "by a predictor of the model's glider that knows every command sent" in said
    assert "The first command is computed from the state in which" not in said
    assert "loop without an estimator" in said and "by a clock without jitter" in said
    assert "with a command error of at most 0.006 rad/s" in said
    assert "Proven: commands may be computed 10 ms before they act" in said
    assert "every flight of every glider of their 95 % set that starts in" in said
    assert "in one of the others, each about its own center, and ends" in said
    assert "What the predictor misses of any glider of the set in the wind" in said
    for command_error, error_left in (("0.007", 0.006), ("0", -0.001)):
        asked = ("--prove", *bounds, "--command-error", command_error)
        assert quick(*asked, error_left=error_left) == 1
        said = capsys.readouterr().out
        assert "Not proven: a latency of 10 ms" in said and "Proven for" not in said
    for failing in (1, 3, 5):
        assert quick("--prove", failing=failing) == 1
        assert "Proven for a clock" not in capsys.readouterr().out
    assert quick("--prove", "--hold", "0.01") == 1
    assert quick("--prove", "--wind", "0.03") == 1
    assert "Proven" not in capsys.readouterr().out


@pytest.mark.parametrize("option", ["resume", "write-proof"])
def test_what_is_of_one_funnel_is_refused(quick, option, capsys):
    assert quick(f"--{option}", "file.json", "--prove") == 2
    assert f"--{option} is of one funnel" in capsys.readouterr().err


@pytest.mark.parametrize("shape", SHAPES)
def test_centers_of_a_set_take_their_part_of_the_inlet(launch, rests, shape):
    """At a time when a set has the inlet's shape and center, they alone decide."""
    allowed, own = allowed_by(10.0, shape), rests[2]
    for k in phase_intervals(launch, rests)[::3]:
        piece = among(launch, allowed).between(k, k + 1)
        times = np.repeat(piece.nominal.times[1:], 2)
        still = np.repeat(own.nominal.states[:1], 2, axis=0)
        shifts = np.repeat(piece.gliders.shifts[1:], 2, axis=0)
        gliders = dataclasses.replace(piece.gliders, shifts=shifts)
        moved = np.linalg.cholesky(own.S[0]).T @ shifts[0] @ allowed.factor
        reach = np.linalg.norm(moved, 2) * (np.sqrt(2.0) if shape == "box" else 1.0)
        outward = np.linalg.svd(moved)[2][0] if shape == "ellipsoid" else np.ones(2)
        for level, holds in (
            (LEVEL - 2.01 * reach, True),
            (LEVEL - 1.9 * reach, False),
        ):
            S = np.repeat(own.S[:1] / level, 2, axis=0)
            same = changed(piece, S=S, slopes=0.0 * S, states=still, times=times)
            same = dataclasses.replace(same, gliders=gliders)
            assert is_inside(same, own) == holds
            worst = (np.sqrt(level) + np.linalg.norm(moved @ outward)) ** 2
            assert worst <= LEVEL if holds else worst > LEVEL or shape == "box"


def test_phases_of_a_set_of_nothing_are_refused(quick, tmp_path, capsys):
    forge(FOLDER / "launch.npz", tmp_path / "launch.npz", HELD["a set of nothing"][0])
    model = str(models_path("identified", "head_wind.yaml"))
    assert quick("--model", model, launch=tmp_path / "launch.npz") == 1
    said = capsys.readouterr().out
    assert "ellipsoid of nothing, is smaller than the model's, the 95 % " in said


@pytest.mark.nightly
def test_phases_have_one_set_of_gliders(launch, rests):
    sets = [among(own, allowed_by()) for own in (scaled(launch, 0.9), *rests)]
    assert phase_faults(sets[0], sets[1:]) == []
    for others in (rests, [*sets[1:4], among(rests[3], allowed_by(0.5))]):
        [fault] = phase_faults(sets[0], others)
        assert "different sets of gliders; expected one" in fault


@pytest.mark.nightly
def test_gliders_of_phases_are_flown_by_the_clock_only(quick, capsys, monkeypatch):
    monkeypatch.setattr(as_flown, "CLIMB_ROUNDS", 0)
    asked = "--model", str(models_path("identified", "head_wind.yaml")), "--confidence"
    assert quick(*asked) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "of these funnels are held: expected --as-flown, too." in said
    asked += "--as-flown", "--flights", "20"
    assert quick(*asked, "--json") == 0
    report = json.loads(capsys.readouterr().out)
    assert "gliders" not in report and "wind.x" in report["as_flown"]["gliders"]
    assert quick(*asked) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert (
        "at any phase of their clock" in said and "gliders on the edge of the" in said
    )
    assert "0 of 20 flights" in said
