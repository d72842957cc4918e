"""Fits that know which effects are true: the least error that a tracer can reach."""

import dataclasses
import itertools
from collections.abc import Mapping, Sequence

from glider.campaign.checks.masks import Masks
from glider.campaign.logs import Campaign
from glider.physics.effects.free_functions import FreeFunction
from glider.physics.parameter_space import ParameterSpace
from glider.sysid.fit.prediction import (
    RolloutModel,
    errors_from,
    flown_by,
    mean_squares,
    predict,
    rms,
    rows_of,
)
from glider.sysid.likelihood.fitted_functions import functions_of
from glider.sysid.likelihood.model_fit import fit_model
from glider.sysid.likelihood.task import FitResult, Task, make_task, start_of
from glider.sysid.replay.log_space import LIBRARY_SPACE
from glider.sysid.replay.record import Noise, Record, measure_noise, prepare
from glider.sysid.replay.replayed import make_table
from glider.sysid.replay.vehicle import make_vehicle
from glider.sysid.result import Errors, Result

_VENT = FreeFunction(
    kind="unexplained",
    variables=["x"],
    centers=[[-1.8]],
    widths=[0.4],
    weights={"wind_z": [1.0]},
)
"""The jet of floor_vent: 1 m/s upward at x = -1.8 m, width 0.4 m."""

TRUTHS: dict[str, tuple[str, ...] | FreeFunction] = {
    "attached_lift": ("attached_lift",),
    "head_wind": ("wind",),
    "slow_servo": ("servo_lag",),
    "floor_vent": _VENT,
    "still_air": (),
}
"""Sample to the kinds, or the free function, that it was flown with."""


def limit_of(
    campaign: Campaign, truth: Sequence[str] | FreeFunction, result: Result
) -> float:
    """Held-out position error of a fit that knows the true effects [m]."""
    whole, noise = task_of(campaign)
    held_out = result.flights.held_out
    task = whole.on([r for r in whole.records if r.name not in held_out])
    unseen = [r for r in whole.records if r.name in held_out]
    if isinstance(truth, FreeFunction):
        carried = functions_of([truth])
        starts = [dataclasses.replace(begin(task, noise), functions=carried)]
    else:
        starts = starts_of(task, noise, truth)
    model = min((fit_model(task, start) for start in starts), key=lambda fit: fit.cost)
    flown = flown_by(task, model, model.scales)
    return errors_of(flown, unseen).position_rms_m


def errors_of(model: RolloutModel, records: Sequence[Record]) -> Errors:
    """Returns the errors of a model on flights."""
    flown = [predict(model, record) for record in records]
    trims = [own.trim for own in flown]
    table = make_table(records, model.theta, trims, model.gaussians)
    squares = mean_squares(records, flown)[..., None]
    return errors_from(squares, rows_of(records), rms(table.residual))


def task_of(
    campaign: Campaign,
    space: ParameterSpace = LIBRARY_SPACE,
    masks: Mapping[str, Masks] | None = None,
) -> tuple[Task, Noise]:
    """Task of a campaign with all kinds, and the noise of its channels."""
    vehicle, noise = make_vehicle(campaign, space), measure_noise(campaign, masks)
    records = prepare(campaign.flights, campaign, noise, space, masks)
    return make_task(records, vehicle, vehicle.kinds), noise


def starts_of(task: Task, noise: Noise, kinds: Sequence[str]) -> list[FitResult]:
    """Starts of a fit of kinds, one for each combination of first guesses of shapes."""
    shapes = [
        (slot, c.grid)
        for kind in kinds
        for slot, c in zip(
            task.space.slots_of(kind), task.space.kinds[kind].coefficients, strict=True
        )
        if c.is_shape
    ]
    start, starts = begin(task, noise, kinds), []
    for guess in itertools.product(*(grid for _, grid in shapes)):
        theta = start.theta.copy()
        for (slot, _), value in zip(shapes, guess, strict=True):
            theta[slot] = value
        starts.append(dataclasses.replace(start, theta=theta))
    return starts


def begin(task: Task, noise: Noise, kinds: Sequence[str] = ()) -> FitResult:
    """Start of a fit of kinds: nothing acts, shapes at their first guess."""
    start = start_of(task, noise)
    theta = start.theta.copy()
    for kind in kinds:
        coefficients = task.space.kinds[kind].coefficients
        for slot, c in zip(task.space.slots_of(kind), coefficients, strict=True):
            theta[slot] = c.grid[0] if c.is_shape else c.default
    kinds = tuple(kinds)
    return dataclasses.replace(start, theta=theta, kinds=kinds, free=task.free(kinds))
