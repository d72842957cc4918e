"""The proof that every flight that starts in a funnel stays there.

The certificate holds on each of its intervals, and the remainder keeps its bound there.
"""

import dataclasses
import functools

import numpy as np

from glider.errors import InputError
from glider.progress import Shares, silent
from glider.verification.funnel.funnel import Funnel
from glider.verification.proof.held import held_faults
from glider.verification.proof.interval_proof import (
    IntervalProof,
    each_interval,
    prove_interval,
    some_intervals,
)


@dataclasses.dataclass(frozen=True, kw_only=True)
class FlightProof:
    """The outcome of a proof, up to the first interval that is not proven."""

    times: np.ndarray  #: The funnel's times (T,) [s].
    #: Of each interval that was tried, by its index, in order; one at most is no proof.
    outcomes: dict[int, IntervalProof]

    @property
    def of_intervals(self) -> int:
        """Number of intervals that the funnel has."""
        return int(np.count_nonzero(np.diff(self.times)))

    @property
    def failed(self) -> int | None:
        """Index of the interval that is not proven; None where all tried are."""
        return next((k for k, found in self.outcomes.items() if not found.proven), None)

    @property
    def complete(self) -> bool:
        """Whether all that were tried are proven."""
        return self.failed is None

    @property
    def is_whole(self) -> bool:
        """Whether it is proven of every interval: the theorem holds."""
        return self.complete and len(self.outcomes) == self.of_intervals

    @property
    def until(self) -> float:
        """Time before which nothing that was tried is left unproven [s]."""
        last = max(self.outcomes) + 1
        return float(self.times[last if self.failed is None else self.failed])

    @property
    def fault(self) -> str:
        """Reason why that one is not; empty where all are."""
        return "" if self.failed is None else self.outcomes[self.failed].fault

    @property
    def count(self) -> int:
        """Number of intervals that are proven."""
        return sum(found.proven for found in self.outcomes.values())

    @property
    def boxes(self) -> int:
        """Number of boxes in all intervals."""
        return sum(found.boxes for found in self.outcomes.values())


def prove_flights(
    funnel: Funnel,
    every: int = 1,
    *,
    workers: int = -1,
    progress: Shares = silent,
    is_checked: bool = False,
) -> FlightProof:
    """Tries to prove that no flight leaves a funnel between its ends.

    Args:
        every: look at every so many intervals only, the first and last included.
        workers: processes; as many as there are cores if -1.
        is_checked: whether `check_funnel` holds, of the same intervals; else held
            commands and the certificate are proven too.

    Raises:
        InputError: held commands are not what the funnel says that they are.
    """
    for fault in () if is_checked else held_faults(funnel, progress):
        raise InputError(f"Nothing is proven: {fault}")
    prove = functools.partial(prove_interval, certificate=not is_checked)
    wanted = some_intervals(funnel, every)
    outcomes = {}
    for k, found in each_interval(prove, funnel, wanted, workers, progress):
        outcomes[k] = found
        if not found.proven:
            break
    return FlightProof(times=funnel.nominal.times, outcomes=outcomes)
