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
from scipy.special import softmax

from glider.campaign.checks.masks import ALL, ExcludedRows, Inspection
from glider.campaign.checks.rates import SCALE
from glider.campaign.checks.servo_fit import identify_servo
from glider.campaign.logs import Campaign
from glider.campaign.turning import Signs, turn_campaign
from glider.compiled.warm_up import warm_up
from glider.errors import InputError
from glider.physics.effects import ANGLE_SIGN, POSITION_SCALE
from glider.progress import Progress, Step
from glider.sysid import outcome, result
from glider.sysid.constants import FOLDS
from glider.sysid.derivatives import with_derivatives
from glider.sysid.evaluation import Searched, SmoothedFlights, evaluate
from glider.sysid.fit.folds import HeldOut
from glider.sysid.likelihood.model_fit import fit_model
from glider.sysid.likelihood.outliers import find_extreme, find_outlying
from glider.sysid.likelihood.task import Task, make_task
from glider.sysid.likelihood.uncertainty import averaged, uncertainty_of
from glider.sysid.replay.record import Noise, Record, measure_noise, prepare
from glider.sysid.replay.vehicle import Vehicle, make_vehicle
from glider.sysid.search.signs import find_signs
from glider.sysid.search.tracing import trace
from glider.sysid.verdict import find_doubt, judge, with_excluded

