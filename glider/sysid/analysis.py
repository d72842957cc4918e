"""The analysis of a campaign that `glider.sysid.pipeline` has read.

log -> inspect -> smooth -> signs -> search -> errors before and after -> verdict
"""

import dataclasses
import importlib.metadata
import time
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np
from scipy.special import softmax

from glider.campaign.checks.masks import ALL, ExcludedRows, Inspection
from glider.campaign.checks.rates import SCALE
from glider.campaign.checks.servo_fit import identify_servo
from glider.campaign.logs import Campaign, split_flights
from glider.campaign.turning import Signs, turn_campaign
from glider.compiled.warm_up import warm_up
from glider.errors import InputError
from glider.physics.effects import ANGLE_SIGN, POSITION_SCALE
from glider.physics.flown_range import ranges_of
from glider.progress import Progress, Step
from glider.sysid import outcome, result
from glider.sysid.evaluation import Searched, SmoothedFlights, evaluate
from glider.sysid.fit.session import begin_of_end, by_number
from glider.sysid.likelihood.model_fit import fit_model
from glider.sysid.likelihood.outliers import find_extreme, find_outlying
from glider.sysid.likelihood.task import Task, make_task
from glider.sysid.likelihood.uncertainty import Uncertainty, averaged, uncertainty_of
from glider.sysid.replay.record import Noise, Record, measure_noise, prepare
from glider.sysid.replay.vehicle import Vehicle, make_vehicle
from glider.sysid.search.signs import find_signs
from glider.sysid.search.tracing import trace
from glider.sysid.verdict import find_doubt, judge

