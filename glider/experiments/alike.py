"""Throws of the present kind: what they would tell, and how many would do the same."""

from glider.errors import InputError
from glider.experiments.forecast import Foresight, Grams, added, is_finite, times
from glider.experiments.throws import flown_throw
from glider.sysid.likelihood.task import Task

MOST_THROWS = 1000
"""Throws of the present kind that are counted up to."""


def present_kind(foresight: Foresight, flights: Task) -> Grams:
    """Returns what a throw of the present kind tells, the mean of flown ones.

    Raises:
        InputError: the explanations can fly none of them again.
    """
    count = len(foresight.explanations)
    throws = [flown_throw(r) for r in flights.records]
    logs = [own for own in foresight.logs(throws) if len(own) == count]
    told = [own for own in foresight.grams(logs) if is_finite(own)]
    if not told:
        raise InputError(
            f"{foresight.campaign.path}: no flown flight can be flown again by all "
            "explanations; flights that close-the-loop explains are needed."
        )
    return times(added(told), 1.0 / len(told))


def count_alike(foresight: Foresight, one: Grams, chance: float) -> int | None:
    """Returns how many throws of one kind reach a chance; None if too many."""

    def reached(count: int) -> bool:
        return foresight.chance(foresight.futures(times(one, count))) >= chance

    if not reached(MOST_THROWS):
        return None
    low, high = 0, MOST_THROWS
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if reached(middle) else (middle, high)
    return high
