"""The analysis of a campaign that `glider.sysid.pipeline` has read.

log -> inspect -> smooth -> signs -> search -> errors before and after -> verdict
"""

import dataclasses
import importlib.metadata
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np

from glider.campaign.checks.clocks import SCALE, check_limits
from glider.campaign.checks.inspection import Inspection
from glider.campaign.checks.masks import ALL, ExcludedRows
from glider.campaign.checks.planarity import describe_planarity
from glider.campaign.logs import Campaign
from glider.campaign.turning import Signs, turn_campaign
from glider.errors import InputError
from glider.physics.effects import ANGLE_SIGN
from glider.progress import Progress, Step
from glider.sysid import outcome, result
from glider.sysid.constants import EVIDENCE_THRESHOLD, MOST_LOST
from glider.sysid.derivatives import with_derivatives
from glider.sysid.evaluation import Evaluation, Searched, SmoothedFlights, evaluate
from glider.sysid.fit.prediction import beginning_rows
from glider.sysid.likelihood.blocks import BLOCKS
from glider.sysid.likelihood.candidates import survey
from glider.sysid.likelihood.model_fit import FitResult, fit_model
from glider.sysid.likelihood.outliers import find_extreme, find_outlying
from glider.sysid.likelihood.task import Task, make_task
from glider.sysid.likelihood.uncertainty import (
    alternatives_of,
    averaged,
    uncertainty_of,
)
from glider.sysid.replay.record import Record, prepare
from glider.sysid.replay.replayed import warm_up
from glider.sysid.replay.smoothing import Noise, measure_noise
from glider.sysid.replay.vehicle import Vehicle
from glider.sysid.search.signs import find_signs
from glider.sysid.search.tracing import trace
from glider.sysid.verdict import find_doubt, judge

SHARES = {
    **{"compile": 0.06, "signs": 0.08, "smooth": 0.12, "compare": 0.14, "trace": 0.15},
    **{"refit": 0.85, "predict": 0.89, "weigh": 0.98},
}
"""Usual shares of the time when the stages begin, measured on the samples."""

MOST_COMBINATIONS = 12  # Sets of effects that a result lists.

