"""Sampled plans cost what their flights cost, and each update does what it says."""

import dataclasses

import numpy as np
import pytest

from glider.compiled.runge_kutta import BLOCK
from glider.control.mppi import SETTINGS, replanning_cost, sequence_of, shifted
from glider.errors import InputError
from glider.paths import models_path
from glider.physics.effects import GROUND_EFFECT, SERVO_LAG
from glider.physics.model import GliderModel
from glider.physics.parameters import load_parameters
from glider.physics.servo import STOPPING_TIME
from glider.planning.problem import PerchingProblem
from glider.planning.sampling import MppiSettings, SequenceCost, _mppi_update, mppi_step
from tests.helpers.flights import QUICK

ARTICLE = PerchingProblem.load(models_path("problems", "sampling.yaml"))
REPLANNING = PerchingProblem.load(models_path("problems", "replanning.yaml"))
LAUNCH = np.array(ARTICLE.launch)
HEAVY = GliderModel(parameters=load_parameters(models_path("vehicles", "heavy.yaml")))

LAGGING = GliderModel(
    effects=(SERVO_LAG(time_constant=0.03), GROUND_EFFECT(strength=0.2))
)
"""As in test_plant: what is compiled for one test serves the other."""


def article_cost(**options):
    return SequenceCost(HEAVY, ARTICLE, **options)


def draw(count, steps, scale=1.0, seed=0):
    return scale * np.random.default_rng(seed).standard_normal((count, steps))


def fly_by_hand(model, start, commands, step, order, limits):
    """Returns the states of one flight, (N + 1, n), by the formulas as they are."""
    chain, theta = model.chain, model.numbers

    def slope(x, u):
        return np.array(chain.derivatives(0.0, x, u, 0.0, 0.0, theta))

    states, x, elevator = [start], start, start[3]
    for command in commands:
        u = command
        if limits is not None:
            low, high, fastest = limits
            u = np.clip(u, -fastest, fastest)
            ahead = step + STOPPING_TIME  # A command that the servo follows.
            u = np.clip(u, (low - elevator) / ahead, (high - elevator) / ahead)
        elevator += step * u
        k1 = slope(x, u)
        if order == 1:
            x = x + step * k1
        else:
            k2 = slope(x + 0.5 * step * k1, u)
            k3 = slope(x + 0.5 * step * k2, u)
            k4 = slope(x + step * k3, u)
            x = x + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        states.append(x)
    return np.array(states)


def costs_by_hand(problem, states, commands, nominal, penalty, step, free_end):
    """Returns S_k by its definition: a sum for each k and each step to end at."""
    error = states[:, :7] - problem.goal
    final = np.sum(np.array(problem.goal_weights) * error**2, axis=1)
    stage = problem.rate_cost * step * commands**2
    stage = stage + penalty * (nominal * commands - 0.5 * nominal**2)
    last = len(commands)

    def best(k):
        ends = range(max(k, 1), last + 1) if free_end else [last]
        return min(np.sum(stage[k:end]) + final[end] for end in ends)

    return np.array([best(k) for k in range(last + 1)])


@pytest.mark.parametrize(
    ("model", "order", "within_limits", "free_end", "penalty"),
    [
        (HEAVY, 1, False, False, 0.0),
        (HEAVY, 4, True, True, 0.02),
        (LAGGING, 4, False, True, 0.0),
    ],
    ids=["article", "replanning", "another plant"],
)
def test_a_sequence_costs_what_its_flight_costs(
    model, order, within_limits, free_end, penalty
):
    """Against loops over the formulas, without compiled code."""
    steps, step = 60, 0.015
    cost = SequenceCost(
        model,
        ARTICLE,
        step=step,
        steps=steps,
        order=order,
        within_limits=within_limits,
        free_end=free_end,
    )
    parameters = model.parameters
    limits = (*parameters.elevator_limits, parameters.elevator_rate_limit)
    kept = limits if within_limits else None
    scale = 8.0 if within_limits else 1.5
    commands, nominal = draw(3, steps, scale), draw(1, steps, 2.0, seed=1)[0]
    # High up: below its ground, the ground effect knows no bounds.
    start = model.initial_state(LAUNCH + np.array([0, 4, 0, 0, 0, 0, 0]))
    to_go = cost.to_go(start, commands, nominal, penalty)
    states = cost.fly(start, commands)
    for u, x, s in zip(commands, states, to_go, strict=True):
        flown = fly_by_hand(model, start, u, step, order, kept)
        np.testing.assert_allclose(x, flown, rtol=1e-9, atol=1e-9)
        expected = costs_by_hand(ARTICLE, flown, u, nominal, penalty, step, free_end)
        np.testing.assert_allclose(s, expected, rtol=1e-8)
    if within_limits:  # They were at work.
        low, high, _ = limits
        assert np.max(np.abs(commands)) > 13.0
        assert low <= np.min(states[:, :, 3]) < low + 0.01
        assert low - 1e-12 <= np.min(states[:, :, 3])
        assert np.max(states[:, :, 3]) <= high + 1e-12


def test_a_batch_is_its_sequences_one_by_one():
    cost, commands = article_cost(), draw(BLOCK + 3, 75)
    many, paths = cost.to_go(LAUNCH, commands), cost.fly(LAUNCH, commands)
    assert len(np.unique(many[:, 0])) == len(commands)
    for k in (0, BLOCK - 1, BLOCK, BLOCK + 2):
        one = cost.to_go(LAUNCH, commands[[k]])[0]
        np.testing.assert_allclose(many[k], one, rtol=1e-12)
        np.testing.assert_allclose(
            paths[k], cost.fly(LAUNCH, commands[[k]])[0], rtol=1e-9, atol=1e-12
        )