_SHARES = {
    "compile": 0.06,
    "signs": 0.08,
    "smooth": 0.12,
    "compare": 0.14,
    "trace": 0.15,
    "refit": 0.85,
    "predict": 0.89,
    "weigh": 0.98,
}
"""Usual shares of the time when the stages begin, measured on the samples."""
_ENOUGH = 8  # Flights after a change that are preferred to more before it (c).
_FEWEST = 4  # Flights that are traced alone (c).


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
        self.progress(Step(words or name, _SHARES[name]))
        begin = time.perf_counter()
        yield
        taken = time.perf_counter() - begin
        self.seconds[name] = self.seconds.get(name, 0.0) + taken

    def run(self) -> result.Result:
        """Runs all stages; where the glider changed, again on one part of the session.

        That is the part after the change, if it has enough flights, or the longer one.
        """
        found = self._run()
        words = [change.sentence for change in found.changes]
        kept, gone, side = self._divided(found.changes)
        if gone and len(kept) >= _FEWEST:
            self.progress(f"{words[0]} Again on {len(kept)} flights")
            again = self._on(kept)._run()
            words += [change.sentence for change in again.changes]
            words.append(
                f"This report is of the {len(kept)} flights on the other side: the "
                f"{len(gone)} {side} it are set aside (trace them with --flights)."
            )
            why = f"flown {side} the change at {found.changes[0].flight}"
            rows = [ExcludedRows(file=name, rows=ALL, why=why) for name in gone]
            found = dataclasses.replace(
                again,
                changes=(*found.changes, *again.changes),
                set_aside=tuple(sorted([*again.set_aside, *rows], key=_file_of)),
            )
        elif found.changes and found.verdict == "no_effect":
            words.append("No effect is found that is the same in all flights.")
            return dataclasses.replace(
                found, verdict="unexplained", reason=" ".join(words)
            )

        return dataclasses.replace(found, reason=" ".join([*words, found.reason]))

    def _divided(
        self, changes: Collection[result.Change]
    ) -> tuple[list[str], list[str], str]:
        """Names of the flights to trace, the others, and their side of a change."""
        names = [flight.name for flight in self.inspection.campaign.flights]
        names.sort(key=by_number)
        for change in changes:
            if change.flight:
                at = names.index(change.flight)
                before, after = names[:at], names[at:]
                if len(after) >= min(_ENOUGH, len(before)):
                    return after, before, "before"
                return before, after, "after"

        return names, [], ""

    def _on(self, names: Collection[str]) -> "Analysis":
        """The analysis of some of the flights alone."""
        campaign = self.inspection.campaign
        flights = tuple(f for f in campaign.flights if f.name in names)
        campaign = dataclasses.replace(campaign, flights=flights)
        seed = self.settings["seed"]
        parts = split_flights(campaign, self.settings["held_out"], seed)
        fitted, held_out = (tuple(flight.name for flight in part) for part in parts)
        return dataclasses.replace(
            self,
            inspection=dataclasses.replace(self.inspection, campaign=campaign),
            fitted=fitted,
            held_out=held_out,
            rng=np.random.default_rng(seed),
        )

    def _run(self) -> result.Result:
        """Runs all stages once."""
        with self.stage("compile", "compile the dynamics (once; it takes ten seconds)"):
            warm_up(self.vehicle.space)
        flights = self._smooth()
        found = self._search(flights)
        task = found.task
        traced = found.traced
        model = traced.model
        with self.stage("refit", "refitting the flat plate alone"):
            baseline = traced.bare
            if traced.forces is None:  # To the log as it is, signs and all.
                names = [record.name for record in task.records]
                as_logged = task.on(flights.of("refitted", names))
                free = self.vehicle.baseline_slots
                baseline = dataclasses.replace(baseline, free=free)
                baseline = fit_model(as_logged, baseline)

        with self.stage("predict", "predicting held-out flights"):
            spreads = outcome.spreads_of(task, model)
            evaluated, tests = evaluate(
                found, self.held_out, baseline, spreads, self.rng
            )

        with self.stage("weigh", "standard errors"):
            alternatives, known = _weigh(found)
            flown_values = evaluated["residual_after"].variables
            alternatives = tuple(_with_ranges(a, flown_values) for a in alternatives)
            effects = outcome.effects_of(
                task, traced, tests, known, spreads, flights.signs
            )

        campaign = self.inspection.campaign
        doubt = find_doubt(task, model)
        if doubt is None and POSITION_SCALE.kind not in model.kinds:
            wrong = [s for s in self.inspection.warnings if s.startswith(SCALE)]
            doubt = wrong[0].rstrip(".") if wrong else None
        verdict, reason = judge(
            traced, tests.gains, evaluated["errors"], effects, evaluated["left"], doubt
        )
        rows = [s for s in self.inspection.excluded if s.file not in found.outlying]
        for name, why in found.outlying.items():
            rows.append(ExcludedRows(file=name, rows=ALL, why=why))
        flown = tuple(flight.name for flight in evaluated["held_out"])
        fitted = tuple(name for name in self.fitted if name not in found.outlying)
        flights_of = result.FlightNames(fitted, flown)
        covariance = outcome.covariance_of(task, known)
        scales = model.scales
        space = self.vehicle.space
        return result.Result(
            campaign=campaign.name,
            path=campaign.path,
            flights=flights_of,
            knows_forces=self.vehicle.knows_forces,
            verdict=verdict,
            reason=reason + self._about_outlying(found.outlying),
            effects=effects,
            **evaluated,
            changes=() if tests.change is None else (tests.change,),
            evidence_threshold=traced.threshold,
            air=result.Air(0.0 if scales.is_still else scales.air, scales.air_time),
            spreads=spreads,
            vehicle=outcome.vehicle_of(task, model, known),
            clocks=outcome.clocks_of(task, model, known),
            model=alternatives[0].model,
            alternatives=alternatives,
            covariance=covariance,
            warnings=tuple(self._warnings(found, flown)),
            set_aside=tuple(sorted(rows, key=_file_of)),
            noise=result.MeasurementNoise(flights.noise.position, flights.noise.pitch),
            log_findings=self.inspection.warnings + flights.findings,
            own_effects=tuple(space.kinds[n] for n in self.settings["own_effects"]),
            seed=self.settings["seed"],
            settings=self.settings,
            seconds=self.seconds,
            version=importlib.metadata.version("drake-glider"),
        )

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
        """Searches the effects that the flights to fit show, without outliers."""
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
            traced = trace(task, noise, self.progress)
            if extreme := find_extreme(everything, traced.model):
                again = sorted(r.name for r in task.records if r.name in extreme)
                everything, task = self._without(extreme, everything)
                outlying |= extreme
                if again:
                    self.progress(f"again without {', '.join(again)}")
                    traced = trace(task, noise, self.progress)

        return Searched(flights, everything, task, traced, outlying)

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

    def _about_outlying(self, outlying: Collection[str]) -> str:
        """Returns the sentence on flights that stand out; empty without any."""
        if not outlying:
            return ""
        names = [flight.name for flight in self.inspection.campaign.flights]
        sentence = (
            f" {len(outlying)} of {len(names)} flights are set aside, as no model "
            f"explains them with the others: {', '.join(sorted(outlying))}"
        )
        first = begin_of_end(names, outlying)
        if first is None:
            return f"{sentence}."
        return f"{sentence}. Did the glider change at {first}?"

    def _warnings(self, found: Searched, flown: Collection[str]) -> Iterator[str]:
        """Yields sentences about what limits the result."""
        if (tried := self.settings["effects"]) is not None:
            others = len({*self.vehicle.kinds} - {*tried})
            were = "was" if len(tried) == 1 else "were"
            yield (
                f"only {', '.join(tried)} {were} tried; {others} other effects were "
                "omitted and cannot be found, and their influence may be attributed to "
                "those that were tried."
            )

        for name in self.held_out:
            if name not in found.outlying and name not in flown:
                yield (
                    f"{name}: every model diverges on this held-out flight; it is "
                    "excluded from the errors."
                )


def _file_of(rows: ExcludedRows) -> str:
    return rows.file


def _with_ranges(
    alternative: result.Alternative, values: dict[str, np.ndarray]
) -> result.Alternative:
    """Adds where its model was flown, by the variables (n,) of the flights."""
    ranges = ranges_of(alternative.model, values)
    model = dataclasses.replace(alternative.model, flown=ranges)
    return dataclasses.replace(alternative, model=model)


def _weigh(found: Searched) -> tuple[tuple[result.Alternative, ...], Uncertainty]:
    """Returns the models that may be right, the chosen one first, and its errors."""
    task = found.task
    traced = found.traced
    rivals = [rival for rival, _ in traced.rivals]
    lacks = [lack for _, lack in traced.rivals]
    probabilities = softmax([0.0, *(-lack for lack in lacks)]).tolist()
    judged = [traced.judged, *rivals]
    errors = [uncertainty_of(task, model) for model in judged]
    alternatives = []
    for probability, model, own in zip(
        probabilities, [traced.model, *rivals], errors, strict=True
    ):
        alternatives.append(
            result.Alternative(
                probability=probability,
                model=outcome.model_of(task, model, found.flights.signs),
                covariance=outcome.covariance_of(task, own),
            )
        )

    return tuple(alternatives), averaged(probabilities, judged, errors)
