"""Which launches can perch at all: a plan for each, as our own solver finds it."""

import dataclasses
import time

import joblib
import numpy as np

from glider.errors import expect
from glider.physics.model import GliderModel
from glider.physics.state import NUM_STATES
from glider.planning.problem import PerchingProblem
from glider.planning.structured import slow_line, solve_from_guess
from glider.progress import Progress

_KNOTS = 25
"""Knots of each plan."""

_CHUNK = 100
"""Number of launches that a worker gets at a time."""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Reach:
    """Launches, and whether each has a plan."""

    launches: np.ndarray  #: (B, 7).
    planned: np.ndarray  #: (B,) whether there is a plan.
    seconds: float  #: Time that it took [s].

    def describe(self) -> str:
        """Describes the number that can perch."""
        count = len(self.planned)
        return (
            f"{np.sum(self.planned):,} of {count:,} launches have a plan to the wire "
            f"({self.seconds:.0f} s, {1e3 * self.seconds / count:.1f} ms each)."
        )

    def key_figures(self) -> dict[str, object]:
        """Returns launches and answers, for a file."""
        return {
            "launches": self.launches.tolist(),
            "planned": self.planned.tolist(),
            "seconds": self.seconds,
        }


def find_reach(
    model: GliderModel,
    problem: PerchingProblem,
    launches: np.ndarray,
    progress: Progress | None = None,
) -> Reach:
    """Plans from launches (B, 7), by the joblib workers that the caller has chosen.

    `progress` is called with how many are done.

    Raises:
        InputError: the launches are no states.
        UncompilableError: a formula is not of what numba compiles.
    """
    begin = time.perf_counter()
    launches = np.asarray(launches, dtype=float)
    good = launches.ndim == 2 and launches.shape[1] == NUM_STATES and len(launches)
    expect(good, "find_reach: the launches' shape", launches.shape, "(B, 7)")
    parts = [launches[k : k + _CHUNK] for k in range(0, len(launches), _CHUNK)]
    tasks = (joblib.delayed(_reach_of)(model, problem, part) for part in parts)
    planned: list[bool] = []
    for part in joblib.Parallel(return_as="generator")(tasks):
        planned += part
        if progress:
            progress(f"launch {len(planned)} of {len(launches)}")
    return Reach(
        launches=launches,
        planned=np.array(planned),
        seconds=time.perf_counter() - begin,
    )


def _reach_of(
    model: GliderModel, problem: PerchingProblem, launches: np.ndarray
) -> list[bool]:
    planned = []
    for launch in launches.tolist():
        own = dataclasses.replace(problem, launch=launch)
        flight = solve_from_guess(model, own, _KNOTS, slow_line(model, own))
        planned.append(flight.solved)
    return planned
