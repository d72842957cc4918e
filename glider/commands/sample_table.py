"""The table of the samples: effects and errors, and the error with the truth known."""

import dataclasses
import time
from collections.abc import Iterator, Mapping, Sequence

from glider.campaign.checks.masks import Masks
from glider.campaign.logs import Campaign
from glider.campaign.reader import load_campaign
from glider.physics.effects.field import FieldData
from glider.sysid.fit.folds import flown_by
from glider.sysid.fit.prediction import measure_errors
from glider.sysid.likelihood.model_fit import FitResult, fit_model, start_of
from glider.sysid.likelihood.task import Task, make_task
from glider.sysid.pipeline import close_the_loop
from glider.sysid.replay.record import prepare
from glider.sysid.replay.smoothing import Noise, measure_noise
from glider.sysid.replay.theta import LIBRARY_LAYOUT, Layout
from glider.sysid.replay.vehicle import make_vehicle
from glider.sysid.result import Result

_VENT = FieldData(
    kind="unexplained",
    variables=["x"],
    centers=[[-1.8]],
    widths=[0.4],
    weights={"wind_z": [1.0]},
)
"""The jet of floor_vent: 1 m/s upward at x = -1.8 m, width 0.4 m."""

_TRUTHS: dict[str, tuple[str, ...] | FieldData] = {
    "attached_lift": ("attached_lift",),
    "head_wind": ("wind",),
    "slow_servo": ("servo_lag",),
    "floor_vent": _VENT,
    "still_air": (),
}
"""Sample to the kinds, or the field, that it was flown with."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Row:
    """A sample's row in the table.

    Attributes:
        name: of the sample.
        result: of closing the loop on it.
        seconds: that this took.
        floor: held-out position error of a fit that knows the truth [m]; None where
            the library has no effect for the truth.
    """

    name: str
    result: Result
    seconds: float
    floor: float | None


def trace_samples(names: Sequence[str]) -> Iterator[Row]:
    """Yields the row of each sample."""
    for name in names:
        begin_time = time.perf_counter()
        result = close_the_loop(name)
        seconds = time.perf_counter() - begin_time
        floor = None
        if name in _TRUTHS:
            floor = floor_of(load_campaign(name), _TRUTHS[name], result)
        yield Row(name=name, result=result, seconds=seconds, floor=floor)


def floor_of(
    campaign: Campaign, truth: Sequence[str] | FieldData, result: Result
) -> float:
    """Returns the held-out position error of a fit that knows the truth [m]."""
    whole, noise = task_of(campaign)
    held_out = result.flights.held_out
    task = whole.on([r for r in whole.records if r.name not in held_out])
    unseen = [r for r in whole.records if r.name in held_out]
    if isinstance(truth, FieldData):
        start = dataclasses.replace(begin(task, noise), extra=truth)
    else:
        start = begin(task, noise, truth)
    model = fit_model(task, start)
    return measure_errors(flown_by(task, model, model.scales), unseen)[0].position_rms_m


def task_of(
    campaign: Campaign,
    layout: Layout = LIBRARY_LAYOUT,
    masks: Mapping[str, Masks] | None = None,
) -> tuple[Task, Noise]:
    """Returns the task of a campaign with all kinds, and the noise of its channels."""
    vehicle, noise = make_vehicle(campaign, layout), measure_noise(campaign, masks)
    records = prepare(campaign.flights, campaign, noise, layout, masks)
    return make_task(records, vehicle, vehicle.kinds), noise


def begin(task: Task, noise: Noise, kinds: Sequence[str] = ()) -> FitResult:
    """Starts a fit of kinds: sizes at rest, shapes at their first guess."""
    start = start_of(task, noise, with_curves=False)
    theta = start.theta.copy()
    for kind in kinds:
        coefficients = task.layout.kinds[kind].coefficients
        for slot, c in zip(task.layout.slots_of(kind), coefficients, strict=True):
            theta[slot] = c.grid[0] if c.is_shape else c.default
    kinds = tuple(kinds)
    return dataclasses.replace(start, theta=theta, kinds=kinds, free=task.free(kinds))


HEADING = (
    "                                held-out position error, RMS [mm]\n"
    "sample         verdict          nominal  corrected  floor  found"
)


def line_of(row: Row) -> str:
    """Returns a row as text, in the columns of HEADING."""
    errors = row.result.errors
    nominal, corrected = (
        1e3 * e.position_rms_m if (e := errors[model]) is not None else float("nan")
        for model in ("nominal", "corrected")
    )
    floor = "-" if row.floor is None else f"{1e3 * row.floor:.2f}"
    lines = [
        f"{row.name:14s} {row.result.verdict:16s} {nominal:7.1f} {corrected:10.2f} "
        f"{floor:>6s}  {row.seconds:.0f} s"
    ]
    for effect in row.result.effects:
        lines += [
            f"  {effect.kind}.{name} = {c.value:.4g} {c.unit}"
            for name, c in effect.coefficients.items()
        ][:_MOST]
    return "\n".join(lines)


_MOST = 4  # Coefficients of one effect that are shown.
