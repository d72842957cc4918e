"""Errors of all models on flights that they were not fitted to."""

import dataclasses
from collections.abc import Collection, Mapping, Sequence

import numpy as np

from glider.campaign.logs import Campaign
from glider.sysid import result
from glider.sysid.constants import FLOOR_FLIGHTS
from glider.sysid.fit import prediction
from glider.sysid.fit.floor import air_depends_on, find_floor
from glider.sysid.fit.folds import HeldOut, flown_by, hold_out, predictable
from glider.sysid.likelihood.model_fit import FitResult, error_flights, fit_model
from glider.sysid.likelihood.scales import FLOOR, NAMES, Scales, whiten
from glider.sysid.likelihood.task import Task
from glider.sysid.outcome import SPREAD_KINDS
from glider.sysid.replay.record import Record, Signs
from glider.sysid.replay.replayed import make_table, signals
from glider.sysid.replay.smoothing import Noise
from glider.sysid.result import CALIBRATED, MODELS, PERFECT, ResidualTable
from glider.sysid.search.force_search import OF_FORCES, forces_alone
from glider.sysid.search.support import SearchResult
from glider.sysid.verdict import AllErrors, changes_baseline_alone

Models = Mapping[str, prediction.RolloutModel]
"""Models by name; the nominal one only where it is known."""

CHANNELS = ("x", "z", "pitch")
_LAGS = 25  # Largest lag of innovations [rows], in flights of three times as many.
_Z95 = 1.96  # Standard deviations that 95 % of normal errors are within.

Tables = tuple[ResidualTable, ResidualTable, ResidualTable]
"""Residual of the nominal model, of the named effects and of the corrected model."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class SmoothedFlights:
    """Flights as the corrected model takes them, and as those before it do.

    They differ where angles were logged with the other sign.
    """

    campaign: Campaign  #: With wrong signs turned.
    signs: Signs  #: Of the logged angles.
    noise: Noise  #: Of the sensors.
    corrected: Sequence[Record]  #: With the signs turned.
    logged: Sequence[Record]  #: As they were logged, in the same order.

    def of(self, model: str) -> Sequence[Record]:
        """Returns the flights for a model, by its name."""
        return self.corrected if model == "corrected" else self.logged

    def among(self, names: Collection[str]) -> "SmoothedFlights":
        """Returns some of the flights."""
        return dataclasses.replace(
            self,
            corrected=[r for r in self.corrected if r.name in names],
            logged=[r for r in self.logged if r.name in names],
        )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the flights."""
        return tuple(record.name for record in self.corrected)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Evaluation:
    """Errors of models, by name; None of a model that there is not."""

    errors: AllErrors  #: On held-out flights.
    held_out: tuple[result.HeldOutFlight, ...]  #: Those flights, measured and flown.
    unpredicted: tuple[str, ...]  #: Names of those on which every model diverges.
    outlying: result.OutlyingFlights | None  #: Errors on those that stand out, if any.
    folds: HeldOut | None  #: Each flight held out once; None where signs are wrong.
    innovations: result.Innovations  #: Of the held-out flights.
    tables: Tables
    chance: float  #: Probability that a perfect model leaves as much.
    air_depends_on: tuple[str, ...]  #: States that the gusts of the model depend on.


def evaluate(
    flights: SmoothedFlights,
    held_out: Collection[str],
    outlying: Collection[str],
    everything: Task,
    task: Task,
    traced: SearchResult,
    baseline: FitResult,
    spreads: Mapping[str, result.Spread],
    rng: np.random.Generator,
) -> Evaluation:
    """Predicts held-out flights by all models.

    Args:
        flights: all of them.
        held_out: names of those that errors are measured on.
        outlying: names of held-out flights that stand out.
        everything: task on all flights that do not stand out.
        task: on the flights that were fitted.
        traced: the corrected model.
        baseline: refitted to those flights.
        spreads: flight-to-flight variation that is reported.
        rng: of the folds and of the floor.
    """
    fitted = _fitted_models(task, traced, baseline)
    scales = traced.model.scales
    models = {name: flown_by(task, model, scales) for name, model in fitted.items()}
    unseen, apart = flights.among(held_out), flights.among(outlying)
    predictions = {
        name: prediction.predict_all(model, unseen.of(name))
        for name, model in models.items()
    }
    keep = predictable(list(predictions.values())) or range(len(unseen.names))
    kept = unseen.among([unseen.names[i] for i in keep])
    errors: AllErrors = dict.fromkeys((*MODELS, CALIBRATED))
    of_outlying: AllErrors = {}
    for name, model in models.items():
        predictions[name] = [predictions[name][i] for i in keep]
        errors[name] = prediction.errors_of(model, kept.of(name), predictions[name])
        if apart.names:
            of_outlying[name] = prediction.measure_errors(model, apart.of(name))
    folds = None
    if flights.signs.are_right:
        folds = _hold_out(everything, task, traced, baseline, rng)
    explained = flights.among([record.name for record in everything.records])
    tables = _residual_tables(task, traced.model, models, explained)
    gusts = air_depends_on(task, traced.model)
    truth = without_model_errors(traced, gusts, spreads)
    smoothing = flights.noise.smoothing[2].ratio
    is_other = [record.name not in kept.names for record in everything.records]
    order = np.argsort(is_other, kind="stable")[:FLOOR_FLIGHTS]
    records = [everything.records[i] for i in order]
    floor = find_floor(models["corrected"], records, truth, smoothing, rng)
    noise = _noise_of(tables[-1], kept.names)
    errors[PERFECT] = floor.errors(noise, len(kept.names))
    return Evaluation(
        errors=errors,
        held_out=_flights(kept, predictions, models["corrected"].per_flight_trims),
        unpredicted=tuple(n for n in unseen.names if n not in kept.names),
        outlying=result.OutlyingFlights(flights=apart.names, errors=of_outlying)
        if of_outlying
        else None,
        folds=folds,
        innovations=_innovations(task, fitted, kept),
        tables=tables,
        chance=np.nan if folds is None else floor.chance(folds.paths[order, 1]),
        air_depends_on=gusts,
    )


