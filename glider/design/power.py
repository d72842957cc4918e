"""Information limits: the smallest effect that so many flights can show.

An oracle that knows which one coefficient may be wrong, the strength of the air and of
the sensors, and nothing of the launches, tests it against zero. One flight's whitened
column x (see `glider.sysid.likelihood.scales.whiten`) holds the Fisher information x'x
of it, so that N flights like those at hand know it to
    σ_N = 1 / √(N mean x'x),
and find a size of (z_α + z_β) σ_N with probability β at a share α of false alarms.
"""

import dataclasses

import numpy as np
from scipy.stats import norm

from glider.sysid.likelihood.directions import Direction, slopes, starts_of
from glider.sysid.likelihood.model_fit import Fitted, grams_of, linear_flights
from glider.sysid.likelihood.task import Task

FALSE_ALARMS = 0.01
"""Share of effect-free campaigns in which the oracle may claim an effect."""

FOUND = 0.95
"""Share of campaigns with an effect of the limit's size in which it must find it."""

_SIGMAS = float(norm.ppf(1.0 - 0.5 * FALSE_ALARMS) + norm.ppf(FOUND))


@dataclasses.dataclass(frozen=True, kw_only=True)
class Limit:
    """What flights can know of one coefficient.

    Attributes:
        kind: of the effect.
        name: of the coefficient.
        unit: of it.
        scale: its typical size.
        std: standard deviation that one flight knows it to, on average.
    """

    kind: str
    name: str
    unit: str
    scale: float
    std: float

    def smallest(self, flights: int) -> float:
        """Returns the smallest size that so many flights show to the oracle."""
        return _SIGMAS * self.std / float(np.sqrt(flights))


def limits_of(task: Task, model: Fitted) -> list[Limit]:
    """Returns the limits of all sizes of the task's kinds, in flights like its own.

    Shapes are where the library has them; a lag or a delay counts as small.

    Args:
        task: of flights in which nothing is wrong but the model.
        model: of the task without effects, its scales fitted.
    """
    layout = task.layout
    directions: list[Direction] = []
    for name in task.kinds:
        kind = layout.kinds[name]
        slots = list(layout.slots_of(name))
        if all(c.is_shape for c in kind.coefficients):
            directions += slopes(layout, model.theta, slots)
            continue
        usual = dict(zip(slots, (c.default for c in kind.coefficients), strict=True))
        starts = starts_of(layout, kind, model.theta)
        apart = [
            sum(abs(v - usual[i]) / layout.scale[i] for i, v in columns[0].shapes)
            for columns in starts
        ]
        directions += starts[int(np.argmin(apart))]
    grams = grams_of(linear_flights(task, model, directions), model.scales)
    known = np.mean([np.diag(gram)[:-1] for gram in grams], axis=0)
    found = []
    for direction, information in zip(directions, known, strict=True):
        coefficient = task.coefficient(direction.slot)
        if coefficient is None or not information > 0.0:
            continue  # A parameter of the vehicle, or nothing that flights show.
        found.append(
            Limit(
                kind=direction.kind,
                name=coefficient.name,
                unit=coefficient.unit,
                scale=coefficient.scale,
                std=1.0 / float(np.sqrt(information)),
            )
        )
    return found
