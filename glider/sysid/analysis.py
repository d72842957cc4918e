"""The analysis of a campaign that `glider.sysid.pipeline` has read.

log -> inspect -> smooth -> signs -> trace -> errors before and after -> verdict
"""

import dataclasses
import importlib.metadata
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager

import numpy as np

from glider.campaign.checks.clocks import check_limits
from glider.campaign.checks.inspection import Inspection
from glider.campaign.checks.masks import ALL, ExcludedRows
from glider.campaign.checks.planarity import planarity
from glider.campaign.logs import Campaign
from glider.errors import InputError
from glider.sysid.fit.folds import HeldOut, flown_by, hold_out
from glider.sysid.fit.prediction import (
    Prediction,
    RolloutModel,
    beginning_rows,
    measure_errors,
)
from glider.sysid.likelihood.model_fit import FitResult, fit_model
from glider.sysid.likelihood.outliers import find_apart, find_outlying
from glider.sysid.likelihood.scales import FLOOR, NAMES
from glider.sysid.likelihood.task import Task, make_task
from glider.sysid.likelihood.uncertainty import uncertainty_of, with_allowed_curves
from glider.sysid.outcome import (
    carried_of,
    correlations_of,
    covariance_of,
    curves_of,
    effects_of,
    model_of,
    spreads_of,
    vehicle_of,
)
from glider.sysid.plausibility import find_doubt
from glider.sysid.replay.noise import Noise, measure_noise
from glider.sysid.replay.record import Record, prepare
from glider.sysid.replay.residual import make_table
from glider.sysid.replay.signs import Signs, turn_campaign
from glider.sysid.replay.vehicle import Vehicle
from glider.sysid.replay.warm_up import warm_up
from glider.sysid.result import (
    CALIBRATED,
    MODELS,
    Air,
    Combination,
    Errors,
    HeldOutFlight,
    Residual,
    ResidualTable,
    Result,
)
from glider.sysid.search.attitude import forces_alone
from glider.sysid.search.fields import survey
from glider.sysid.search.signs import find_signs
from glider.sysid.search.traced import SearchResult
from glider.sysid.search.tracing import FIELD_PRICE, trace
from glider.sysid.verdict import is_of_the_plate, judge

