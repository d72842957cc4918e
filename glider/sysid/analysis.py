"""The analysis of a campaign that `glider.sysid.pipeline` has read.

log -> inspect -> signs -> smooth -> search -> errors before and after -> verdict
"""

import dataclasses
import importlib.metadata
import time
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from operator import attrgetter
from typing import Any

import numpy as np
from scipy.special import softmax

from glider.campaign.changes import SERVO, Change, by_number
from glider.campaign.checks.masks import ALL, ExcludedRows, Inspection
from glider.campaign.checks.rates import SCALE
from glider.campaign.checks.servo_fit import identify_servo
from glider.campaign.logs import Campaign, Flight, split_flights
from glider.campaign.turning import Signs, turn_campaign
from glider.compiled.warm_up import warm_up
from glider.errors import InputError
from glider.physics.effects import ANGLE_SIGN, POSITION_SCALE
from glider.physics.flown_range import ranges_of
from glider.progress import Progress, Step
from glider.sysid import outcome
from glider.sysid.constants import MANY_FLIGHTS
from glider.sysid.evaluation import Searched, evaluate
from glider.sysid.fit.session import are_at_one_end, find_change
from glider.sysid.likelihood.model_fit import fit_model
from glider.sysid.likelihood.outliers import find_extreme, find_outlying
from glider.sysid.likelihood.task import Task, make_task
from glider.sysid.likelihood.uncertainty import Uncertainty, averaged, uncertainty_of
from glider.sysid.replay.record import measure_noise, prepare
from glider.sysid.replay.vehicle import Vehicle, make_vehicle
from glider.sysid.result import (
    Air,
    Alternative,
    FlightNames,
    MeasurementNoise,
    ResidualTable,
    Result,
    UnlikeFlights,
)
from glider.sysid.roll import RollSearch
from glider.sysid.search.moves import Search
from glider.sysid.search.signs import find_signs
from glider.sysid.search.tracing import trace
from glider.sysid.verdict import find_doubt, judge, too_few_fly

_SHARES = {
    "compile": 0.06,
    "signs": 0.08,
    "smooth": 0.12,
    "compare": 0.14,
    "trace": 0.15,
    "roll": 0.8,
    "refit": 0.85,
    "predict": 0.89,
    "weigh": 0.98,
}
"""Usual shares of the time when the stages begin, measured on the samples."""
_ENOUGH = 8  # Flights after a change that are preferred to more before it (c).
_FEWEST = 4  # Flights that are traced alone (c).


