"""Errors of all models on flights that they were not fitted to.

The models are the nominal one, where it is complete, the refitted baseline and the
corrected one; a perfect model, see `glider.sysid.fit.floor`, is what they could reach.
"""

import dataclasses
import functools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from glider.compiled.parallel import in_parallel
from glider.physics.effects.families import FAMILIES
from glider.physics.servo import Servo
from glider.sysid.constants import EVIDENCE_THRESHOLD
from glider.sysid.fit import prediction
from glider.sysid.fit.floor import PerfectModel, compare
from glider.sysid.fit.folds import HeldOut, hold_out
from glider.sysid.fit.prediction import RolloutModel, flown_by
from glider.sysid.fit.unlike import predict_unlike
from glider.sysid.likelihood.scales import Scales
from glider.sysid.likelihood.task import FitResult, Task
from glider.sysid.outcome import SPREAD_KINDS
from glider.sysid.replay.record import Noise, Record
from glider.sysid.replay.replayed import make_table
from glider.sysid.result import (
    MODELS,
    PERFECT,
    FlightNames,
    HeldOutFlight,
    ResidualTable,
    Spread,
)
from glider.sysid.search.subsets import survey
from glider.sysid.search.tracing import SearchResult, forces_alone


@dataclasses.dataclass(frozen=True)
class Searched:
    """What a search found, and on which flights.

    Attributes:
        noise: of the sensors.
        everything: on all flights, without those that stand out.
        task: on those to fit.
        traced: outcome of the search on these.
        outlying: names of flights that stand out, and why.
        session: on all flights, with those that stand out at one end of them.
    """

    noise: Noise
    everything: Task
    task: Task
    traced: SearchResult
    outlying: Mapping[str, str]
    session: Task


def evaluate(
    searched: Searched,
    baseline: FitResult,
    spreads: Mapping[str, Spread],
    specified: Servo,
    rng: np.random.Generator,
) -> tuple[dict[str, Any], HeldOut]:
    """Predicts held-out flights by all models.

    Args:
        searched: the flights, and the corrected model.
        baseline: the refitted one.
        spreads: flight-to-flight variations that are reported.
        specified: limits of the servo as the campaign has them.
        rng: for the folds and the flights of a perfect model.

    Returns:
        fields of `Result`, and what each flight says that is held out once.
    """
    task = searched.task
    everything = searched.everything
    traced = searched.traced
    corrected = traced.model
    fitted = {"refitted": baseline, "corrected": corrected}
    if task.vehicle.is_known:
        nominal = dataclasses.replace(baseline, theta=task.vehicle.theta, free=())
        fitted = {"nominal": nominal, **fitted}

    models = {n: flown_by(task, m, corrected.scales) for n, m in fitted.items()}
    tests = _hold_out(searched, baseline, rng)

    records = everything.records
    unseen = [record for record in records if record not in task.records]
    tables = {name: _table(model, unseen) for name, model in models.items()}
    with np.errstate(over="ignore", invalid="ignore"):  # A model may diverge.
        equation = {
            name: prediction.rms(table.residual) for name, table in tables.items()
        }

    equation[PERFECT] = prediction.rms(tables["corrected"].noise)
    perfect = PerfectModel(
        truth=without_model_errors(traced, spreads),
        pitch_ratio=searched.noise.smoothing[2].ratio,
        rng=rng,
    )
    depends_on = _variables_of(task, traced.judged)
    found = compare(models, unseen, perfect, equation, records, depends_on)
    shown = []
    for i, record in enumerate(unseen):
        rows = prediction.beginning_rows(record.time, task.vehicle.per_flight_trims)
        shown.append(
            HeldOutFlight(
                name=record.name,
                time=record.time,
                measured=record.pose,
                flown={name: own[i].pose for name, own in found.flown.items()},
                fitted_until=float(record.time[rows - 1]),
            )
        )

    after = _table(models["corrected"], records)
    unlike = predict_unlike(everything, fitted, models, traced.forces, after, perfect)
    return {
        "flights": FlightNames(
            fit=tuple(record.name for record in task.records),
            held_out=tuple(record.name for record in unseen),
            diverged=tuple(r.name for r in unseen if r not in found.counted),
        ),
        "errors": {**dict.fromkeys(MODELS), **found.errors},
        "left": found.left,
        "by_commands_m": _fly_by_commands(models, found.counted, specified),
        "unlike": unlike,
        "held_out": tuple(shown),
        "residual_before": _table(next(iter(models.values())), records),
        "residual_after": after,
    }, tests


