"""Errors of all models on flights that they were not fitted to."""

import dataclasses
from collections.abc import Collection, Mapping, Sequence

import numpy as np

from glider.campaign.logs import Campaign
from glider.campaign.turning import Signs
from glider.sysid import result
from glider.sysid.constants import FLOOR_FLIGHTS
from glider.sysid.fit.floor import air_depends_on, find_floor
from glider.sysid.fit.folds import HeldOut, hold_out
from glider.sysid.fit.prediction import (
    Prediction,
    RolloutModel,
    beginning_rows,
    compare,
    flown_by,
    measure_errors,
    predict_all,
)
from glider.sysid.likelihood.model_fit import FitResult, error_flights, fit_model
from glider.sysid.likelihood.scales import FLOOR, NAMES, Scales, whiten
from glider.sysid.likelihood.task import Task
from glider.sysid.outcome import SPREAD_KINDS
from glider.sysid.replay.record import Record
from glider.sysid.replay.replayed import make_table, signals
from glider.sysid.replay.smoothing import Noise
from glider.sysid.result import CALIBRATED, MODELS, PERFECT, ResidualTable
from glider.sysid.search.force_search import OF_FORCES, forces_alone
from glider.sysid.search.support import SearchResult
from glider.sysid.verdict import AllErrors, changes_baseline_alone

Models = Mapping[str, RolloutModel]
"""Models by name; the nominal one only where it is known."""

CHANNELS = ("x", "z", "pitch")
_LAGS = 25  # Largest lag of innovations [rows], in flights of three times as many.
_Z95 = 1.96  # Standard deviations that 95 % of normal errors are within.


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
class Searched:
    """What a search found, and on which flights; without those that stand out."""

    everything: Task  #: On all flights.
    task: Task  #: On those to fit.
    traced: SearchResult
    outlying: Mapping[str, str]  #: Names of flights that stand out, and why.
    extreme: Collection[str]  #: Those of them that only the corrected model excludes.


@dataclasses.dataclass(frozen=True, kw_only=True)
class Evaluation:
    """Errors of models, by name; None of a model that there is not."""

    errors: AllErrors  #: On held-out flights.
    held_out: tuple[result.HeldOutFlight, ...]  #: Those flights, measured and flown.
    unpredicted: tuple[str, ...]  #: Names of those on which every model diverges.
    outlying: result.OutlyingFlights | None  #: Errors on those that stand out, if any.
    folds: HeldOut | None  #: Each flight held out once; None where signs are wrong.
    innovations: result.Innovations  #: Of the held-out flights.
    #: Residual of the nominal model, of named effects and of the corrected model.
    tables: tuple[ResidualTable, ResidualTable, ResidualTable]
    chance: float  #: Probability that a perfect model leaves as much.
    air_depends_on: tuple[str, ...]  #: States that the gusts of the model depend on.


