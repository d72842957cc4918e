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
class EndScatter:
    """Scatter of the ends of flights from a given launch, to first order.

    Attributes:
        air: standard deviation of the end, by moving air and flight-to-flight
            variation [m].
        slopes: (2 F, m) change of x and z of the end with the free parameters, over √F.
    """

    air: float
    slopes: np.ndarray

    def by_parameters(self, covariance: np.ndarray) -> float:
        """Standard deviation of the end by the covariance of the parameters [m]."""
        moved = self.slopes @ covariance @ self.slopes.T
        return float(np.sqrt(max(np.trace(moved), 0.0)))


def end_scatter(task: Task, explanation: Explanation) -> EndScatter:
    """Computes the scatter of a task's flights under an explanation.

    The filter, given the launch and the last row alone, has it as the variance of its
    innovation.
    """
    model = explanation.model
    directions = slopes(task.layout, model.theta, model.free)
    field = field_of(task, model)

    def scatter(record: Record) -> tuple[float, np.ndarray]:
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

    found = in_parallel(scatter, task.records)
    return EndScatter(
        air=float(np.sqrt(max(np.mean([v for v, _ in found]), 0.0))),
        slopes=np.vstack([rows for _, rows in found]) / np.sqrt(len(found)),
    )