def _fly_by_commands(
    models: Mapping[str, RolloutModel], records: Sequence[Record], specified: Servo
) -> dict[str, float]:
    """Flies flights by their commands alone, where elevators do not just follow them.

    The nominal model has the servo as specified. The corrected one is omitted where the
    limits of its servo explain the elevators: it always flies by commands then.

    Args:
        models: by name.
        records: the flights, with the limits of the servo that they show.
        specified: the limits as the campaign has them.

    Returns:
        RMS position errors [m] by model; empty where elevators follow their commands.
    """
    if not records:
        return {}
    departs = any(record.departure.any() for record in records)
    servos = {"corrected": records[0].servo} if departs else {}
    if departs or records[0].servo != specified:
        servos = {"nominal": specified, **servos}

    rows = prediction.rows_of(records)
    errors = {}
    for name in filter(models.__contains__, servos):
        commanded = [
            dataclasses.replace(
                record,
                departure=np.zeros_like(record.departure),
                departure_std=0.0,
                servo=servos[name],
            )
            for record in records
        ]
        fly = functools.partial(prediction.predict, models[name])
        flown = [*in_parallel(fly, commanded)]
        squares = prediction.mean_squares(commanded, flown)[:, 0]
        errors[name] = float(np.sqrt(np.average(squares, weights=rows)))

    return errors


def _hold_out(
    searched: Searched, baseline: FitResult, rng: np.random.Generator
) -> HeldOut:
    """Compares the correction with other models on flights held out in folds.

    These are the baseline and, of a known glider, the nominal model; of unknown forces
    both are judged by the forces alone. A correction that adds nothing has no others.
    """
    task = searched.task
    traced = searched.traced
    tested = traced.model
    others = {"refitted": baseline}
    if traced.forces is not None:
        others["refitted"] = forces_alone(task, baseline, traced.forces)
        tested = forces_alone(task, tested, traced.forces)
    elif task.vehicle.is_known:
        others["nominal"] = traced.bare

    if not tested.kinds:
        others = {}
    offered = searched.everything.offering(traced.near)
    return hold_out(offered, tested, others, rng)


def _variables_of(task: Task, model: FitResult) -> tuple[str, ...]:
    """Variables that the remainder of a model varies with, at most three.

    Those of the free functions with the most evidence beside it.
    """
    gains = survey(task, model)
    found = [
        variable
        for name in sorted(gains, key=gains.__getitem__, reverse=True)
        if gains[name] > EVIDENCE_THRESHOLD
        for variable in FAMILIES[name].depends_on
    ]
    return tuple(dict.fromkeys(found))[:3]


def without_model_errors(traced: SearchResult, spreads: Mapping[str, Spread]) -> Scales:
    """Scales without errors of the model: sensors, turbulence, per-flight constants.

    An elevator off its path is an error of the servo's model. Where something was
    found, a variation over flights that is not reported is an error of a formula: such
    errors look like small trims. Where a search of forces set the scales, gusts are not
    distinguished from errors of the forces: they count as these.
    """
    unknown = {"servo"}
    if traced.model.kinds or traced.model.functions:
        unknown.update(SPREAD_KINDS.values())
    if traced.forces is not None:
        unknown.add("air")
    stds = {SPREAD_KINDS[kind]: spread.std for kind, spread in spreads.items()}
    return dataclasses.replace(
        traced.model.scales.without(*unknown), **stds
    ).without_floors


def _table(flown: RolloutModel, records: Sequence[Record]) -> ResidualTable:
    """A model's residual over flights, each with the trim that it has."""
    find_launch = functools.partial(prediction.find_launch, flown)
    trims = [float(a.constants[2]) for _, a in in_parallel(find_launch, records)]
    return make_table(records, flown.theta, trims, flown.gaussians)
