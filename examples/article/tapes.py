"""Flights under tapes of commands, each held for a step, and plans of them."""

from typing import Any

import numpy as np

from glider.compiled.rollouts import LOOPS
from glider.physics.model import GliderModel
from glider.planning.plan import Plan


def fly_tapes(
    model: GliderModel,
    starts: np.ndarray,
    commands: np.ndarray,
    step: float,
    *,
    order: int = 4,
) -> np.ndarray:
    """Computes states (B, N + 1, n) of a glider under command tapes in still air.

    Args:
        model: the glider.
        starts: (B, n) states at launch.
        commands: (B, N) elevator-rate commands, each held for a step [rad/s].
        step: [s].
        order: 1 for explicit Euler, 4 for classical Runge-Kutta; a step is divided
            where the effects' own states ask for it.
    """
    states = np.empty((len(commands), commands.shape[1] + 1, starts.shape[1]))
    LOOPS.over(model.kinds).rollouts(
        np.ascontiguousarray(starts, dtype=float),
        np.ascontiguousarray(commands, dtype=float),
        step,
        order,
        model.count_laps(step, order),
        model.numbers,
        states,
    )
    return states


def held_plan(
    model: GliderModel, step: float, states: np.ndarray, inputs: np.ndarray, **more: Any
) -> Plan:
    """The plan of a flight, states (N, n), under commands (N - 1,) [rad/s].

    Each is held for a step [s]; `more` are further fields of the plan.
    """
    times, applied = step * np.arange(len(states)), np.append(inputs, 0.0)
    rates = model.chain.derivatives(times, states.T, applied, 0.0, 0.0, model.numbers)
    slopes = np.stack([np.broadcast_to(r, len(states)) for r in rates], axis=1)
    return Plan(
        times=times,
        states=states,
        slopes=slopes,
        inputs=inputs,
        state_names=model.state_names,
        **more,
    )
