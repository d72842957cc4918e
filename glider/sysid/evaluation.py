"""Errors of all models on flights that they were not fitted to."""

import dataclasses
import functools
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from glider.campaign.logs import Campaign
from glider.campaign.turning import Signs
from glider.compiled.parallel import in_parallel
from glider.physics.effects.families import FAMILIES
from glider.sysid import result
from glider.sysid.constants import EVIDENCE_THRESHOLD, MANY_FLIGHTS
from glider.sysid.fit import prediction
from glider.sysid.fit.floor import find_floor
from glider.sysid.fit.folds import HeldOut, hold_out
from glider.sysid.fit.prediction import compare, flown_by
from glider.sysid.likelihood.candidates import survey
from glider.sysid.likelihood.scales import Scales
from glider.sysid.likelihood.task import FitResult, Task
from glider.sysid.outcome import SPREAD_KINDS
from glider.sysid.replay.record import Noise, Record
from glider.sysid.replay.replayed import make_table
from glider.sysid.result import MODELS, PERFECT, ResidualTable, Spread
from glider.sysid.search.tracing import SearchResult, forces_alone


@dataclasses.dataclass(frozen=True)
class SmoothedFlights:
    """Flights as the corrected model takes them, and as those before it do.

    They differ where angles were logged with the other sign.
    """

    campaign: Campaign  #: With wrong signs turned.
    signs: Signs  #: Of the logged angles.
    noise: Noise  #: Of the sensors.
    corrected: Mapping[str, Record]  #: With the signs turned, by name.
    logged: Mapping[str, Record]  #: As they were logged.
    findings: tuple[str, ...]  #: How the servo differs from its specification.

    def of(self, model: str, names: Iterable[str]) -> list[Record]:
        """Returns flights for a model, all by name."""
        own = self.corrected if model == "corrected" else self.logged
        return [own[name] for name in names]


@dataclasses.dataclass(frozen=True)
class Searched:
    """What a search found, and on which flights; without those that stand out."""

    flights: SmoothedFlights  #: All of them.
    everything: Task  #: On all flights.
    task: Task  #: On those to fit.
    traced: SearchResult
    outlying: Mapping[str, str]  #: Names of flights that stand out, and why.


def evaluate(
    searched: Searched,
    held_out: Collection[str],
    baseline: FitResult,
    spreads: Mapping[str, Spread],
    rng: np.random.Generator,
) -> tuple[dict[str, Any], HeldOut]:
    """Predicts held-out flights, whose names are given, by all models.

    Returns fields of `Result`, and what each flight says that is held out once.
    """
    task = searched.task
    traced = searched.traced
    flights = searched.flights
    scales = traced.model.scales
    fitted = {"refitted": baseline, "corrected": traced.model}
    if task.vehicle.is_known:
        fixed = dataclasses.replace(baseline, theta=task.vehicle.theta, free=())
        fitted = {"nominal": fixed, **fitted}
    models = {name: flown_by(task, model, scales) for name, model in fitted.items()}

    usual = [record.name for record in searched.everything.records]
    unseen = [name for name in usual if name in held_out]
    found = compare({n: (own, flights.of(n, unseen)) for n, own in models.items()})
    kept = [unseen[i] for i in found.kept]
    corrected = traced.model
    others = {"refitted": baseline}
    if traced.forces is not None:
        corrected = forces_alone(task, corrected, traced.forces)
        others["refitted"] = forces_alone(task, baseline, traced.forces)
    elif task.vehicle.is_known:
        others["nominal"] = traced.bare
    if not flights.signs.are_right:  # They are not of the same log: there is no gain.
        others = {}
    tests = hold_out(searched.everything, corrected, others, rng)

    records = flights.of("corrected", usual)
    own = models["corrected"]
    of_nominal = models.get("nominal", models["refitted"])
    before = _table(of_nominal, flights.of("nominal", usual))
    after = _table(own, records)
    truth = without_model_errors(traced, spreads)
    records.sort(key=lambda record: record.name not in kept)
    first = records[:MANY_FLIGHTS]
    smoothness = flights.noise.smoothing[2].ratio
    floor = find_floor(own, first, truth, smoothness, rng)
    is_kept = np.isin(after.flight, [after.names.index(name) for name in kept])
    perfect = floor.errors(prediction.rms(after.noise[is_kept]), len(kept))
    errors = dict.fromkeys(MODELS) | found.errors | {PERFECT: perfect}
    flown = [found.predictions["corrected"][i] for i in found.kept]
    predict = functools.partial(prediction.predict, own)
    flown += in_parallel(predict, first[len(kept) :])
    squares = map(prediction.mean_squares, first, flown)
    paths = np.sqrt([square[:2] for square in squares])
    turned = np.array([1.0, 1.0, flights.signs.pitch])
    shown = []
    for i in found.kept:
        record = flights.corrected[unseen[i]]
        rows = prediction.beginning_rows(record.time, own.per_flight_trims)
        poses = {name: p[i].pose for name, p in found.predictions.items()}
        shown.append(
            result.HeldOutFlight(
                name=record.name,
                time=record.time,
                measured=record.pose * turned,
                flown=poses | {"corrected": poses["corrected"] * turned},
                fitted_until=float(record.time[rows - 1]),
            )
        )

    left = found.errors["corrected"]
    along = left.rollout_measured_pitch.position_rms_m
    return {
        "errors": errors,
        "left": result.Residual(
            position_m=left.position_rms_m,
            ratio_to_floor=left.position_rms_m / perfect.position_rms_m,
            ratio_along_pitch=along / perfect.rollout_measured_pitch.position_rms_m,
            most_by_chance=floor.most_by_chance(len(kept)),
            chance=floor.chance(paths),
            depends_on=_variables_of(task, traced.judged),
        ),
        "held_out": tuple(shown),
        "residual_before": before,
        "residual_after": after,
    }, tests


def _variables_of(task: Task, model: FitResult) -> tuple[str, ...]:
    """Variables that the remainder of a model varies with, at most three."""
    gains = survey(task, model)
    real = [name for name, gain in gains.items() if gain > EVIDENCE_THRESHOLD]
    real.sort(key=lambda name: -gains[name])
    found = [v for name in real for v in FAMILIES[name].depends_on]
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


def _table(flown: prediction.RolloutModel, records: Sequence[Record]) -> ResidualTable:
    """A model's residual over flights, each with the trim that it has."""
    find_launch = functools.partial(prediction.find_launch, flown)
    trims = [float(a.constants[2]) for _, a in in_parallel(find_launch, records)]
    return make_table(records, flown.theta, trims, flown.gaussians)