# ------------------------------------------------------------------- the updates


def test_mppi_at_a_low_temperature_follows_the_best_of_each_step():
    mean, noise = np.array([1.0, 2.0]), np.array([[0.1, 0.2], [0.3, 0.4]])
    to_go = np.array([[5.0, 9.0], [7.0, 3.0]])
    np.testing.assert_allclose(_mppi_update(mean, noise, to_go, 1e-3), [1.1, 2.4])
    np.testing.assert_allclose(_mppi_update(mean, noise, to_go, 1e9), [1.2, 2.3])


def test_mppi_weighs_by_the_softmax():
    to_go = np.log([[4.0], [2.0]]) * 10.0
    new = _mppi_update(np.zeros(1), np.array([[3.0], [6.0]]), to_go, 10.0)
    assert new[0] == pytest.approx(3.0 / 3.0 + 6.0 * 2.0 / 3.0)


def test_mppi_looks_at_differences_of_costs_only():
    """Costs that would underflow give the same step, and a lost flight none."""
    mean, noise, to_go = np.zeros(4), draw(20, 4), draw(20, 4, seed=2)
    expected = _mppi_update(mean, noise, to_go, 0.5)
    np.testing.assert_allclose(
        _mppi_update(mean, noise, to_go + 1e6, 0.5), expected, rtol=1e-6
    )
    lost = np.vstack([to_go, np.full((2, 4), [[np.nan], [np.inf]])])
    far = np.vstack([noise, np.full((2, 4), 9.0)])
    np.testing.assert_allclose(_mppi_update(mean, far, lost, 0.5), expected)


def test_each_step_is_weighed_by_its_own_cost_to_go():
    """What a sequence has cost before a step does not count there."""
    dear = dataclasses.replace(ARTICLE, rate_cost=1e4)
    cost = SequenceCost(HEAVY, dear, steps=20)
    settings, mean = MppiSettings(), np.linspace(1.0, 2.0, 20)
    new, commands, _ = mppi_step(cost, LAUNCH, mean, np.random.default_rng(0), settings)
    to_go = cost.to_go(LAUNCH, commands[1:])[:, :-1]
    np.testing.assert_array_equal(commands[0], mean)
    np.testing.assert_allclose(
        new, _mppi_update(mean, commands[1:] - mean, to_go, settings.temperature)
    )


def test_the_likelihood_ratio_makes_commands_cost():
    """Where no state costs anything, one update brings the mean to zero.

    The tilted distribution exp(-u ε / σ²) N(ε; 0, σ²) has the mean -u.
    """
    free = PerchingProblem(rate_cost=0.0, goal_weights=[0.0] * 7)
    cost = SequenceCost(HEAVY, free, steps=3)
    mean, rng = np.array([0.5, -0.8, 0.3]), np.random.default_rng(0)
    settings = MppiSettings(
        samples=40_000, temperature=7.0, deviation=1.0, likelihood_ratio=True
    )
    new, _, costs = mppi_step(cost, LAUNCH, mean, rng, settings)
    np.testing.assert_allclose(new, 0.0, atol=0.03)
    assert costs[0] == pytest.approx(0.5 * 7.0 * np.sum(mean**2))
    plain = dataclasses.replace(settings, likelihood_ratio=False)
    new, _, _ = mppi_step(cost, LAUNCH, mean, rng, plain)
    np.testing.assert_allclose(new, mean, atol=0.03)


def test_a_plan_becomes_a_sequence(article_plan):
    sequence = sequence_of(article_plan, 0.02, 60)
    duration = article_plan.duration
    assert sequence[2] == pytest.approx(article_plan.input_trajectory.value(0.05)[0, 0])
    assert np.all(sequence[0.02 * (np.arange(60) + 0.5) > duration] == 0.0)
    assert np.all(sequence[:40] != 0.0)
    np.testing.assert_array_equal(shifted(np.array([1.0, 2.0, 3.0])), [2.0, 3.0, 0.0])


# ------------------------------------------------------------------ what is refused


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: MppiSettings(temperature=0.0), "'temperature' is 0.0"),
        (lambda: MppiSettings(deviation=np.nan), "'deviation' is nan"),
        (lambda: article_cost(step=0.0), "'step' is 0.0"),
        (lambda: article_cost(steps=0), "'steps' is 0"),
        (lambda: article_cost(order=2), "'order' is 2"),
        (lambda: article_cost().to_go(LAUNCH, np.zeros((2, 7))), r"\[2, 7\]"),
        (lambda: article_cost().to_go(LAUNCH[:6], np.zeros((2, 75))), r"\[6\]"),
    ],
)
def test_what_cannot_be_is_refused(make, words):
    with pytest.raises(InputError, match=words):
        make()


def test_a_sequence_costs_a_quick_servo_what_it_costs_none():
    """A traced model may hold a lag of half a millisecond, a command lasts twenty."""
    commands = draw(50, 40, 4.0)
    near, quick = (
        replanning_cost(model, REPLANNING).to_go(
            model.initial_state(LAUNCH), commands, draw(1, 40)[0], SETTINGS.penalty
        )
        for model in (GliderModel(), QUICK)
    )
    np.testing.assert_allclose(quick, near, rtol=0.1)
