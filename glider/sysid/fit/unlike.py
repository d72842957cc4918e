"""The flights most unlike the others, predicted by models refitted without them.

Flights that are held out at random are like those of the fit, but a plan that is made
with a model flies elsewhere. `find_unlike` finds the flights farthest from the others,
by features of their variables, and `predict_unlike` the errors of models on them.
"""

import dataclasses
import math
from collections.abc import Mapping
from itertools import compress

import numpy as np

from glider.physics.effects.free_functions import FLOW_UNITS
from glider.sysid.constants import FOLDS
from glider.sysid.fit.floor import PerfectModel, compare
from glider.sysid.fit.prediction import RolloutModel
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

    Features are counted in the standard deviations of their variables along all
    flights. On the principal axis of the features, on which flights differ most, the
    flights are divided where the gap is widest (see `_find_end`).

    Args:
        table: the variables along all flights, F of them.

    Returns:
        (F,) which are unlike, and the feature whose medians differ most between them
        and the others.
    """
    values = np.column_stack([table.variables[name] for name in FLOW_UNITS])
    spreads = np.maximum(values.std(axis=0), 1e-12)  # A fixed elevator has none.
    ends = np.flatnonzero(np.diff(table.flight)) + 1
    found = []
    for own in np.split(values / spreads, ends):
        middle = np.median(own, axis=0)
        found.append([own[0], own.min(axis=0), middle, own.max(axis=0)])

    features = np.reshape(found, (len(table.names), -1))
    *_, axes = np.linalg.svd(features - features.mean(axis=0), full_matrices=False)
    is_unlike = _find_end(features @ axes[0])

    here = np.median(features[is_unlike], axis=0)
    others = np.median(features[~is_unlike], axis=0)
    most = int(np.abs(here - others).argmax())
    feature, column = divmod(most, len(spreads))
    variable = list(FLOW_UNITS)[column]
    return is_unlike, Difference(
        what=_FEATURES[feature].format(variable),
        unit=FLOW_UNITS[variable],
        value=float(spreads[column] * here[most]),
        others=float(spreads[column] * others[most]),
    )


def _find_end(along: np.ndarray) -> np.ndarray:
    """Returns which of some values (F,) are beyond the widest gap near either end.

    They are one in FOLDS of the values, or half to twice as many.
    """
    count = len(along)
    part = count / FOLDS
    least = max(1, round(0.5 * part))
    most = min(round(2.0 * part), count - 2)
    sizes = np.arange(least, most + 1)

    order = np.argsort(along)
    gaps = np.diff(along[order])
    after_first = gaps[sizes - 1]
    before_last = gaps[-sizes]
    size = sizes[np.maximum(after_first, before_last).argmax()]
    chosen = order[-size:]
    if after_first.max() > before_last.max():
        chosen = order[:size]
    return np.isin(np.arange(count), chosen)


def predict_unlike(
    task: Task,
    models: Mapping[str, FitResult],
    flying: Mapping[str, RolloutModel],
    forces: FitResult | None,
    table: ResidualTable,
    perfect: PerfectModel,
) -> UnlikeFlights | None:
    """Predicts the most unlike of a task's flights by models refitted without them.

    Args:
        task: of all flights.
        models: by name; their coefficients are refitted.
        flying: the same as they fly again, whose launches have the same noise.
        forces: the model of forces, where these are unknown.
        table: of all flights in the same order.
        perfect: the perfect model.

    Returns:
        The flights, what they differ in, and the errors on them without those of
        accelerations; None where there are too few flights.
    """
    if len(task.records) < 3:
        return None
    is_unlike, difference = find_unlike(table)
    unlike = list(compress(task.records, is_unlike))
    others = task.on(list(compress(task.records, ~is_unlike)))
    again = {}
    for name, model in models.items():
        own = refitted(others, model, forces)
        again[name] = dataclasses.replace(
            flying[name], theta=own.theta, gaussians=own.gaussians
        )
    nothing = EquationErrors(math.nan, math.nan, math.nan)
    found = compare(again, unlike, perfect, dict.fromkeys((*again, PERFECT), nothing))
    return UnlikeFlights(
        flights=tuple(record.name for record in found.counted),
        difference=difference,
        errors=dict(found.errors),
        left=found.left,
        diverged=tuple(r.name for r in unlike if r not in found.counted),
    )
