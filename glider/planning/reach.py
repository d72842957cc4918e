"""Which launches can perch at all: a plan for each, or how near to the wire it comes.

Where no planner finds a plan, the planner or the launch may be the reason. So a search
asks for a flight that keeps everything a plan has to keep except its place at the end,
which is only drawn to the wire: such a flight exists from everywhere. Each search is
local; if all of them, from guesses of many shapes, end at the same distance, there is
most probably no plan. That is evidence, not a proof.
"""

import dataclasses
import time

import joblib
import numpy as np

from glider.errors import expect
from glider.physics.model import GliderModel
from glider.planning.guess import straight_line, swoop
from glider.planning.problem import PerchingProblem
from glider.planning.structured import (
    CollocatedFlight,
    make_program,
    slow_line,
    solve_structured,
)
from glider.progress import Progress

KNOTS, TRIES = 25, 2
"""Knots of each plan, and searches for the closest flight where there is none."""

CHUNK = 100
"""Number of launches that a worker gets at a time."""

CLOSEST_TRIES = 40
"""Number of guesses."""

DIPS, STRETCHES = (-0.3, 0.8), (0.8, 1.8)
"""Depth of the guesses below a straight line [m], and their durations, relative to
it."""

PLACE_WEIGHT, RATE_COST = 1e4, 1e-3
"""Weight of the squared distance [1/m²] against that of the commands, which is there to
make the flight unique: it moves the end by less than 0.1 mm."""

REACHED = 1e-3
"""Distance within which the wire counts as reached [m]."""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Closest:
    """Flights that end as near to the wire as they can."""

    tries: int  #: Number of guesses.
    misses: np.ndarray  #: Distances of those that were found, in rising order [m].
    flight: CollocatedFlight | None  #: The nearest, None where none was found.

    @property
    def agreeing(self) -> int:
        """Number of flights that end as near as the nearest, to 1 %."""
        least = self.misses[:1]
        return int(np.sum(self.misses <= 1.01 * least)) if len(least) else 0

    @property
    def is_out_of_reach(self) -> bool:
        """Whether most were found and none of them comes to the wire."""
        found = 2 * len(self.misses) > self.tries
        return found and bool(self.misses[0] > REACHED)

    def describe(self) -> str:
        """Describes the search's result, as part of a sentence."""
        return (
            f"of {self.tries} searches for the nearest flight that keeps all other "
            f"limits, {len(self.misses)} end, {self.agreeing} of them "
            f"{1e3 * self.misses[0]:.1f} mm from the wire and none nearer"
        )


def find_closest(
    model: GliderModel, problem: PerchingProblem, knots: int, tries: int = CLOSEST_TRIES
) -> Closest:
    """Searches from `tries` guesses for the flight that ends nearest to the wire.

    All limits of the problem hold but the place at the end; guesses do not vary.

    Raises:
        UncompilableError: a formula is not of what numba compiles.
    """
    rng, n = np.random.default_rng(0), model.num_states
    soft = dataclasses.replace(problem, rate_cost=RATE_COST)
    program = make_program(model, soft, knots)._replace(
        is_held=False,
        goal=np.append(problem.wire, np.zeros(n - 2)),
        goal_weights=np.append([PLACE_WEIGHT] * 2, np.zeros(n - 2)),
    )
    line = straight_line(model, problem).states.end_time()
    found: list[tuple[float, CollocatedFlight]] = []
    for _ in range(tries):
        dip, duration = rng.uniform(*DIPS), line * rng.uniform(*STRETCHES)
        flight = solve_structured(
            model,
            problem,
            knots,
            swoop(model, problem, dip, duration),
            program=program,
            tolerance=1e-5,
            name="the flight that comes closest",
        )
        if flight.solved:
            end = flight.knots[-1, :2] - np.array(problem.wire)
            found.append((float(np.hypot(*end)), flight))
    found.sort(key=lambda pair: pair[0])
    return Closest(
        tries=tries,
        misses=np.array([miss for miss, _ in found]),
        flight=found[0][1] if found else None,
    )


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Reach:
    """Launches, and whether each has a plan."""

    launches: np.ndarray  #: (B, 7).
    planned: np.ndarray  #: (B,) whether there is a plan.
    #: (B,) how far from the wire the nearest flight ends that keeps all other limits
    #: [m]: 0 with a plan, NaN where no flight keeps them.
    misses: np.ndarray
    seconds: float  #: Time that it took [s].

    def describe(self) -> str:
        """Describes the number that can perch, and the median miss of the others."""
        count, short = len(self.planned), self.misses[self.misses > 0.0]
        text = (
            f"{np.sum(self.planned):,} of {count:,} launches have a plan to the wire "
            f"({self.seconds:.0f} s, {1e3 * self.seconds / count:.1f} ms each)."
        )
        if not len(short):
            return text
        return (
            f"{text} Of the others the median can come within {np.median(short):.2f} m."
        )

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
    progress: Progress | None = None,
) -> Reach:
    """Plans from launches (B, 7), by the joblib workers that the caller has chosen.

    `progress` is called with how many are done.

    Raises:
        InputError: the launches are no states.
        UncompilableError: a formula is not of what numba compiles.
    """
    launches, begin = np.asarray(launches, dtype=float), time.perf_counter()
    good = launches.ndim == 2 and launches.shape[1] == 7 and len(launches)
    expect(good, "find_reach: the launches' shape", launches.shape, "(B, 7)")
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
    each = (dataclasses.replace(problem, launch=own) for own in launches.tolist())
    return [find_one(model, own) for own in each]


def find_one(model: GliderModel, problem: PerchingProblem) -> tuple[bool, float]:
    """Plans from one launch: whether there is a plan, and the least miss."""
    line = slow_line(model, problem)
    if solve_structured(model, problem, KNOTS, line).solved:
        return True, 0.0
    closest = find_closest(model, problem, KNOTS, TRIES)
    if closest.flight is None:
        return False, np.nan
    if closest.misses[0] > REACHED:
        return False, float(closest.misses[0])
    again = solve_structured(model, problem, KNOTS, closest.flight)
    return again.solved, 0.0 if again.solved else float(closest.misses[0])
