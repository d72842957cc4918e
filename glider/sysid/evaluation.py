"""Errors of all models on flights that they were not fitted to."""

import dataclasses
from collections.abc import Collection, Mapping, Sequence

import numpy as np

from glider.sysid.fit import prediction
from glider.sysid.fit.folds import HeldOut, flown_by, hold_out, predictable
from glider.sysid.likelihood.model_fit import FitResult, fit_model
from glider.sysid.likelihood.scales import NAMES
from glider.sysid.likelihood.task import Task
from glider.sysid.replay.record import Record
from glider.sysid.replay.residual import make_table
from glider.sysid.replay.signs import Signs
from glider.sysid.result import (
    CALIBRATED,
    MODELS,
    Errors,
    HeldOutFlight,
    OutlyingFlights,
    ResidualTable,
)
from glider.sysid.search.force_search import forces_alone
from glider.sysid.search.support import SearchResult
from glider.sysid.verdict import changes_baseline_alone


@dataclasses.dataclass(frozen=True, kw_only=True)
class FlownRecords:
    """Flights as the corrected model takes them, and as those before it do.

    They differ where angles were logged with the other sign.
    """

    corrected: Sequence[Record]  # With the signs turned.
    logged: Sequence[Record]  # As they were logged, in the same order.

    def of(self, model: str) -> Sequence[Record]:
        """Returns the flights for a model, by its name."""
        return self.corrected if model == "corrected" else self.logged

    def among(self, names: Collection[str]) -> "FlownRecords":
        """Returns some of the flights."""
        return FlownRecords(
            corrected=[r for r in self.corrected if r.name in names],
            logged=[r for r in self.logged if r.name in names],
        )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the flights."""
        return tuple(record.name for record in self.corrected)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Evaluation:
    """Errors of models, by name."""

    errors: dict[str, Errors | None]  # On held-out flights.
    held_out: tuple[HeldOutFlight, ...]  # Those flights, measured and flown.
    # Names of held-out flights on which every model diverges.
    unpredicted: tuple[str, ...]
    # Errors on held-out flights that stand out; None without any.
    outlying: OutlyingFlights | None


def evaluate(
    models: Mapping[str, prediction.RolloutModel],
    unseen: FlownRecords,
    outlying: FlownRecords,
    signs: Signs,
) -> Evaluation:
    """Predicts held-out flights by all models."""
    predictions = {
        name: prediction.measure_errors(model, unseen.of(name))[1]
        for name, model in models.items()
    }
    keep = predictable(list(predictions.values())) or range(len(unseen.names))
    predictions = {name: [p[i] for i in keep] for name, p in predictions.items()}
    kept = unseen.among([unseen.names[i] for i in keep])
    errors: dict[str, Errors | None] = {
        name: prediction.errors_of(model, kept.of(name), predictions[name])
        for name, model in models.items()
    }
    apart = None
    if outlying.names:
        apart = OutlyingFlights(
            flights=outlying.names,
            errors={
                name: prediction.measure_errors(model, outlying.of(name))[0]
                for name, model in models.items()
            },
        )
    per_flight_trims = models["corrected"].per_flight_trims
    return Evaluation(
        errors=errors,
        held_out=_flights(kept.corrected, predictions, per_flight_trims, signs),
        unpredicted=tuple(n for n in unseen.names if n not in kept.names),
        outlying=apart,
    )


def rollout_models(
    task: Task, traced: SearchResult, baseline: FitResult
) -> dict[str, prediction.RolloutModel]:
    """Returns the models to evaluate, by name; the nominal one only where known."""
    vehicle, layout = task.vehicle, task.layout
    offset = layout.slots_of("pitch_offset")
    calibrated = dataclasses.replace(
        baseline, free=tuple(sorted({*baseline.free, *offset}))
    )
    if traced.forces is not None:
        calibrated = forces_alone(task, calibrated, traced.forces)
    free_scales = NAMES if traced.forces is None else ()
    calibrated = fit_model(task, calibrated, iterations=4, free_scales=free_scales)
    nominal = dataclasses.replace(baseline, theta=vehicle.theta, free=())
    fitted = {"nominal": nominal} if vehicle.is_known else {}
    fitted |= {"refitted": baseline, CALIBRATED: calibrated, "corrected": traced.model}
    scales = traced.model.scales
    return {name: flown_by(task, model, scales) for name, model in fitted.items()}


def evaluate_in_folds(
    everything: Task,
    task: Task,
    traced: SearchResult,
    baseline: FitResult,
    rng: np.random.Generator,
) -> HeldOut:
    """Holds out each flight once, baseline and corrected model refitted."""
    corrected, nominal = traced.model, None
    if traced.forces is not None:
        baseline = forces_alone(task, baseline, traced.forces)
        corrected = forces_alone(task, corrected, traced.forces)
    elif task.vehicle.is_known and changes_baseline_alone(traced.model):
        nominal = traced.bare
    searched = {record.name for record in task.records}
    scales = traced.model.scales
    return hold_out(everything, baseline, corrected, scales, rng, searched, nominal)


def residual_tables(
    task: Task,
    model: FitResult,
    models: Mapping[str, prediction.RolloutModel],
    records: FlownRecords,
) -> tuple[ResidualTable, ResidualTable, ResidualTable]:
    """Returns the residual of the nominal, of the named and of the corrected model."""
    before = models.get("nominal", models["refitted"])
    after = _table(models["corrected"], records.corrected)
    named = after
    if model.has_curves or model.extra is not None:
        bare = dataclasses.replace(model, coordinates=np.zeros(0), extra=None)
        named = _table(flown_by(task, bare, model.scales), records.corrected)
    return _table(before, records.logged), named, after


def _table(flown: prediction.RolloutModel, records: Sequence[Record]) -> ResidualTable:
    """Returns a model's residual over flights, each with the trim that it has."""
    predictions = prediction.measure_errors(flown, records)[1]
    trims = [predicted.trim for predicted in predictions]
    return make_table(records, flown.theta, trims, flown.field)


def _flights(
    records: Sequence[Record],
    predictions: Mapping[str, list[prediction.Prediction]],
    per_flight_trims: bool,
    signs: Signs,
) -> tuple[HeldOutFlight, ...]:
    """Returns the held-out flights as logged, beside what each model predicted."""
    flights = []
    turned = np.array([1.0, 1.0, signs.pitch])
    as_logged = {"corrected": turned}
    for i, record in enumerate(records):
        rows = prediction.beginning_rows(record, per_flight_trims)
        flights.append(
            HeldOutFlight(
                name=record.name,
                time=record.time,
                measured=record.pose * turned,
                flown={
                    name: predictions[name][i].pose * as_logged.get(name, 1.0)
                    for name in MODELS
                    if name in predictions
                },
                fitted_until=float(record.time[rows - 1]),
            )
        )
    return tuple(flights)
