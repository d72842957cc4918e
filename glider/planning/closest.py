"""How near to the wire a glider can come at all: a search from many guesses.

Where no planner finds a plan, that may be the planner's fault or the launch's. So all
is asked of a flight that a plan has to keep, but its place at the end, which is drawn
to the wire: there is such a flight from everywhere. Each search is local; if all, from
guesses of many shapes, end at the same distance, there is most probably no plan. That
is evidence, not a proof.
"""

import dataclasses
import time

import numpy as np

from glider.compiled.interior_point import Limits, optimize
from glider.physics.model import GliderModel
from glider.planning.guess import straight_line, swoop
from glider.planning.problem import PerchingProblem
from glider.planning.structured import (
    COLD_BARRIER,
    CollocatedFlight,
    make_program,
    to_flight,
    to_optimum,
)

TRIES = 40
"""Number of guesses."""

DIPS, STRETCHES = (-0.3, 0.8), (0.8, 1.8)
"""Depth of the guesses below a straight line [m], and their durations, relative to
it."""

PLACE_WEIGHT, RATE_COST = 1e4, 1e-3
"""Weight of the squared distance [1/m²] against that of the commands, which is there to
make the flight unique: it moves the end by less than 0.1 mm."""

REACHED = 1e-3
"""Distance within which nobody is said to miss the wire [m]."""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Closest:
    """Flights that end as near to the wire as they can."""

    tries: int
    """Number of guesses."""

    misses: np.ndarray
    """Distances of those that were found, in rising order [m]."""

    flight: CollocatedFlight | None
    """The nearest, None where none was found."""

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
        """Returns what the search says of the launch."""
        return (
            f"of {self.tries} searches for the nearest flight that keeps all other "
            f"limits, {len(self.misses)} end, {self.agreeing} of them "
            f"{1e3 * self.misses[0]:.1f} mm from the wire and none nearer"
        )


def find_closest(
    model: GliderModel, problem: PerchingProblem, knots: int, tries: int = TRIES
) -> Closest:
    """Searches from many guesses for the flight that ends nearest to the wire.

    Args:
        model: the glider.
        problem: all of whose limits hold but the place at the end.
        knots: at least 3.
        tries: number of guesses; always the same ones.

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
        begin = time.perf_counter()
        dip, duration = rng.uniform(*DIPS), line * rng.uniform(*STRETCHES)
        start = to_optimum(swoop(model, problem, dip, duration), knots)
        start.w[:n] = model.initial_state(problem.launch)
        outcome = optimize(model, program, start, COLD_BARRIER, Limits(1e-5))
        name, seconds = "the flight that comes closest", time.perf_counter() - begin
        flight = to_flight(outcome, n, name, seconds)
        if flight.solved:
            end = flight.knots[-1, :2] - np.array(problem.wire)
            found.append((float(np.hypot(*end)), flight))
    found.sort(key=lambda pair: pair[0])
    return Closest(
        tries=tries,
        misses=np.array([miss for miss, _ in found]),
        flight=found[0][1] if found else None,
    )