@dataclasses.dataclass(frozen=True, kw_only=True)
class Analysis:
    """The stages in order, timed.

    Attributes:
        progress: called with a line of text or a `Step` as the work goes on.
        seconds: stage to its wall-clock time [s]; each stage adds its own.
        inspection: the campaign as it was read and checked.
        vehicle: of the campaign.
        kinds: effects to try.
        fitted: flights to fit; errors are measured on the others.
        settings: of the run, for the report.
    """

    progress: Progress
    seconds: dict[str, float]
    inspection: Inspection
    vehicle: Vehicle
    kinds: tuple[str, ...]
    fitted: tuple[Flight, ...]
    settings: dict[str, Any]

    @contextmanager
    def stage(self, name: str, words: str = "") -> Iterator[None]:
        """Times a stage and announces it."""
        self.progress(Step(words or name, _SHARES[name]))
        begin = time.perf_counter()
        yield
        taken = time.perf_counter() - begin
        self.seconds[name] = self.seconds.get(name, 0.0) + taken

    def run(self) -> Result:
        """Runs all stages; where the glider changed, again on one part of the session.

        That is the part after the change, if it has enough flights, or the longer one.
        There the glider may have changed once more.
        """
        found = self._run()
        if not found.changes:
            return found

        [change] = found.changes
        sentences = [change.sentence]
        sides = self._sides_of(change)
        side, other = "since", "before"
        if len(sides[side]) < min(_ENOUGH, len(sides[other])):
            side, other = other, side
        kept = sides[side]
        gone = sides[other]
        if gone and len(kept) >= _FEWEST:
            self.progress(f"{change.sentence} Again on {len(kept)} flights")
            again = self._on(kept).run()
            sentences.append(
                f"The {len(gone)} flights {other} then are excluded (trace them with "
                "--flights)."
            )
            why = f"flown {other} the change at {change.flight}"
            rows = [ExcludedRows(file=name, rows=ALL, why=why) for name in gone]
            found = dataclasses.replace(
                again,
                changes=(change, *again.changes),
                set_aside=_by_file([*again.set_aside, *rows]),
            )
        elif found.verdict == "no_effect" and change.kind != SERVO:
            nothing = "No effect is found that is the same in all flights."
            found = dataclasses.replace(found, verdict="unexplained", reason=nothing)

        return dataclasses.replace(found, reason=" ".join([*sentences, found.reason]))

    def _sides_of(self, change: Change) -> dict[str, list[str]]:
        """Names of the flights "before" a change and "since", in their order.

        A drift has no flight: all are since then.
        """
        names = [flight.name for flight in self.inspection.campaign.flights]
        names.sort(key=by_number)
        at = names.index(change.flight) if change.flight else 0
        return {"before": names[:at], "since": names[at:]}

    def _on(self, names: Collection[str]) -> "Analysis":
        """The analysis of some of the flights alone.

        They are split again into those to fit and those to hold out.
        """
        settings = self.settings
        campaign = self.inspection.campaign.only(names)
        fitted, _ = split_flights(campaign, settings["held_out"], settings["seed"])
        inspection = dataclasses.replace(self.inspection, campaign=campaign)
        return dataclasses.replace(self, inspection=inspection, fitted=fitted)

    def _run(self) -> Result:
        """Runs all stages once."""
        with self.stage("compile", "compile the dynamics (once, up to a minute)"):
            warm_up(self.vehicle.space)

        signs, campaign, about_servo, change = self._corrected()
        found = self._search(campaign)
        task = found.task
        traced = found.traced
        model = traced.model
        with self.stage("refit", "refitting the flat-plate model"):
            baseline = traced.bare
            if traced.forces is None:
                free = self.vehicle.baseline_slots
                baseline = fit_model(task, dataclasses.replace(baseline, free=free))

        with self.stage("predict", "predicting held-out flights"):
            seed = self.settings["seed"]
            spreads = outcome.spreads_of(task, model)
            if change is None and traced.bank is None:  # Else flights differ by roll.
                rng = np.random.default_rng(seed)
                change = find_change(found.session, model, rng)
            rng = np.random.default_rng(seed)
            specified = turn_campaign(self.inspection.campaign, signs).limits
            evaluated, tests = evaluate(found, baseline, spreads, specified, rng)

        with self.stage("weigh", "standard errors"):
            alternatives, known = _weigh(found, signs, evaluated["residual_after"])
            effects = outcome.effects_of(task, traced, tests, known, spreads, signs)

        flights = evaluated["flights"]
        doubt = find_doubt(task, model) or too_few_fly(flights)
        if doubt is None and POSITION_SCALE.kind not in model.kinds:
            wrong = [s for s in self.inspection.warnings if s.startswith(SCALE)]
            doubt = wrong[0].rstrip(".") if wrong else None

        verdict, reason = judge(
            traced,
            tests.gains,
            evaluated["errors"],
            effects,
            evaluated["left"],
            spreads,
            doubt,
        )
        sentences = [
            *map(_first_sentence, about_servo),
            reason,
            self._about_outlying(found.outlying),
            _about_diverged(flights),
        ]
        # Of a flight that stands out all rows are excluded.
        rows = [s for s in self.inspection.excluded if s.file not in found.outlying]
        for name, why in found.outlying.items():
            rows.append(ExcludedRows(file=name, rows=ALL, why=why))

        scales = model.scales
        own_kinds = self.vehicle.space.kinds
        return Result(
            campaign=campaign.name,
            path=campaign.path,
            knows_forces=self.vehicle.knows_forces,
            verdict=verdict,
            reason=" ".join(filter(None, sentences)),
            effects=effects,
            **evaluated,
            changes=() if change is None else (change,),
            evidence_threshold=traced.threshold,
            bank_rad=traced.bank,
            air=Air(0.0 if scales.is_still else scales.air, scales.air_time),
            spreads=spreads,
            vehicle=outcome.vehicle_of(task, model, known),
            clocks=outcome.clocks_of(task, model, known),
            model=alternatives[0].model,
            alternatives=alternatives,
            covariance=outcome.covariance_of(task, known),
            warnings=self._warnings(evaluated["unlike"]),
            set_aside=_by_file(rows),
            noise=MeasurementNoise(found.noise.position, found.noise.pitch),
            log_findings=self.inspection.warnings + about_servo,
            own_effects=tuple(own_kinds[n] for n in self.settings["own_effects"]),
            settings=self.settings,
            seconds=self.seconds,
            version=importlib.metadata.version("drake-glider"),
        )

    def _corrected(self) -> tuple[Signs, Campaign, tuple[str, ...], Change | None]:
        """Turns wrong signs back and finds the servo.

        Returns:
            the signs, the campaign with these and with what its elevators do,
            sentences on the servo, and its change during the session, if any.
        """
        effects = self.settings["effects"]
        logged = self.inspection.campaign
        masks = self.inspection.masks
        signs = Signs()
        with self.stage("signs"):
            if effects is None or ANGLE_SIGN.kind in effects:
                signs = find_signs(logged, self.fitted, masks, self.vehicle)

        return signs, *identify_servo(turn_campaign(logged, signs), masks)

    def _search(self, campaign: Campaign) -> Searched:
        """Searches the effects that the flights to fit show, without outliers."""
        masks = self.inspection.masks
        space = self.vehicle.space
        with self.stage("smooth"):
            noise = measure_noise(campaign, masks)
            records = prepare(campaign.flights, campaign, noise, space, masks)

        with self.stage("compare", "comparing flights"):
            everything = make_task(records, make_vehicle(campaign, space), self.kinds)
            outlying = {}
            for name, ratio in find_outlying(everything, noise).items():
                outlying[name] = (
                    "explained by no model with the others: its mean square is "
                    f"{ratio:.3g} times the median (another clock, axis, unit or "
                    "glider, or a hit?)"
                )
            everything, task = self._without(outlying, everything)

        with self.stage("trace"):
            search = Search(task, self.progress)
            traced = trace(search, noise)
            extreme = find_extreme(everything, traced.model)
            if extreme:
                again = sorted(r.name for r in task.records if r.name in extreme)
                everything, task = self._without(extreme, everything)
                outlying |= extreme
                if again:
                    self.progress(f"again without {', '.join(again)}")
                    search = Search(task, self.progress)
                    traced = trace(search, noise)

        session = everything
        if are_at_one_end(outlying, [record.name for record in records]):
            session = everything.on(records)  # They are of another glider, perhaps.

        logs_roll = any(flight.attitude is not None for flight in campaign.flights)
        if self.vehicle.is_known and not logs_roll:
            with self.stage("roll", "comparing flights that roll"):
                few = search.thinned(MANY_FLIGHTS)
                rolls = RollSearch(
                    search=few, campaign=campaign, noise=noise, masks=masks
                )
                traced = rolls.find(traced)

        return Searched(noise, everything, task, traced, outlying, session)

    def _without(
        self, outlying: Mapping[str, str], everything: Task
    ) -> tuple[Task, Task]:
        """The task without flights that stand out, and that on the flights to fit.

        Raises:
            InputError: too few flights are left to fit and to hold out.
        """
        kept = [r for r in everything.records if r.name not in outlying]
        names = [flight.name for flight in self.fitted]
        fitted = [r for r in kept if r.name in names]
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
        count = len(self.inspection.campaign.flights)
        return (
            f"{len(outlying)} of {count} flights are excluded, as no model explains "
            f"them with the others: {', '.join(sorted(outlying))}."
        )

    def _warnings(self, unlike: UnlikeFlights | None) -> tuple[str, ...]:
        """Returns sentences about what limits the result."""
        found = []
        tried = self.settings["effects"]
        if tried is not None:
            others = len({*self.vehicle.kinds} - {*tried})
            were = "was" if len(tried) == 1 else "were"
            found.append(
                f"only {', '.join(tried)} {were} tried; {others} other effects were "
                "omitted and cannot be found, and their influence may be attributed to "
                "those that were tried."
            )

        if unlike is not None and unlike.left.exceeds_chance:
            found.append(unlike.warning)
        return tuple(found)


