"""Lesson 10: plan without gradients, by CEM and by a minimal MPPI.

The article's section "Without gradients". Both improve one sequence of 75 commands,
held for 0.01 s each, from a fixed launch. An iteration draws 30 sequences about it,
flies them by Euler steps and weighs them by their cost

    S_k = Σ_{i >= k} 0.1 u_i² h + (x_N - x_g)ᵀ Q_f (x_N - x_g)

CEM takes mean and variance of the 10 cheapest, with a floor (the unbiased variance, as
the article's code does; its text has the likeliest one). MPPI moves the mean by
all, weighted at each step by a softmax of the cost from there on,

    u_k ← u_k + Σ_r w_k^r ε_k^r,   w_k^r = exp(-S_k^r / λ) / Σ_s exp(-S_k^s / λ).

It is a search offline, not control: nothing is measured. The library's `MppiController`
adds the likelihood ratio and plans again 50 times a second (`examples/replan.py`).

    python examples/article/sampling_planners.py --figure sampling_planners.png
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from course import (
    SHOWN,
    compare,
    draw_wire,
    legend_beside,
    picture,
    rates_of,
    read_options,
    start,
)
from diagrams import open_loop, simulate_flights
from glider import GliderModel, PerchingProblem, Plan
from glider.paths import models_path
from glider.physics.parameters import load_parameters
from glider.planning.sampling import SequenceCost
from glider.report.plots.style import BLUE, RED
from glider.simulation.flown_flights import FlownFlight

ARTICLE = {
    "MPPI: sampled rollouts": SHOWN,
    "MPPI: replay of the sequence that it found": SHOWN,
    "CEM: sampled rollouts": SHOWN,
    "CEM: replay of the sequence that it found": SHOWN,
    "Cost histories of both": SHOWN,
    "MPPI: cost after 30 and 100 iterations": "22..25, 13.2..14.9 (run again)",
    "CEM: cost after 30 and 100 iterations": "163..270, 11.4..13.8 (run again)",
    "Miss of seed 0, replayed with limits of the servo": "-",
}
"""Costs are those of the article's algorithms, run again from three seeds; ours are
medians of SEEDS."""

ITERATIONS = 100
SAMPLES = 30
SEEDS = 20

ELITES = 10
FIRST_VARIANCE = 0.1  # Of each command [rad²/s²].
LEAST_VARIANCE = 0.01

TEMPERATURE = 10.0  # λ
DEVIATION = np.sqrt(0.1)  # Of each command [rad/s].

SHOWN_ITERATIONS = (0, 9, 29, 99)


class Search(NamedTuple):
    """What a search did."""

    commands: np.ndarray  #: (N,) that it found [rad/s].
    costs: np.ndarray  #: (iterations + 1,) of the mean before and after each.
    drawn: list[np.ndarray]  #: (SAMPLES, N) sequences of each iteration.


def article_cost() -> SequenceCost:
    """Returns the cost of a sequence: heavy glider, 75 Euler steps, no servo limits."""
    parameters = load_parameters(models_path("vehicles", "heavy.yaml"))
    problem = PerchingProblem.load("sampling")
    return SequenceCost(GliderModel(parameters=parameters), problem)


LAUNCH = np.array(PerchingProblem().launch)


def cem(cost: SequenceCost, rng: np.random.Generator) -> Search:
    """Searches by the cross-entropy method."""
    mean, variance = np.zeros(cost.steps), np.full(cost.steps, FIRST_VARIANCE)
    costs, drawn = [], []
    for _ in range(ITERATIONS):
        noise = rng.standard_normal((SAMPLES, cost.steps))
        commands = mean + np.sqrt(variance) * noise
        costs.append(cost.to_go(LAUNCH, mean[None])[0, 0])
        total = cost.to_go(LAUNCH, commands)[:, 0]
        elites = commands[np.argsort(total)[:ELITES]]
        mean = np.mean(elites, axis=0)
        variance = np.maximum(np.var(elites, axis=0, ddof=1), LEAST_VARIANCE)
        drawn.append(commands)
    costs.append(cost.to_go(LAUNCH, mean[None])[0, 0])
    return Search(mean, np.array(costs), drawn)


def mppi(cost: SequenceCost, rng: np.random.Generator) -> Search:
    """Searches by path integrals."""
    mean = np.zeros(cost.steps)
    costs, drawn = [], []
    for _ in range(ITERATIONS):
        noise = DEVIATION * rng.standard_normal((SAMPLES, cost.steps))
        costs.append(cost.to_go(LAUNCH, mean[None])[0, 0])
        to_go = cost.to_go(LAUNCH, mean + noise)[:, :-1]
        # The least cost of a step cancels; without it all weights may underflow.
        weights = np.exp((np.min(to_go, axis=0) - to_go) / TEMPERATURE)
        drawn.append(mean + noise)
        mean = mean + np.sum(weights * noise, axis=0) / np.sum(weights, axis=0)
    costs.append(cost.to_go(LAUNCH, mean[None])[0, 0])
    return Search(mean, np.array(costs), drawn)


def held_plan(
    model: GliderModel, step: float, states: np.ndarray, commands: np.ndarray, **more
) -> Plan:
    """Returns the flight of a sequence as a plan, which the library flies and draws.

    Args:
        model: the glider.
        step: that each command is held [s].
        states: (N + 1, n) of the flight.
        commands: (N,) [rad/s].
        more: further fields of the plan.
    """
    times = step * np.arange(len(states))
    given = np.append(commands, 0.0)
    return Plan(
        times=times,
        states=states,
        slopes=rates_of(model, states.T, given).T,
        inputs=commands,
        state_names=model.state_names,
        **more,
    )


def main(arguments: Sequence[str] | None = None) -> dict[str, str]:
    """Searches from many seeds by both methods."""
    path = read_options(__doc__, arguments)
    cost = article_cost()
    found = {"MPPI": search_all(cost, mppi), "CEM": search_all(cost, cem)}
    told = []
    for searches in found.values():
        costs = np.array([search.costs for search in searches])
        early, last = np.median(costs[:, [30, 100]], axis=0)
        told.append(f"{early:.0f}, {last:.1f}")
    replays = {name: replay(cost, first) for name, (first, *_) in found.items()}
    misses = [f"{1000 * flight.miss:.0f} mm" for flight in replays.values()]
    if path:
        draw(path, cost, found, replays)
    return compare(ARTICLE, *[SHOWN] * 5, *told, ", ".join(misses))


def replay(cost: SequenceCost, search: Search) -> FlownFlight:
    """Flies the commands that were found in Drake, where a servo keeps its limits."""
    [states] = cost.fly(LAUNCH, search.commands[None])
    total = float(search.costs[-1])
    planned = held_plan(cost.model, cost.step, states, search.commands, cost=total)
    diagram = open_loop(cost.model, planned)
    [flight] = simulate_flights(diagram, LAUNCH, planned.duration)
    return flight


def search_all(
    cost: SequenceCost, method: Callable[[SequenceCost, np.random.Generator], Search]
) -> list[Search]:
    """Searches from each seed."""
    return [method(cost, np.random.default_rng(seed)) for seed in range(SEEDS)]


def draw(
    path: Path,
    cost: SequenceCost,
    found: dict[str, list[Search]],
    replays: dict[str, FlownFlight],
) -> None:
    """Draws what the first searches drew and found, and the costs of all."""
    with picture(path, 9.0, 6.4) as figure:
        first, second, costs = figure.subplot_mosaic("AB;CC").values()
        for ax, (name, (search, *_)) in zip(
            (first, second), found.items(), strict=True
        ):
            for k, shade in zip(SHOWN_ITERATIONS, (0.85, 0.65, 0.45, 0.0), strict=True):
                for j, flown in enumerate(cost.fly(LAUNCH, search.drawn[k])):
                    label = f"iteration {k + 1}" if j == 0 else None
                    color = (shade, shade, 1.0 - 0.3 * shade)
                    ax.plot(*flown[:, :2].T, color=color, lw=0.5, label=label)
            replayed = replays[name].states[:, :2]
            ax.plot(*replayed.T, color=RED, lw=1.8, label="found, replayed")
            draw_wire(ax)
            ax.set_title(name, loc="left")
            ax.legend()
        for (name, searches), color in zip(found.items(), (BLUE, RED), strict=True):
            runs = np.array([search.costs for search in searches])
            low, high = np.min(runs, axis=0), np.max(runs, axis=0)
            costs.fill_between(range(len(low)), low, high, color=color, alpha=0.2, lw=0)
            costs.plot(np.median(runs, axis=0), color=color, label=name)
        costs.set(xlabel="iteration", ylabel="cost of the mean", yscale="log")
        legend_beside(costs)


if __name__ == "__main__":
    start(main)