def without_model_errors(
    traced: SearchResult, gusts: Collection[str], spreads: Mapping[str, result.Spread]
) -> Scales:
    """Scales without errors of the model: sensors, turbulence, per-flight constants.

    Where a search of forces set the constants' scales, only reported spreads are known,
    and gusts are not distinguished from errors of the forces: they count as these.
    """
    unknown = {"air"} if gusts else set()
    if traced.forces is not None:
        unknown = {"air", *OF_FORCES}
    stds = {scale: getattr(FLOOR, scale) for scale in unknown}
    stds |= {SPREAD_KINDS[kind][0]: spread.std for kind, spread in spreads.items()}
    return dataclasses.replace(traced.model.scales, **stds)


def _noise_of(table: ResidualTable, names: Collection[str]) -> result.EquationErrors:
    """What the smoothing lets through of the noise, on some flights."""
    rows = np.isin(np.array(table.names)[table.flight], list(names))
    noise = np.sqrt(np.mean(table.noise[rows] ** 2, axis=0)).tolist()
    return result.EquationErrors(tangential=noise[0], normal=noise[1], pitch=noise[2])


def _fitted_models(
    task: Task, traced: SearchResult, baseline: FitResult
) -> dict[str, FitResult]:
    """The models to evaluate, by name."""
    vehicle, offset = task.vehicle, task.layout.slots_of("pitch_offset")
    calibrated = dataclasses.replace(
        baseline, free=tuple(sorted({*baseline.free, *offset}))
    )
    if traced.forces is not None:
        calibrated = forces_alone(task, calibrated, traced.forces)
    free_scales = NAMES if traced.forces is None else ()
    calibrated = fit_model(task, calibrated, iterations=4, free_scales=free_scales)
    fitted = {"refitted": baseline, CALIBRATED: calibrated, "corrected": traced.model}
    if vehicle.is_known:
        nominal = dataclasses.replace(baseline, theta=vehicle.theta, free=())
        fitted = {"nominal": nominal, **fitted}
    return fitted


def _hold_out(
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


def _residual_tables(
    task: Task, model: FitResult, models: Models, flights: SmoothedFlights
) -> Tables:
    before = models.get("nominal", models["refitted"])
    after = _table(models["corrected"], flights.corrected)
    named = after
    if model.blocks:
        bare = dataclasses.replace(model, blocks=())
        named = _table(flown_by(task, bare, model.scales), flights.corrected)
    return _table(before, flights.logged), named, after


def _table(flown: prediction.RolloutModel, records: Sequence[Record]) -> ResidualTable:
    """A model's residual over flights, each with the trim that it has."""
    trims = [own.trim for own in prediction.predict_all(flown, records)]
    return make_table(records, flown.theta, trims, flown.field)


def _flights(
    flights: SmoothedFlights,
    predictions: Mapping[str, list[prediction.Prediction]],
    per_flight_trims: bool,
) -> tuple[result.HeldOutFlight, ...]:
    """Held-out flights as logged, beside what each model predicted."""
    found = []
    turned = np.array([1.0, 1.0, flights.signs.pitch])
    for i, record in enumerate(flights.corrected):
        rows = prediction.beginning_rows(record, per_flight_trims)
        flown = {
            name: predictions[name][i].pose for name in MODELS if name in predictions
        }
        flown["corrected"] = flown["corrected"] * turned
        found.append(
            result.HeldOutFlight(
                name=record.name,
                time=record.time,
                measured=record.pose * turned,
                flown=flown,
                fitted_until=float(record.time[rows - 1]),
            )
        )
    return tuple(found)


def _innovations(
    task: Task, models: Mapping[str, FitResult], flights: SmoothedFlights
) -> result.Innovations:
    """Correlates innovations of models with themselves and with the elevator."""
    own: dict[str, dict[str, np.ndarray]] = {}
    moved: dict[str, dict[str, np.ndarray]] = {}
    for name in ("refitted", "corrected"):
        model, records = models[name], flights.of(name)
        linear = error_flights(task.on(records), model)
        left = [whiten(f, model.scales).innovations[:, :3, 0] for f in linear]
        lags = min(_LAGS, min(map(len, left)) // 3)
        own[name] = correlations(left, left, lags)
        if all(record.has_servo for record in records):
            elevator = [signals(record, model.theta).logged for record in records]
            turned = [(angle - angle.mean())[:, None] for angle in elevator]
            moved[name] = correlations(left, turned, lags)
    rows = sum(np.sum(record.seen[:, 0]) for record in records)
    return result.Innovations(
        lag_s=float(np.median(np.diff(records[0].time))) * np.arange(lags + 1),
        band=float(_Z95 / np.sqrt(rows)),
        autocorrelation=own,
        with_elevator=moved,
    )


def correlations(
    late: Sequence[np.ndarray], early: Sequence[np.ndarray], lags: int
) -> dict[str, np.ndarray]:
    """Correlations of columns (n, 3) with earlier ones: by channel, (lags + 1,)."""
    sums = [
        sum(
            np.sum(a[k:] * b[: len(b) - k], axis=0)
            for a, b in zip(late, early, strict=True)
        )
        for k in range(lags + 1)
    ]
    squares = [sum(np.sum(c**2, axis=0) for c in columns) for columns in (late, early)]
    found = np.array(sums) / np.sqrt(squares[0] * squares[1])
    return dict(zip(CHANNELS, found.T, strict=True))
