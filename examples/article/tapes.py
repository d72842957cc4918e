"""Plans of flights under tapes of commands, each held for a step."""

from typing import Any

import numpy as np

from glider.physics.model import GliderModel
from glider.planning.plan import Plan


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