def _by_file(rows: Iterable[ExcludedRows]) -> tuple[ExcludedRows, ...]:
    return tuple(sorted(rows, key=attrgetter("file")))


def _about_diverged(flights: FlightNames) -> str:
    """Returns the sentence on flights that are in no error; empty without any."""
    if not flights.diverged:
        return ""
    return (
        f"The errors are without {len(flights.diverged)} of {len(flights.held_out)} "
        f"held-out flights, on which every model diverges: "
        f"{', '.join(flights.diverged)}."
    )


def _first_sentence(text: str) -> str:
    return text.partition(". ")[0].rstrip(".") + "."


def _weigh(
    found: Searched, signs: Signs, flights: ResidualTable
) -> tuple[tuple[Alternative, ...], Uncertainty]:
    """Weighs the models that may be right by their evidence.

    Args:
        found: the chosen model and its rivals.
        signs: by which the logs were turned.
        flights: all of them, with their variables.

    Returns:
        the models, the chosen one first, and its errors, averaged over all.
    """
    task = found.task
    traced = found.traced
    rivals = [rival for rival, _ in traced.rivals]
    probabilities = softmax([0.0, *(-lack for _, lack in traced.rivals)]).tolist()
    judged = [traced.judged, *rivals]
    errors = [uncertainty_of(task, model) for model in judged]
    alternatives = []
    for i, model in enumerate([traced.model, *rivals]):
        glider = outcome.model_of(task, model, signs)
        flown = ranges_of(glider, flights.variables, flights.flight)
        glider = dataclasses.replace(glider, flown=flown)
        covariance = outcome.covariance_of(task, errors[i])
        alternatives.append(
            Alternative(
                probability=probabilities[i], model=glider, covariance=covariance
            )
        )

    return tuple(alternatives), averaged(probabilities, judged, errors)
