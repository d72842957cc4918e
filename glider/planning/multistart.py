"""Plans one problem from many guesses and tells the distinct minima apart."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from glider.physics.model import GliderModel
from glider.planning.dircol import PlanningError, Progress, plan
from glider.planning.guess import Guess, straight_line, swoop
from glider.planning.plan import Plan
from glider.planning.problem import PerchingProblem

SAME_COST = 1e-3
"""Relative difference of cost below which two plans may be one."""

SAME_PATH = 0.02
"""Largest difference in x, z or pitch at which they are [m, rad]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Minimum:
    """A local minimum of a planning problem."""

    plan: Plan
    """Plan that was found first."""

    guesses: tuple[str, ...]
    """Names of the guesses that led to it."""


def find_minima(
    model: GliderModel,
    problem: PerchingProblem,
    starts: int,
    rng: np.random.Generator,
    knots: Sequence[int] = (25,),
    progress: Progress | None = None,
) -> tuple[Minimum, ...]:
    """Plans from a straight line and from random dips; returns what differs.

    Args:
        model: the glider.
        problem: what to fly.
        starts: number of guesses.
        rng: draws the guesses: dips of -0.3 to 0.8 m flown 0.7 to 1.6 times as
            long as the straight line.
        knots: as in `plan`.
        progress: told about each attempt.

    Returns:
        The distinct minima, the least cost first; each guess may have needed
        further rungs of the planner's ladder.

    Raises:
        PlanningError: where no guess leads to a plan.
    """
    line = straight_line(model, problem)
    guesses: list[Guess] = [line]
    for _ in range(starts - 1):
        duration = rng.uniform(0.7, 1.6) * line.states.end_time()
        guesses.append(swoop(model, problem, rng.uniform(-0.3, 0.8), duration))

    minima: list[Minimum] = []
    failure: PlanningError | None = None
    for guess in guesses:
        try:
            found = plan(model, problem, knots, guess=guess, progress=progress)
        except PlanningError as error:
            failure = error
            continue
        for i, known in enumerate(minima):
            if _same(known.plan, found):
                names = (*known.guesses, guess.name)
                minima[i] = dataclasses.replace(known, guesses=names)
                break
        else:
            minima.append(Minimum(plan=found, guesses=(guess.name,)))
    if not minima and failure is not None:
        raise failure
    return tuple(sorted(minima, key=lambda minimum: minimum.plan.cost))


def _same(first: Plan, second: Plan) -> bool:
    if abs(first.cost - second.cost) > SAME_COST * abs(first.cost):
        return False
    return bool(np.abs(first.states - second.states)[:, :3].max() < SAME_PATH)
