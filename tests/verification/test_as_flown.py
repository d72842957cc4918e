"""Flights of the loop as it is flown: held and late commands, wind, any phase."""

import dataclasses
import json

import numpy as np
import pytest

from glider.__main__ import main
from glider.control.predictor import Hold
from glider.errors import InputError
from glider.paths import models_path
from glider.physics.effects import WIND
from glider.physics.model import GliderModel
from glider.simulation.fly import fly
from glider.verification import trials
from glider.verification.funnel.funnel import funnel_policy, load_funnel
from glider.verification.trials import (
    ESCAPE_LEVEL,
    FlownLoop,
    boundary_states,
    falsify_funnel,
)
from tests.helpers.funnels import UNPROVEN
from tests.verification.points import flown_by, sphere_points

COUNT = 60


def flown(funnel, genes, wind=0.0, **hold):
    loop = FlownLoop(hold=Hold(**hold), wind=wind)
    return flown_by(funnel, loop, genes)


def genes_of(phase=0.0, wind=(1.0, 0.0), steady=1.0, count=COUNT):
    rest = np.tile([*wind, phase, steady], (count, 1))
    return np.hstack([sphere_points(count, 7), rest])


def test_held_commands_are_those_of_the_compiled_loop(proven):
    """Without latency and with the clock started at launch: another integrator."""
    genes = genes_of()
    levels, later, ends = flown(proven, genes, period=0.02)
    policy, times = funnel_policy(proven), proven.nominal.times
    states = boundary_states(proven, 0, genes[:, :7])
    paths = fly(
        proven.nominal.model,
        policy,
        states,
        command_rate=50.0,
        step=0.002,
        after=0.0,
        keep_paths=True,
    )
    inside = paths.times <= times[-1]
    V = proven.level(paths.times[inside], paths.paths[:, inside])
    acts = paths.times[inside] > 1e-9
    assert later == pytest.approx(V[:, acts].max(axis=1), rel=0.03)
    assert levels == pytest.approx(np.maximum(V.max(axis=1), 1.0), rel=0.01)
    assert ends == pytest.approx(V[:, -1], rel=0.15, abs=2e-3)


def test_a_short_hold_is_the_loop_of_the_theorem(proven):
    levels, later, ends = flown(proven, genes_of(phase=0.5), period=0.002)
    assert np.all(levels <= 1.0) and np.all(later < 1.0)
    assert np.all(ends < 0.1)


def test_a_latency_is_one_of_the_commands(proven):
    """With a hold as short, the command of the state a latency ago."""
    late = flown(proven, genes_of(), period=0.004, latency=0.02)[2]
    also = flown(proven, genes_of(), period=0.002, latency=0.021)[2]
    early = flown(proven, genes_of(), period=0.004)[2]
    assert np.median(np.abs(late - also)) < 0.1 * np.median(np.abs(late - early))


def test_a_steady_wind_is_the_effect_of_that_name(proven):
    model = proven.nominal.model
    windy = dataclasses.replace(model, effects=(WIND(x=-0.2, z=0.1),))
    wind = np.hypot(0.2, 0.1)
    genes = genes_of(wind=(-0.2 / wind, 0.1 / wind))
    levels, _, ends = flown(proven, genes, wind=wind, period=0.02, latency=0.01)
    nominal = dataclasses.replace(proven.nominal, model=windy)
    # Slopes of the nominal are those of the model: kept as they were.
    nominal.__dict__["slopes"] = proven.nominal.slopes
    other = dataclasses.replace(proven, nominal=nominal)
    found, _, found_ends = flown(other, genes, period=0.02, latency=0.01)
    assert found == pytest.approx(levels, rel=1e-9)
    assert found_ends == pytest.approx(ends, rel=1e-9)
    assert np.median(ends / flown(proven, genes, period=0.02, latency=0.01)[2]) > 2.0


def test_a_wind_that_chooses_is_worse_than_most_steady_ones(proven):
    rng = np.random.default_rng(1)
    genes = genes_of(steady=0.0, count=300)
    genes[:, 7:9] = rng.normal(size=(300, 2))
    genes[:, 7:9] /= np.linalg.norm(genes[:, 7:9], axis=1, keepdims=True)
    chosen = flown(proven, genes, wind=0.05, period=0.005)[1]
    genes[:, 10] = 1.0
    steady = flown(proven, genes, wind=0.05, period=0.005)[1]
    assert np.mean(chosen >= steady) > 0.8


def test_an_error_of_the_command_is_one_of_the_servos_rate(proven):
    """A steady one is as if u₀ had it; the one that chooses is worse than most."""
    genes = genes_of(wind=(1.0, 0.0))
    found = [
        flown_by(proven, FlownLoop(hold=Hold(period=0.005), **error), genes)
        for error in ({"command_error": 0.8}, {})
    ]
    moved = dataclasses.replace(proven.nominal, inputs=proven.nominal.inputs + 0.8)
    moved.__dict__["slopes"] = proven.nominal.slopes
    other = dataclasses.replace(proven, nominal=moved)
    same = flown(other, genes, period=0.005)
    assert found[0][0] == pytest.approx(same[0], rel=1e-9)
    assert found[0][2] == pytest.approx(same[2], rel=1e-9)
    assert np.median(found[0][2] / found[1][2]) > 1.5
    genes[:, 10] = 0.0
    loop = FlownLoop(hold=Hold(period=0.005), command_error=0.8)
    chosen = flown_by(proven, loop, genes)[1]
    assert np.mean(chosen >= found[0][1]) > 0.8


