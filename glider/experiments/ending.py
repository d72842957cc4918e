"""Where flights like those flown end, and how far that is known."""

import dataclasses

import numpy as np

from glider.compiled.parallel import in_parallel
from glider.experiments.explanations import Explanation
from glider.sysid.likelihood.directions import slopes
from glider.sysid.likelihood.linear_flight import linearize
from glider.sysid.likelihood.model_fit import field_of
from glider.sysid.likelihood.scales import start_variances, whiten
from glider.sysid.likelihood.task import Task
from glider.sysid.replay.record import Record


@dataclasses.dataclass(frozen=True, kw_only=True)
class Ending:
    """Where flights like those flown end, to first order, the launch given.

    Attributes:
        air: standard deviation of the place, by moving air and by what differs from
            flight to flight [m].
        by_numbers: (2 F, m) how x and z there move with the free numbers, over √F.
    """

    air: float
    by_numbers: np.ndarray

    def numbers(self, covariance: np.ndarray) -> float:
        """Returns the standard deviation by what is not known of the numbers [m]."""
        moved = self.by_numbers @ covariance @ self.by_numbers.T
        return float(np.sqrt(max(np.trace(moved), 0.0)))


def ending_of(task: Task, explanation: Explanation) -> Ending:
    """Returns how the ends of a task's flights spread under an explanation.

    The filter, told the launch and shown the last row alone, has the spread as the
    variance of its innovation.
    """
    model = explanation.model
    directions = slopes(task.layout, model.theta, model.free)
    field = field_of(task, model)

    def spread(record: Record) -> tuple[float, np.ndarray]:
        flight = linearize(record, model.theta, field, directions)
        start = start_variances(flight, model.scales)
        start[: flight.by_x.shape[1]] = 0.0
        variance, rows = 0.0, []
        for channel in range(2):
            seen = np.zeros_like(record.seen)
            seen[-1, channel] = True
            alone = dataclasses.replace(
                flight, record=dataclasses.replace(record, seen=seen)
            )
            filtered = whiten(alone, model.scales, start)
            own = float(np.exp(filtered.log_variances[-1, channel]))
            variance += own - model.scales.position**2
            rows.append(np.sqrt(own) * filtered.innovations[-1, channel, :-1])
        return variance, np.array(rows)

    found = in_parallel(spread, task.records)
    return Ending(
        air=float(np.sqrt(max(np.mean([v for v, _ in found]), 0.0))),
        by_numbers=np.vstack([rows for _, rows in found]) / np.sqrt(len(found)),
    )
