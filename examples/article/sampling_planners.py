"""Planning without gradients: the cross-entropy method and MPPI.

Both draw command sequences, fly each through the compiled dynamics and move the mean
sequence (and for the cross-entropy method a variance) towards those that cost little.
"""

import dataclasses
import math
import time
from collections.abc import Callable

import numpy as np

from glider.errors import expect
from glider.physics.servo import rate_bounds
from glider.planning.plan import Plan
from glider.planning.sampling import MppiSettings, SequenceCost, mppi_step
from tapes import held_plan

Watch = Callable[[int, np.ndarray], None]
"""Callback of the number of an iteration, from 1, and the sequences (B, N) drawn in it
[rad/s]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class CemSettings:
    """Settings of the cross-entropy method; the defaults are the article's.

    Attributes:
        samples: sequences in an iteration.
        elites: the cheapest of them, which mean and variance are taken from.
        variance: variance of each command at the start [rad²/s²].
        variance_floor: least variance of each command [rad²/s²], so that the search
            goes on.
    """

    samples: int = 30
    elites: int = 10
    variance: float = 0.1
    variance_floor: float = 0.01

    def __post_init__(self):
        """Raises InputError where a setting cannot be."""
        for name, value in dataclasses.asdict(self).items():
            good = math.isfinite(value) and value > 0
            expect(good, f"CemSettings: '{name}'", value, "a positive number")
        good = 2 <= self.elites <= self.samples
        expect(good, "CemSettings: 'elites'", self.elites, f"2 to {self.samples}")


def cem_update(
    commands: np.ndarray, costs: np.ndarray, settings: CemSettings
) -> tuple[np.ndarray, np.ndarray]:
    """Returns mean and variance of the elites, each of shape (N,).

    Args:
        commands: (B, N) [rad/s].
        costs: (B,); what is not a number counts as the largest.
        settings: how many elites, and the floor of the variance.
    """
    elites = commands[np.argsort(costs)[: settings.elites]]  # NaN comes last.
    variance = np.var(elites, axis=0, ddof=1)
    return np.mean(elites, axis=0), np.maximum(variance, settings.variance_floor)


def cem(
    cost: SequenceCost,
    start: np.ndarray,
    rng: np.random.Generator,
    *,
    settings: CemSettings | None = None,
    iterations: int = 100,
    mean: np.ndarray | None = None,
    watch: Watch | None = None,
) -> Plan:
    """Plans by the cross-entropy method.

    Args:
        cost: of a sequence.
        start: (n,) state at launch.
        rng: draws the sequences.
        settings: None for the article's.
        iterations: their number.
        mean: (N,) to start from; None for zero [rad/s].
        watch: called with what is drawn.

    Returns:
        a plan with held commands, the last mean. Its costs are those of the mean before
        the first and after each iteration.
    """
    settings = CemSettings() if settings is None else settings
    variance = np.full(cost.steps, settings.variance)

    def improve(mean):
        nonlocal variance
        noise = rng.standard_normal((settings.samples, cost.steps))
        commands = np.vstack([mean, mean + np.sqrt(variance) * noise])
        total = cost.to_go(start, commands)[:, 0]
        mean, variance = cem_update(commands[1:], total[1:], settings)
        return mean, commands, total

    return _search(cost, start, improve, 0.0, iterations, mean, watch)


def mppi(
    cost: SequenceCost,
    start: np.ndarray,
    rng: np.random.Generator,
    *,
    settings: MppiSettings | None = None,
    iterations: int = 100,
    mean: np.ndarray | None = None,
    watch: Watch | None = None,
) -> Plan:
    """Plans by path integrals; arguments as in `cem`.

    With the likelihood ratio the costs of the result hold λ/(2σ²) Σ u², which is
    then part of what is minimized.
    """
    settings = MppiSettings() if settings is None else settings

    def improve(mean):
        return mppi_step(cost, start, mean, rng, settings)

    return _search(cost, start, improve, settings.penalty, iterations, mean, watch)


def _search(
    cost: SequenceCost,
    start: np.ndarray,
    improve: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]],
    penalty: float,
    iterations: int,
    mean: np.ndarray | None,
    watch: Watch | None,
) -> Plan:
    """Iterates `improve`, which returns what `mppi_step` does."""
    mean = np.zeros(cost.steps) if mean is None else np.array(mean, dtype=float)
    needed = f"({cost.steps},)"
    expect(mean.shape == (cost.steps,), "the shape of the mean", mean.shape, needed)
    expect(iterations >= 1, "the number of iterations", iterations, "at least 1")
    begin, costs = time.perf_counter(), np.empty(iterations + 1)
    for k in range(iterations):
        mean, commands, total = improve(mean)
        costs[k] = total[0]
        if watch:
            watch(k + 1, commands[1:])
    costs[-1] = cost.to_go(start, mean[None], mean, penalty)[0, 0]
    seconds = time.perf_counter() - begin
    return held_plan(
        cost.model,
        cost.step,
        cost.fly(start, mean[None])[0],
        within_limits(cost, start, mean),
        cost=float(costs[-1]),
        costs=tuple(costs.tolist()),
        search_seconds=seconds,
    )


def within_limits(
    cost: SequenceCost, start: np.ndarray, commands: np.ndarray
) -> np.ndarray:
    """Returns a sequence (N,) as the glider gets it, servo limits kept [rad/s]."""
    model = cost.model
    given = np.empty(len(commands))
    angle = model.chain.demanded_angle(start, model.numbers.c)
    for k, command in enumerate(commands):
        low, high = rate_bounds(angle, cost.servo, cost.step)
        given[k] = min(max(command, low), high)
        angle += given[k] * cost.step
    return given