MOST_COMBINATIONS = 10
"""Sets of effects that a result lists."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Analysis:
    """The stages in order, timed.

    Attributes:
        progress: called with a line of text as the work goes on.
        seconds: stage to wall-clock time; each stage adds its own.
    """

    progress: Callable[[str], None]
    seconds: dict[str, float]

    @contextmanager
    def stage(self, name: str, words: str = "") -> Iterator[None]:
        """Times a stage and announces it."""
        self.progress(words or name)
        begin = time.perf_counter()
        yield
        self.seconds[name] = time.perf_counter() - begin

    def run(
        self,
        inspection: Inspection,
        names: tuple[tuple[str, ...], tuple[str, ...]],
        vehicle: Vehicle,
        kinds: tuple[str, ...],
        with_signs: bool,
        seed: int,
        settings: dict[str, object],
    ) -> Result:
        """Runs all stages.

        Args:
            inspection: the campaign as it was read and checked.
            names: of the flights to fit and of those held out.
            vehicle: of the campaign.
            kinds: of vehicle.kinds, those to try.
            with_signs: whether to look for angles of the other sign first.
            seed: of all that is drawn by lot.
            settings: what the caller asked for, to be kept in the result.
        """
        logged, masks = inspection.campaign, inspection.masks
        rng = np.random.default_rng(seed)
        with self.stage("compile", "compile the dynamics (once; it takes ten seconds)"):
            warm_up(vehicle.layout)
        with self.stage("signs"):
            signs = Signs()
            if with_signs:
                signs = find_signs(logged, _pick(logged, names[0]), masks, vehicle)
        campaign = turn_campaign(logged, signs)
        check_limits(campaign, masks)
        with self.stage("smooth"):
            noise = measure_noise(campaign, masks)
            records = _records(campaign, noise, vehicle, inspection)
        with self.stage("compare", "comparing flights"):
            everything = make_task(records, vehicle, kinds)
            ratios = find_outlying(everything, noise)
            strange = {name: _UNLIKE.format(ratio) for name, ratio in ratios.items()}
        with self.stage("trace"):
            everything, names = _among(everything, names, strange, campaign)
            task = _fitted(everything, names)
            traced = trace(task, noise, rng, self.progress)
            if apart := find_apart(everything, traced.model):
                self.progress(f"again without {', '.join(apart)}")
                strange |= apart
                everything, names = _among(everything, names, strange, campaign)
                task = _fitted(everything, names)
                traced = trace(task, noise, rng, self.progress)
        model, records = traced.model, list(everything.records)
        unseen = [r for r in records if r.name in names[1]]
        with self.stage("weigh", "standard errors"):
            judged = traced.judged
            carried = carried_of(task, model, uncertainty_of(task, judged))
            known = uncertainty_of(task, with_allowed_curves(task, judged))
            spreads = spreads_of(task, model)
        with self.stage("refit", "refitting the plate alone"):
            plate = self._plate(task, traced, signs, logged, noise, inspection)
        with self.stage("foretell", "predicting unseen flights"):
            flown = self._models(task, traced, plate)
            before = records
            if not signs.are_right:
                own = measure_noise(logged, masks)
                before = _records(logged, own, vehicle, inspection)
                before = [r for r in before if r.name not in strange]
            errors: dict[str, Errors | None] = {}
            predictions: dict[str, list[Prediction]] = {}
            for name, pilot in flown.items():
                seen = unseen if name == "corrected" else before
                seen = [r for r in seen if r.name in names[1]]
                errors[name], predictions[name] = measure_errors(pilot, seen)
            if not vehicle.is_known:
                errors["nominal"] = None
            held_out = None
            if signs.are_right:
                both = plate, model
                if traced.forces is not None:
                    forces = traced.forces
                    both = (
                        forces_alone(task, plate, forces),
                        forces_alone(task, model, forces),
                    )
                drawn = traced.plate if is_of_the_plate(model) else None
                if traced.forces is not None or not vehicle.is_known:
                    drawn = None
                held_out = hold_out(everything, *both, model.scales, rng, drawn)
            first = "nominal" if vehicle.is_known else "refitted"
            before_table = _table(flown[first], before)
            after_table = _table(flown["corrected"], records)
            named_table = after_table
            if model.has_curves or model.extra is not None:
                named = dataclasses.replace(model, coordinates=np.zeros(0), extra=None)
                named_table = _table(flown_by(task, named, model.scales), records)
        effects = effects_of(task, traced, known, carried, spreads, signs)
        corrected = errors["corrected"]
        assert corrected is not None
        left = _left(task, traced.judged, corrected, noise)
        doubt = find_doubt(task, model)
        verdict, reason = judge(
            traced, signs, carried, held_out, errors, effects, left, doubt
        )
        return Result(
            campaign=logged.name,
            path=logged.path,
            fit_flights=names[0],
            held_out_flights=names[1],
            verdict=verdict,
            reason=reason,
            effects=effects,
            errors=errors,
            folds=() if held_out is None else held_out.folds,
            left=left,
            candidates=traced.alone,
            combinations=tuple(
                Combination(kinds=kinds, evidence=gain)
                for kinds, gain in traced.combinations[:MOST_COMBINATIONS]
            ),
            correlations=correlations_of(task, model, known),
            spreads=spreads,
            air=_air(model),
            curves=curves_of(before_table, named_table),
            vehicle=vehicle_of(vehicle, model, known),
            knows_forces=vehicle.knows_forces,
            warnings=(
                *inspection.warnings,
                *_past_limits(campaign, records),
                *_warnings(held_out, verdict),
            ),
            set_aside=_set_aside(inspection, strange),
            planarity=_planarity(logged),
            noise_position_m=noise.position,
            noise_pitch_rad=noise.pitch,
            model=model_of(task, model, carried, signs, campaign),
            covariance=covariance_of(task, model, known),
            held_out=_flights(unseen, predictions, vehicle, signs),
            residual_before=before_table,
            residual_after=after_table,
            seconds=self.seconds,
            version=importlib.metadata.version("drake-glider"),
            own_effects=vehicle.layout.own,
            settings={**settings, "notes": list(vehicle.notes)},
        )

    def _plate(
        self,
        task: Task,
        traced: SearchResult,
        signs: Signs,
        logged: Campaign,
        noise: Noise,
        inspection: Inspection,
    ) -> FitResult:
        """Returns the flat plate with its own parameters refitted."""
        if traced.forces is not None:
            return traced.plate
        if not signs.are_right:  # It meets the log as it is, signs and all.
            names = {record.name for record in task.records}
            records = _records(logged, noise, task.vehicle, inspection)
            task = task.on([r for r in records if r.name in names])
        bare = dataclasses.replace(
            traced.plate, coordinates=np.zeros(0), free=task.vehicle.own
        )
        return fit_model(task, bare)

    def _models(
        self, task: Task, traced: SearchResult, plate: FitResult
    ) -> dict[str, RolloutModel]:
        """Returns the models whose errors are told, by name."""
        vehicle, layout = task.vehicle, task.layout
        offset = layout.slots_of("pitch_offset")
        calibrated = dataclasses.replace(
            plate, free=tuple(sorted({*plate.free, *offset}))
        )
        if traced.forces is not None:
            calibrated = forces_alone(task, calibrated, traced.forces)
        calibrated = fit_model(
            task,
            calibrated,
            iterations=4,
            free_scales=NAMES if traced.forces is None else (),
        )
        drawn = dataclasses.replace(plate, theta=vehicle.theta, free=())
        own = traced.model.scales
        return {
            "nominal": flown_by(task, drawn, own),
            "refitted": flown_by(task, plate, own),
            CALIBRATED: flown_by(task, calibrated, own),
            "corrected": flown_by(task, traced.model, own),
        }


def _air(model: FitResult) -> Air:
    """Returns how the air moves; what no log shows is still air."""
    scales = model.scales
    is_still = scales.air < STILL * FLOOR.air
    return Air(std_m_s=0.0 if is_still else scales.air, correlation_s=scales.air_time)


STILL = 2.0
"""Strength of the air over the least that is looked for, below which it is none."""


_UNLIKE = (
    "no model explains it with the others: its mean squared error is {:.3g} times that "
    "of the middle flight (another clock, axis, unit or glider, or a hit?)"
)
"""Why a flight that stands out is set aside."""


def _among(
    everything: Task,
    names: tuple[tuple[str, ...], tuple[str, ...]],
    strange: Mapping[str, str],
    campaign: Campaign,
) -> tuple[Task, tuple[tuple[str, ...], tuple[str, ...]]]:
    """Returns the task, and names to fit and held out, without strange flights."""
    fitted, unseen = (tuple(n for n in group if n not in strange) for group in names)
    if len(fitted) < 2 or not unseen:
        raise InputError(
            f"{campaign.path}: {', '.join(strange)} cannot be flights of the same "
            "glider as the others, and too few are left to fit and to hold out."
        )
    kept = [r for r in everything.records if r.name not in strange]
    return everything.on(kept), (fitted, unseen)


def _fitted(everything: Task, names: tuple[tuple[str, ...], tuple[str, ...]]) -> Task:
    """Returns the task on the flights to fit."""
    return everything.on([r for r in everything.records if r.name in names[0]])


def _set_aside(
    inspection: Inspection, strange: Mapping[str, str]
) -> tuple[ExcludedRows, ...]:
    """Returns all that is not used: rows that are faulty, flights that are strange."""
    rows = [s for s in inspection.set_aside if s.file not in strange]
    flights = [ExcludedRows(file=n, rows=ALL, why=why) for n, why in strange.items()]
    return tuple(sorted(rows + flights, key=lambda s: s.file))


def _pick(campaign: Campaign, names: tuple[str, ...]) -> tuple:
    return tuple(f for f in campaign.flights if f.name in names)


def _records(
    campaign: Campaign, noise: Noise, vehicle: Vehicle, inspection: Inspection
) -> list[Record]:
    return prepare(campaign.flights, campaign, noise, vehicle.layout, inspection.masks)


def _table(flown: RolloutModel, records: Sequence[Record]) -> ResidualTable:
    """Returns a model's residual over flights, each with the trim that it has."""
    predictions = measure_errors(flown, records)[1]
    trims = [predicted.trim for predicted in predictions]
    return make_table(records, flown.theta, trims, flown.field)