def evaluate(
    flights: SmoothedFlights,
    held_out: Collection[str],
    searched: Searched,
    baseline: FitResult,
    spreads: Mapping[str, result.Spread],
    rng: np.random.Generator,
) -> Evaluation:
    """Predicts held-out flights, whose names are given, by all models.

    The folds score flights that only the corrected model takes for outlying, but fit
    none to them.
    """
    task, traced = searched.task, searched.traced
    fitted, scales = _fitted_models(task, traced, baseline), traced.model.scales
    models = {name: flown_by(task, model, scales) for name, model in fitted.items()}
    usual = flights.among([record.name for record in searched.everything.records])
    unseen = usual.among(held_out)
    found = compare([*models.values()], [unseen.of(name) for name in models])
    kept = unseen.among([unseen.names[i] for i in found.kept])
    predictions = dict(zip(models, found.predictions, strict=True))
    folds = None
    if flights.signs.are_right:
        scored = flights.among({*usual.names, *searched.extreme}).corrected
        folds = _hold_out(task.on(scored), traced, baseline, searched.extreme, rng)
    tables = _residual_tables(task, traced.model, models, usual)
    gusts = air_depends_on(task, traced.model)
    truth = without_model_errors(traced, gusts, spreads)
    smoothing = flights.noise.smoothing[2].ratio
    first = sorted(usual.corrected, key=lambda record: record.name not in kept.names)
    first = first[:FLOOR_FLIGHTS]
    floor = find_floor(models["corrected"], first, truth, smoothing, rng)
    perfect = floor.errors(_noise_of(tables[-1], kept.names), len(kept.names))
    found_errors = dict(zip(models, found.errors, strict=True))
    return Evaluation(
        errors=dict.fromkeys((*MODELS, CALIBRATED)) | found_errors | {PERFECT: perfect},
        held_out=_flights(unseen, found.kept, predictions, models["corrected"]),
        unpredicted=tuple(n for n in unseen.names if n not in kept.names),
        outlying=_outlying(models, flights.among(set(held_out) - set(usual.names))),
        folds=folds,
        innovations=_innovations(task, fitted, kept),
        tables=tables,
        chance=np.nan
        if folds is None
        else floor.chance(np.array([folds.paths[record.name][1] for record in first])),
        air_depends_on=gusts,
    )


def _outlying(
    models: Models, flights: SmoothedFlights
) -> result.OutlyingFlights | None:
    """Errors on flights that stand out, if any."""
    if not flights.names:
        return None
    errors: AllErrors = {n: measure_errors(m, flights.of(n)) for n, m in models.items()}
    return result.OutlyingFlights(flights=flights.names, errors=errors)


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
    task: Task,
    traced: SearchResult,
    baseline: FitResult,
    extreme: Collection[str],
    rng: np.random.Generator,
) -> HeldOut:
    """Holds out each flight once, baseline and corrected model refitted."""
    corrected, nominal = traced.model, None
    if traced.forces is not None:
        baseline = forces_alone(task, baseline, traced.forces)
        corrected = forces_alone(task, corrected, traced.forces)
    elif task.vehicle.is_known and changes_baseline_alone(traced.model):
        nominal = traced.bare
    scales = traced.model.scales
    return hold_out(task, baseline, corrected, scales, rng, extreme, nominal)


def _residual_tables(
    task: Task, model: FitResult, models: Models, flights: SmoothedFlights
) -> tuple[ResidualTable, ResidualTable, ResidualTable]:
    before = models.get("nominal", models["refitted"])
    after = _table(models["corrected"], flights.corrected)
    named = after
    if model.blocks:
        bare = dataclasses.replace(model, blocks=())
        named = _table(flown_by(task, bare, model.scales), flights.corrected)
    return _table(before, flights.logged), named, after


def _table(flown: RolloutModel, records: Sequence[Record]) -> ResidualTable:
    """A model's residual over flights, each with the trim that it has."""
    trims = [own.trim for own in predict_all(flown, records)]
    return make_table(records, flown.theta, trims, flown.field)


def _flights(
    flights: SmoothedFlights,
    kept: Collection[int],
    predictions: Mapping[str, list[Prediction]],
    corrected: RolloutModel,
) -> tuple[result.HeldOutFlight, ...]:
    """Held-out flights that are kept as logged, beside what each model predicted."""
    found, turned = [], np.array([1.0, 1.0, flights.signs.pitch])
    for i in kept:
        record = flights.corrected[i]
        rows = beginning_rows(record, corrected.per_flight_trims)
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
    pairs = list(zip(late, early, strict=True))
    sums = [
        sum(np.sum(a[k:] * b[: len(b) - k], axis=0) for a, b in pairs)
        for k in range(lags + 1)
    ]
    squares = [sum(np.sum(c**2, axis=0) for c in columns) for columns in (late, early)]
    found = np.array(sums) / np.sqrt(squares[0] * squares[1])
    return dict(zip(CHANNELS, found.T, strict=True))
