"""The flights most unlike the others, predicted by models refitted without them.

Flights that are held out at random are like those of the fit, but who plans with a
model flies others. What it is worth there shows where the farthest are left out.
"""

import math
from collections.abc import Mapping
from itertools import compress

import numpy as np

from glider.physics.effects.free_functions import FLOW_UNITS
from glider.sysid.constants import FOLDS
from glider.sysid.fit.floor import PerfectModel, compare
from glider.sysid.fit.prediction import flown_by
from glider.sysid.likelihood.task import FitResult, Task
from glider.sysid.result import (
    PERFECT,
    Difference,
    EquationErrors,
    ResidualTable,
    UnlikeFlights,
)
from glider.sysid.search.tracing import refitted

_FEATURES = "{} at launch", "least {}", "median {}", "largest {}"
"""What of a variable along a flight is compared."""


def find_unlike(table: ResidualTable) -> tuple[np.ndarray, Difference]:
    """Finds which of at least three flights (F,) are unlike the others, and in what.

    Features are compared over the deviation of their variable along all flights, on the
    axis of them that flights differ most on. A FOLDS part of the flights, or half to
    twice as many, is at one end of it: where the gap to the others is the widest.
    """
    count = len(table.names)
    ends = np.flatnonzero(np.diff(table.flight)) + 1
    values = np.column_stack([table.variables[name] for name in FLOW_UNITS])
    spreads = np.maximum(np.std(values, axis=0), 1e-12)  # A fixed elevator has none.
    found = []
    for own in np.split(values / spreads, ends):
        middle = np.median(own, axis=0)
        found.append(np.stack([own[0], own.min(axis=0), middle, own.max(axis=0)]))

    features = np.reshape(found, (count, -1))
    *_, axes = np.linalg.svd(features - features.mean(axis=0), full_matrices=False)
    # The widest gap near either end divides the flights.
    along = features @ axes[0]
    order = np.argsort(along)
    gaps = np.diff(along[order])
    part = count / FOLDS
    sizes = np.arange(max(1, round(0.5 * part)), min(round(2.0 * part), count - 2) + 1)
    first, last = gaps[sizes - 1], gaps[-sizes]
    size = sizes[np.argmax(np.maximum(first, last))]
    is_unlike = np.zeros(count, bool)
    is_unlike[order[:size] if first.max() > last.max() else order[-size:]] = True

    here, others = (np.median(features[own], axis=0) for own in (is_unlike, ~is_unlike))
    most = int(np.argmax(np.abs(here - others)))
    feature, column = divmod(most, len(spreads))
    variable = list(FLOW_UNITS)[column]
    return is_unlike, Difference(
        what=_FEATURES[feature].format(variable),
        unit=FLOW_UNITS[variable],
        value=float(spreads[column] * here[most]),
        others=float(spreads[column] * others[most]),
    )


def predict_unlike(
    task: Task,
    models: Mapping[str, FitResult],
    forces: FitResult | None,
    table: ResidualTable,
    perfect: PerfectModel,
) -> UnlikeFlights | None:
    """Predicts the most unlike of a task's flights; None where there are too few.

    Args:
        task: of all flights.
        models: by name, "corrected" among them; coefficients are refitted.
        forces: the model of forces, where these are unknown.
        table: of all flights in the same order.
        perfect: the perfect model.
    """
    if len(task.records) < 3:
        return None
    is_unlike, difference = find_unlike(table)
    unlike = list(compress(task.records, is_unlike))
    others = task.on(list(compress(task.records, ~is_unlike)))
    scales = models["corrected"].scales
    again = {name: refitted(others, own, forces) for name, own in models.items()}
    flying = {name: flown_by(others, own, scales) for name, own in again.items()}
    nothing = EquationErrors(math.nan, math.nan, math.nan)
    found = compare(flying, unlike, perfect, dict.fromkeys((*flying, PERFECT), nothing))
    return UnlikeFlights(
        flights=tuple(record.name for record in found.counted),
        difference=difference,
        errors=dict(found.errors),
        left=found.left,
        diverged=tuple(r.name for r in unlike if r not in found.counted),
    )