_UNLIKE = (
    "no model explains it with the others: its mean squared error is {:.3g} times the "
    "median (another clock, axis, unit or glider, or a hit?)"
)
"""Why a flight that stands out is excluded."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Analysis:
    """The stages in order, timed."""

    progress: Progress
    seconds: dict[str, float]  #: Stage to wall-clock time; each stage adds its own.
    inspection: Inspection  #: The campaign as it was read and checked.
    warnings: tuple[str, ...]  #: Sentences about it and what is tried.
    vehicle: Vehicle  #: Of the campaign.
    fitted: tuple[str, ...]  #: Names of the flights to fit.
    held_out: tuple[str, ...]  #: Names of those that errors are measured on.
    rng: np.random.Generator  #: Of all that is drawn at random.
    settings: dict[str, Any]  #: Of the run, for the report.

    @contextmanager
    def stage(self, name: str, words: str = "") -> Iterator[None]:
        """Times a stage and announces it."""
        self.progress(Step(words or name, SHARES[name]))
        begin = time.perf_counter()
        yield
        self.seconds[name] = time.perf_counter() - begin

    def run(self, kinds: tuple[str, ...]) -> result.Result:
        """Runs all stages, with these kinds of effects to try."""
        with self.stage("compile", "compile the dynamics (once; it takes ten seconds)"):
            warm_up(self.vehicle.layout)
        flights = self._smooth()
        found = self._search(flights, kinds)
        with self.stage("refit", "refitting the flat plate alone"):
            baseline = found.traced.bare
            if found.traced.forces is None:  # To the log as it is, signs and all.
                free = self.vehicle.baseline_slots
                baseline = dataclasses.replace(baseline, blocks=(), free=free)
                fitted = flights.among([r.name for r in found.task.records])
                baseline = fit_model(found.task.on(fitted.logged), baseline)
        with self.stage("predict", "predicting held-out flights"):
            spreads = outcome.spreads_of(found.task, found.traced.model)
            evaluation = evaluate(
                flights, self.held_out, found, baseline, spreads, self.rng
            )
        return self._result(flights, found, spreads, evaluation)

    def _smooth(self) -> SmoothedFlights:
        """Turns wrong signs back and smooths all flights."""
        effects = self.settings["effects"]
        logged, masks = self.inspection.campaign, self.inspection.masks

        def smoothed(campaign: Campaign) -> tuple[Noise, list[Record]]:
            noise, layout = measure_noise(campaign, masks), self.vehicle.layout
            return noise, prepare(campaign.flights, campaign, noise, layout, masks)

        signs = Signs()
        with self.stage("signs"):
            if effects is None or ANGLE_SIGN.kind in effects:
                few = tuple(f for f in logged.flights if f.name in self.fitted)
                signs = find_signs(logged, few, masks, self.vehicle)
        campaign = turn_campaign(logged, signs)
        check_limits(campaign, masks)
        with self.stage("smooth"):
            noise, records = smoothed(campaign)
            as_logged = records if signs.are_right else smoothed(logged)[1]
        return SmoothedFlights(
            campaign=campaign,
            signs=signs,
            noise=noise,
            corrected=records,
            logged=as_logged,
        )

    def _search(self, flights: SmoothedFlights, kinds: tuple[str, ...]) -> Searched:
        """Searches the effects that the flights to fit show, without outliers.

        Outliers among the flights to fit are excluded; those among the held-out flights
        are scored apart.
        """
        noise = flights.noise
        with self.stage("compare", "comparing flights"):
            everything = make_task(flights.corrected, self.vehicle, kinds)
            ratios = find_outlying(everything, noise)
            outlying = {name: _UNLIKE.format(r) for name, r in ratios.items()}
            everything, task = self._without(outlying, everything)
        with self.stage("trace"):
            traced = trace(task, noise, self.rng, self.progress)
            if extreme := find_extreme(everything, traced.model):
                again = sorted(r.name for r in task.records if r.name in extreme)
                everything, task = self._without(extreme, everything)
                outlying |= extreme
                if again:
                    self.progress(f"again without {', '.join(again)}")
                    traced = trace(task, noise, self.rng, self.progress)
        return Searched(
            everything=everything,
            task=task,
            traced=traced,
            outlying=outlying,
            extreme=extreme,
        )

    def _without(
        self, outlying: Mapping[str, str], everything: Task
    ) -> tuple[Task, Task]:
        """The task without flights that stand out, and that on the flights to fit."""
        kept = [r for r in everything.records if r.name not in outlying]
        fitted = [r for r in kept if r.name in self.fitted]
        if outlying and not 2 <= len(fitted) < len(kept):
            raise InputError(
                f"{self.inspection.campaign.path}: {', '.join(outlying)} cannot be "
                "flights of the same glider as the others, and too few are left to fit "
                "and to hold out."
            )
        return everything.on(kept), everything.on(fitted)

    def _result(
        self,
        flights: SmoothedFlights,
        found: Searched,
        spreads: dict[str, result.Spread],
        evaluation: Evaluation,
    ) -> result.Result:
        """Finds standard errors and the verdict, and collects all that was found."""
        task, traced, signs = found.task, found.traced, flights.signs
        model, folds = traced.model, evaluation.folds
        before, named, after = evaluation.tables
        with self.stage("weigh", "standard errors"):
            certain = uncertainty_of(task, traced.judged)
            carried = outcome.carried_of(task, model, certain)
            sets = alternatives_of(task, traced.judged, traced.rivals)
            known = averaged(sets)
        effects = outcome.effects_of(task, traced, known, carried, spreads, signs)
        covariance = outcome.covariance_of(task, known)
        left = _left(task, traced.judged, evaluation)
        doubt = find_doubt(task, model)
        for warning in self.warnings:
            if warning.startswith(SCALE) and "position_scale" not in model.kinds:
                doubt = doubt or warning.rstrip(".")
        verdict, reason = judge(traced, folds, evaluation.errors, effects, left, doubt)
        return with_derivatives(
            result.Result(
                **self._of_campaign(flights, found, evaluation, verdict),
                verdict=verdict,
                reason=reason,
                effects=effects,
                errors=evaluation.errors,
                outlying=evaluation.outlying,
                folds=() if folds is None else folds.folds,
                left=left,
                innovations=evaluation.innovations,
                candidates=traced.alone,
                combinations=tuple(
                    result.Combination(kinds=kinds, evidence=gain)
                    for kinds, gain in traced.combinations[:MOST_COMBINATIONS]
                ),
                evidence_threshold=traced.threshold,
                correlations=outcome.correlations_of(covariance, model.kinds),
                spreads=spreads,
                air=result.Air(
                    std_m_s=0.0 if model.scales.is_still else model.scales.air,
                    correlation_s=model.scales.air_time,
                ),
                curves=outcome.curves_of(before, named),
                vehicle=outcome.vehicle_of(task, model, known),
                model=outcome.model_of(task, model, signs, flights.campaign),
                covariance=covariance,
                alternatives=tuple(
                    result.Alternative(
                        probability=own.probability,
                        model=outcome.model_of(task, fit, signs, flights.campaign),
                        covariance=outcome.covariance_of(task, own.known),
                    )
                    for own, fit in zip(
                        sets, [model, *(fit for fit, _ in traced.rivals)], strict=True
                    )
                ),
                held_out=evaluation.held_out,
                residual_before=before,
                residual_after=after,
            )
        )

    def _of_campaign(
        self,
        flights: SmoothedFlights,
        found: Searched,
        evaluation: Evaluation,
        verdict: str,
    ) -> dict[str, Any]:
        """Fields of a result about the campaign and the run."""
        logged, noise = self.inspection.campaign, flights.noise
        outlying = found.outlying
        rolling = {f.name: describe_planarity(f) for f in logged.flights}
        rows = [s for s in self.inspection.excluded if s.file not in outlying]
        rows += [ExcludedRows(file=n, rows=ALL, why=w) for n, w in outlying.items()]
        return {
            "campaign": logged.name,
            "path": logged.path,
            "flights": result.FlightNames(
                fit=tuple(n for n in self.fitted if n not in outlying),
                held_out=tuple(f.name for f in evaluation.held_out),
            ),
            "knows_forces": self.vehicle.knows_forces,
            "warnings": tuple(self._warnings(flights, evaluation, verdict)),
            "set_aside": tuple(sorted(rows, key=lambda s: s.file)),
            "planarity": {name: words for name, words in rolling.items() if words},
            "noise": result.MeasurementNoise(
                position_m=noise.position, pitch_rad=noise.pitch
            ),
            "seconds": self.seconds,
            "version": importlib.metadata.version("drake-glider"),
            "own_effects": self.vehicle.layout.user_kinds,
            "seed": self.settings["seed"],
            "settings": self.settings,
        }

    def _warnings(
        self, flights: SmoothedFlights, evaluation: Evaluation, verdict: str
    ) -> Iterator[str]:
        """Yields sentences about the campaign and the result."""
        yield from self.warnings
        limits, stops = flights.campaign.elevator_limits, flights.corrected[0].limits
        if limits is not None and stops is not None and stops != limits:
            yield (
                f"The elevator passes its limits of {limits[0]:.3g} and "
                f"{limits[1]:.3g} rad: it is assumed to stop at {stops[0]:.3g} and "
                f"{stops[1]:.3g}."
            )
        is_measured = flights.campaign.servo.angle == "measured"
        for record in flights.corrected:
            rows = beginning_rows(record, per_flight_trims=False)
            if record.has_servo and is_measured and not record.seen[:rows, 3].any():
                yield (
                    f"{record.name}: no elevator row counts in the beginning of the "
                    "flight, which its launch is fitted on; the elevator is assumed "
                    "where its commands have it."
                )
        for name in evaluation.unpredicted:
            yield (
                f"{name}: every model diverges on this held-out flight; it is excluded "
                "from the errors."
            )
        if evaluation.folds is not None and verdict != "no_effect":
            gains = evaluation.folds.gain.values
            lost = int(np.sum(gains < 0.0))
            if lost > MOST_LOST * len(gains):
                yield f"The correction does not improve {lost} of {len(gains)} flights."


def _left(task: Task, model: FitResult, evaluation: Evaluation) -> result.Residual:
    """The residual of the corrected model, and what it varies with."""
    corrected, floor = (evaluation.errors[m] for m in ("corrected", result.PERFECT))
    assert corrected is not None and floor is not None
    gains = survey(task, model)
    real = [name for name, gain in gains.items() if gain > EVIDENCE_THRESHOLD]
    real.sort(key=lambda name: -gains[name])
    variables = [BLOCKS[name].variable for name in real[:3]]
    return result.Residual(
        position_m=corrected.position_rms_m,
        ratio_to_floor=corrected.position_rms_m / floor.position_rms_m,
        chance=evaluation.chance,
        depends_on=tuple(dict.fromkeys(variables)),
        air_depends_on=evaluation.air_depends_on,
    )
