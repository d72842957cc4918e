"""Which launches can perch at all: a plan for each, or how near it comes."""

import dataclasses
import time
from collections.abc import Callable

import joblib
import numpy as np

from glider.errors import InputError
from glider.physics.model import GliderModel
from glider.planning.closest import REACHED, find_closest
from glider.planning.guess import straight_line
from glider.planning.problem import PerchingProblem
from glider.planning.structured import solve_structured

KNOTS = 25
"""Number of knots of each plan."""

STRETCH = 1.4
"""Duration of the straight line that each plan starts from, as in `planning.dircol`."""

TRIES = 2
"""Number of searches for the closest flight where there is no plan at once."""

CHUNK = 100
"""Number of launches that a worker gets at a time."""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Reach:
    """Launches, and what can become of them."""

    launches: np.ndarray
    """(B, 7)."""

    planned: np.ndarray
    """(B,) whether there is a plan."""

    misses: np.ndarray
    """(B,) how far from the wire the nearest flight ends that keeps all other limits
    [m]: 0 with a plan, NaN where no flight keeps them."""

    seconds: float
    """Time that it took [s]."""

    def describe(self) -> str:
        """Returns how many can perch, and what the others miss by."""
        count, short = len(self.planned), self.misses[self.misses > 0.0]
        text = (
            f"{np.sum(self.planned):,} of {count:,} launches have a plan to the wire "
            f"({self.seconds:.0f} s, {1e3 * self.seconds / count:.1f} ms each)."
        )
        if len(short):
            text += (
                f" Of the others the median can come within {np.median(short):.2f} m."
            )
        return text

    def key_figures(self) -> dict[str, object]:
        """Returns launches and answers, for a file; a miss that is NaN as None."""
        return {
            "launches": self.launches.tolist(),
            "planned": self.planned.tolist(),
            "miss_m": [m if np.isfinite(m) else None for m in self.misses.tolist()],
            "seconds": self.seconds,
        }


def find_reach(
    model: GliderModel,
    problem: PerchingProblem,
    launches: np.ndarray,
    progress: Callable[[str], None] | None = None,
) -> Reach:
    """Plans from many launches, by the workers of joblib that the caller has chosen.

    Args:
        model: the glider.
        problem: whose launch is replaced.
        launches: (B, 7).
        progress: told how many are done.

    Raises:
        InputError: the launches are no states.
        UncompilableError: a formula is not of what numba compiles.
    """
    launches, begin = np.asarray(launches, dtype=float), time.perf_counter()
    if launches.ndim != 2 or launches.shape[1] != 7 or not len(launches):
        raise InputError(
            f"find_reach: the launches have shape {launches.shape}; (B, 7) is needed."
        )
    parts = [launches[k : k + CHUNK] for k in range(0, len(launches), CHUNK)]
    tasks = (joblib.delayed(_reach_of)(model, problem, part) for part in parts)
    found: list[tuple[bool, float]] = []
    for part in joblib.Parallel(return_as="generator")(tasks):
        found += part
        if progress:
            progress(f"launch {len(found)} of {len(launches)}")
    return Reach(
        launches=launches,
        planned=np.array([planned for planned, _ in found]),
        misses=np.array([miss for _, miss in found]),
        seconds=time.perf_counter() - begin,
    )


def _reach_of(
    model: GliderModel, problem: PerchingProblem, launches: np.ndarray
) -> list[tuple[bool, float]]:
    return [
        find_one(model, dataclasses.replace(problem, launch=launch.tolist()))
        for launch in launches
    ]


def find_one(model: GliderModel, problem: PerchingProblem) -> tuple[bool, float]:
    """Returns whether there is a plan, and the least miss, as `Reach` has them."""
    way = straight_line(model, problem).states.end_time()
    line = straight_line(model, problem, STRETCH * way)
    if solve_structured(model, problem, KNOTS, line).solved:
        return True, 0.0
    closest = find_closest(model, problem, KNOTS, TRIES)
    if closest.flight is None:
        return False, np.nan
    if closest.misses[0] > REACHED:
        return False, float(closest.misses[0])
    again = solve_structured(model, problem, KNOTS, closest.flight)
    return again.solved, 0.0 if again.solved else float(closest.misses[0])