def _left(task: Task, model: FitResult, corrected: Errors, noise: Noise) -> Residual:
    """Returns what the corrected model leaves, and over what it varies."""
    found = survey(task, model).gains
    real = [key for key, gain in found.items() if gain > FIELD_PRICE]
    real.sort(key=lambda key: -found[key])
    return Residual(
        ratio_to_noise=corrected.position_rms_m / (math.sqrt(2.0) * noise.position),
        position_m=corrected.position_rms_m,
        depends_on=tuple(dict.fromkeys(variable for _, variable in real[:3])),
    )


def _past_limits(campaign: Campaign, records: Sequence[Record]) -> tuple[str, ...]:
    """Returns that the elevator passes its limits, where it does."""
    told, stops = campaign.elevator_limits, records[0].limits
    if told is None or stops is None or stops == told:
        return ()
    return (
        f"The elevator passes its limits of {told[0]:.3g} and {told[1]:.3g} rad: "
        f"it is taken to stop at {stops[0]:.3g} and {stops[1]:.3g}.",
    )


def _warnings(held_out: HeldOut | None, verdict: str) -> tuple[str, ...]:
    if held_out is None or verdict == "no_effect":
        return ()
    count = len(held_out.gain)
    lost = int(np.sum(held_out.gain < 0.0))
    if count and lost > 0.25 * count:
        return (f"{lost} of {count} held-out flights do not gain by the correction.",)
    return ()


def _planarity(campaign: Campaign) -> dict[str, str]:
    found = {f.name: planarity(f) for f in campaign.flights}
    return {name: p.sentence for name, p in found.items() if p is not None}


def _flights(
    records: Sequence[Record],
    predictions: dict[str, list[Prediction]],
    vehicle: Vehicle,
    signs: Signs,
) -> tuple[HeldOutFlight, ...]:
    """Returns the held-out flights as logged, beside what each model predicted."""
    flights = []
    turned = np.array([1.0, 1.0, signs.pitch])
    as_logged = {"corrected": turned}
    for i, record in enumerate(records):
        rows = beginning_rows(record, not vehicle.trim_is_known)
        flights.append(
            HeldOutFlight(
                name=record.name,
                time=record.time,
                measured=record.pose * turned,
                flown={
                    name: predictions[name][i].pose * as_logged.get(name, 1.0)
                    for name in MODELS
                    if name != "nominal" or vehicle.is_known
                },
                fitted_until=float(record.time[rows - 1]),
            )
        )
    return tuple(flights)