@pytest.fixture(scope="module")
def hook():
    return load_funnel(models_path("funnels", "drawn_hook.npz"))


def test_what_the_review_saw_is_seen_and_a_predictor_makes_up_for_it(hook):
    """Holds of 20 ms and a delay of 10 or 20 ms: a quarter and most of them leave."""
    genes = genes_of(count=100)
    genes[:, 9] = np.random.default_rng(0).uniform(size=100)
    share = {
        (latency, predicts): np.mean(
            flown(hook, genes, period=0.02, latency=latency, predicts=predicts)[0]
            > ESCAPE_LEVEL
        )
        for latency in (0.01, 0.02)
        for predicts in (False, True)
    }
    assert 0.2 < share[0.01, False] < 0.5
    assert share[0.02, False] > 0.6
    assert share[0.01, True] == 0.0
    assert share[0.02, True] < 0.02


def test_an_outcome_counts_what_it_has_and_the_seed_repeats_it(proven, monkeypatch):
    monkeypatch.setattr(trials, "_CLIMB_ROUNDS", 2)
    seen = []
    loop = FlownLoop(hold=Hold(latency=0.02))
    trial, again = (
        falsify_funnel(proven, 50, np.random.default_rng(0), loop, progress=seen.append)
        for _ in "ab"
    )
    np.testing.assert_array_equal(trial.levels, again.levels)
    left = ~(trial.levels <= ESCAPE_LEVEL)
    assert trial.escapes == left.sum() > 0
    assert trial.astray == np.sum(trial.ends > ESCAPE_LEVEL)
    assert trial.climbed.sum() == 2 * 5 * 2 == len(left) - 50
    assert np.all((trial.phases >= 0.0) & (trial.phases <= 0.02))
    assert proven.level(0.0, trial.states) == pytest.approx(np.ones(len(left)))
    assert len(seen) == 2 * 3


def test_climbing_finds_worse_than_chance(proven):
    loop = FlownLoop(hold=Hold(latency=0.01))
    trial = falsify_funnel(proven, 100, np.random.default_rng(0), loop)
    rest = trial.later[trial.climbed].max() - trial.later[~trial.climbed].max()
    assert rest > 0.05


def test_flights_that_diverge_leave(proven):
    wild = dataclasses.replace(
        proven,
        nominal=dataclasses.replace(proven.nominal, gains=-9.0 * proven.nominal.gains),
    )
    levels, _, ends = flown(wild, genes_of(), period=0.1)
    assert np.all(levels > 1.0)
    assert not np.any(np.isnan(levels)) and not np.any(np.isnan(ends))


@pytest.mark.nightly
def test_the_command_line_states_how_many_leave(capsys):
    file = str(models_path("funnels", "drawn_hook.npz"))
    few = ["check-funnel", file, "--every", "1000", "--as-flown", "--flights", "25"]
    assert main(few) == 1
    words = capsys.readouterr().out
    assert (
        "commands held for 20 ms, each computed from the state 10 ms before, at"
        in words
    )
    assert "55 flights from the inlet's boundary leave the funnel and 0 end" in words
    assert " 0 of 55" not in words
    assert main([*few, "--predict", "--wind", "0.01", "--json", "--seed", "2"]) == 0
    found = json.loads(capsys.readouterr().out)["flights"]
    assert (found["period_s"], found["latency_s"], found["predicts"]) == (
        0.02,
        0.01,
        True,
    )
    assert (found["wind_m_s"], found["seed"]) == (0.01, 2)
    assert found["escapes"] == 0 and found["flights"] == 55
    for wrong, said in (
        (["--hold", "nan"], "the period of commands is nan"),
        (["--wind", "-1"], "the wind is -1.0"),
    ):
        assert main([*few, *wrong]) == 2
        assert said in capsys.readouterr().err
    for option in (["--hold", "0.01"], ["--predict"], ["--flights", "9"]):
        assert main(["check-funnel", file, *option]) == 2
        assert "has no effect without" in capsys.readouterr().err


@pytest.mark.parametrize("wind", [-0.1, np.nan, 1e9])
def test_a_wind_out_of_range_is_refused(wind):
    with pytest.raises(InputError, match="the wind is"):
        FlownLoop(hold=Hold(), wind=wind)


@pytest.mark.parametrize("error", [-0.1, np.nan, 1e9])
def test_a_command_error_out_of_range_is_refused(error):
    with pytest.raises(InputError, match="the command error is"):
        FlownLoop(hold=Hold(), command_error=error)


@pytest.mark.nightly
def test_a_glider_with_states_of_its_own_is_flown(proven):
    """The servo's lag is one of them."""
    slow = load_funnel(UNPROVEN / "strong_servo.npz")
    assert slow.nominal.model != GliderModel()
    trial = falsify_funnel(
        slow, 20, np.random.default_rng(0), FlownLoop(hold=Hold(period=0.005))
    )
    assert np.all(np.isfinite(trial.levels))