SHARES = {
    **{"compile": 0.06, "signs": 0.08, "smooth": 0.12, "compare": 0.14, "trace": 0.15},
    **{"refit": 0.85, "predict": 0.89, "weigh": 0.98},
}
"""Usual shares of the time when the stages begin, measured on the samples."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Analysis:
    """The stages in order, timed."""

    progress: Progress
    seconds: dict[str, float]  #: Stage to wall-clock time; each stage adds its own.
    inspection: Inspection  #: The campaign as it was read and checked.
    vehicle: Vehicle  #: Of the campaign.
    kinds: tuple[str, ...]  #: Of effects to try.
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

    def run(self) -> result.Result:
        """Runs all stages."""
        with self.stage("compile", "compile the dynamics (once; it takes ten seconds)"):
            warm_up(self.vehicle.space)
        found = self._search(self._smooth())
        with self.stage("refit", "refitting the flat plate alone"):
            baseline = found.traced.bare
            fitted = [r.name for r in found.task.records]
            if found.traced.forces is None:  # To the log as it is, signs and all.
                logged = found.task.on(found.flights.of("refitted", fitted))
                free = self.vehicle.baseline_slots
                baseline = fit_model(logged, dataclasses.replace(baseline, free=free))
        with self.stage("predict", "predicting held-out flights"):
            spreads = outcome.spreads_of(found.task, found.traced.model)
            evaluated, folds = evaluate(
                found, self.held_out, baseline, spreads, self.rng
            )
        with self.stage("weigh", "standard errors"):
            of_model = self._weigh(found, spreads)
        flown = tuple(flight.name for flight in evaluated["held_out"])
        of_run = self._of_run(found, flown)
        judged = self._judge(found, of_run | evaluated | of_model, folds)
        whole = result.Result(**of_run, **evaluated, **of_model, **judged)
        return with_derivatives(whole)

    def _smooth(self) -> SmoothedFlights:
        """Turns wrong signs back and smooths all flights."""
        effects = self.settings["effects"]
        logged = self.inspection.campaign
        masks = self.inspection.masks

        def smoothed(campaign: Campaign) -> tuple[Noise, dict[str, Record]]:
            noise = measure_noise(campaign, masks)
            space = self.vehicle.space
            records = prepare(campaign.flights, campaign, noise, space, masks)
            return noise, {record.name: record for record in records}

        signs = Signs()
        with self.stage("signs"):
            if effects is None or ANGLE_SIGN.kind in effects:
                few = tuple(f for f in logged.flights if f.name in self.fitted)
                signs = find_signs(logged, few, masks, self.vehicle)
        campaign = turn_campaign(logged, signs)
        campaign, of_servo = identify_servo(campaign, masks)
        with self.stage("smooth"):
            noise, records = smoothed(campaign)
            as_logged = records if signs.are_right else smoothed(logged)[1]
        return SmoothedFlights(campaign, signs, noise, records, as_logged, of_servo)

    def _search(self, flights: SmoothedFlights) -> Searched:
        """Searches the effects that the flights to fit show, without outliers.

        Outliers among the flights to fit are excluded; those among the held-out flights
        are scored apart.
        """
        noise = flights.noise
        records = [*flights.corrected.values()]
        with self.stage("compare", "comparing flights"):
            vehicle = make_vehicle(flights.campaign, self.vehicle.space)
            everything = make_task(records, vehicle, self.kinds)
            outlying = {
                name: "explained by no model with the others: its mean square is "
                f"{ratio:.3g} times the median (another clock, axis, unit or glider, "
                "or a hit?)"
                for name, ratio in find_outlying(everything, noise).items()
            }
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
        return Searched(flights, everything, task, traced, outlying, extreme)

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

    def _weigh(
        self, found: Searched, spreads: dict[str, result.Spread]
    ) -> dict[str, Any]:
        """Fields of a result about the model, with standard errors."""
        task = found.task
        traced = found.traced
        signs = found.flights.signs
        rivals = [rival for rival, _ in traced.rivals]
        probabilities = softmax([0.0, *(-lack for _, lack in traced.rivals)]).tolist()
        judged = [traced.judged, *rivals]
        errors = [uncertainty_of(task, model) for model in judged]
        known = averaged(probabilities, judged, errors)
        covariance = outcome.covariance_of(task, known)
        kinds = traced.model.kinds
        models = [traced.model, *rivals]
        alternatives = [
            result.Alternative(
                probability=probability,
                model=outcome.model_of(task, model, signs),
                covariance=outcome.covariance_of(task, own),
            )
            for probability, model, own in zip(
                probabilities, models, errors, strict=True
            )
        ]
        return {
            "effects": outcome.effects_of(task, traced, known, spreads, signs),
            "spreads": spreads,
            "vehicle": outcome.vehicle_of(task, traced.model, known),
            "clocks": outcome.clocks_of(task, traced.model, known),
            "model": alternatives[0].model,
            "covariance": covariance,
            "correlations": covariance.among(kinds).correlations if covariance else {},
            "alternatives": tuple(alternatives),
        }

    def _judge(
        self, found: Searched, fields: dict[str, Any], folds: HeldOut | None
    ) -> dict[str, Any]:
        """Fields of a result that judge the others: the verdict, and warnings."""
        traced = found.traced
        kinds = found.traced.model.kinds
        doubt = find_doubt(found.task, traced.model)
        for warning in self.inspection.warnings:
            if warning.startswith(SCALE) and POSITION_SCALE.kind not in kinds:
                doubt = doubt or warning.rstrip(".")
        errors = fields["errors"]
        effects = fields["effects"]
        left = fields["left"]
        verdict, reason = judge(traced, folds, errors, effects, left, doubt)
        excluded = result.excluded_among(fields["set_aside"])
        count = fields["flights"].count + len(excluded)
        reason = with_excluded(reason, excluded, count)
        warnings = []
        if (tried := self.settings["effects"]) is not None:
            others = len({*self.vehicle.kinds} - {*tried})
            were = "was" if len(tried) == 1 else "were"
            warnings.append(
                f"only {', '.join(tried)} {were} tried; {others} other effects were "
                "omitted and cannot be found, and their influence may be attributed to "
                "those that were tried."
            )
        warnings += _warnings_of(found.flights)
        known = {*found.outlying, *(flight.name for flight in fields["held_out"])}
        warnings += (
            f"{name}: every model diverges on this held-out flight; it is excluded "
            "from the errors."
            for name in self.held_out
            if name not in known
        )
        warnings += (
            f"{name}: the corrected model explains it far worse than the others (are "
            "rows or commands wrong?); in the folds it is predicted and not fitted."
            for name in (folds.apart if folds else ())
            if name not in found.outlying
        )
        gains = np.zeros(0) if folds is None else folds.gain.values
        lost = np.count_nonzero(gains < 0.0)
        if kinds and FOLDS * lost > len(gains):
            warnings.append(
                f"The correction does not improve {lost} of {len(gains)} flights."
            )
        return {"verdict": verdict, "reason": reason, "warnings": tuple(warnings)}

    def _of_run(self, found: Searched, flown: tuple[str, ...]) -> dict[str, Any]:
        """Fields of a result about the campaign, the search and the run."""
        logged = self.inspection.campaign
        noise = found.flights.noise
        traced = found.traced
        outlying = found.outlying
        scales = traced.model.scales
        rows = [s for s in self.inspection.excluded if s.file not in outlying]
        rows += [ExcludedRows(file=n, rows=ALL, why=w) for n, w in outlying.items()]
        return {
            "campaign": logged.name,
            "path": logged.path,
            "flights": result.FlightNames(
                tuple(n for n in self.fitted if n not in outlying), flown
            ),
            "knows_forces": self.vehicle.knows_forces,
            "set_aside": tuple(sorted(rows, key=lambda s: s.file)),
            "noise": result.MeasurementNoise(noise.position, noise.pitch),
            "log_findings": self.inspection.warnings + found.flights.findings,
            "air": result.Air(0.0 if scales.is_still else scales.air, scales.air_time),
            "candidates": traced.alone,
            "evidence_threshold": traced.threshold,
            "seconds": self.seconds,
            "version": importlib.metadata.version("drake-glider"),
            "own_effects": tuple(
                self.vehicle.space.kinds[name] for name in self.settings["own_effects"]
            ),
            "seed": self.settings["seed"],
            "settings": self.settings,
        }


def _warnings_of(flights: SmoothedFlights) -> Iterator[str]:
    """Yields sentences about an elevator that is not where it was expected."""
    records = [*flights.corrected.values()]
    is_measured = flights.campaign.servo.angle == "measured"
    for record in records:
        if record.has_servo and is_measured and not record.seen[:, 3].any():
            yield (
                f"{record.name}: no elevator row counts; the elevator is assumed where "
                "its commands have it."
            )
