"""Which launches can perch at all: a plan for each, as our own solver finds it."""

import dataclasses

import joblib
import numpy as np

from glider.errors import expect
from glider.physics.model import GliderModel
from glider.physics.state import NUM_STATES
from glider.planning.problem import PerchingProblem
from glider.planning.structured import slow_line, solve_from_guess
from glider.progress import Progress, silent

_KNOTS = 25
"""Knots of each plan."""

_CHUNK = 100
"""Number of launches that a worker gets at a time."""


def find_reach(
    model: GliderModel,
    problem: PerchingProblem,
    launches: np.ndarray,
    progress: Progress = silent,
) -> np.ndarray:
    """Plans from launches (B, 7), by the joblib workers that the caller has chosen.

    `progress` is called with how many are done.

    Returns:
        whether each launch has a plan to the wire, (B,).

    Raises:
        InputError: the launches are no states.
        UncompilableError: a formula is not of what numba compiles.
    """
    launches = np.asarray(launches, dtype=float)
    good = launches.ndim == 2 and launches.shape[1] == NUM_STATES and len(launches)
    expect(good, "find_reach: the launches' shape", launches.shape, "(B, 7)")
    parts = [launches[k : k + _CHUNK] for k in range(0, len(launches), _CHUNK)]
    tasks = (joblib.delayed(_have_plans)(model, problem, part) for part in parts)
    planned: list[bool] = []
    for part in joblib.Parallel(return_as="generator")(tasks):
        planned += part
        progress(f"launch {len(planned)} of {len(launches)}")
    return np.array(planned)


def _have_plans(
    model: GliderModel, problem: PerchingProblem, launches: np.ndarray
) -> list[bool]:
    planned = []
    for launch in launches.tolist():
        own = dataclasses.replace(problem, launch=launch)
        flight = solve_from_guess(model, own, _KNOTS, slow_line(model, own))
        planned.append(flight.solved)
    return planned
