"""Closes the loop: from a folder of flights to a corrected glider.

    log -> smooth -> signs -> trace -> unexplained rest -> errors before and after

`close_the_loop` is the main job of this package; the command line and the
examples only call it.
"""

import dataclasses
import importlib.metadata
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from glider.effects import KINDS
from glider.errors import InputError
from glider.model_file import GliderModel
from glider.sysid.flight_log import Campaign, load_campaign, split_flights
from glider.sysid.forecast import Forecast, beginning_rows, measure_errors
from glider.sysid.replay import (
    OFFSET,
    Noise,
    Record,
    fitted_start,
    linearize,
    measure_noise,
    prepare,
    slots_of,
    warm_up,
)
from glider.sysid.residual import make_table
from glider.sysid.result import (
    MODELS,
    Errors,
    Estimate,
    FoundEffect,
    HeldOutFlight,
    ResidualTable,
    Result,
)
from glider.sysid.rollout_fit import Problem, covariance, fit, in_parallel
from glider.sysid.signs import Signs, find_signs, turn_campaign
from glider.sysid.tracing import SILENT, Search
from glider.sysid.vehicle import Vehicle, make_vehicle, parameters_of
from glider.sysid.verdict import Explanation, explain
from glider.sysid.whiteness import lack_of_fit

Progress = Callable[[str], None]


def close_the_loop(
    campaign: Path | str | Campaign,
    *,
    flights: Sequence[str] | None = None,
    grades: Sequence[str] | None = None,
    held_out: float = 0.3,
    seed: int = 0,
    effects: Sequence[str] | None = None,
    progress: Progress = lambda text: None,
) -> Result:
    """Finds what a glider's model lacks, adds it, and measures what that buys.

    Args:
        campaign: a campaign's folder, or one in memory.
        flights: names of flights to use; all by default.
        grades: grades of `index.csv` to use; all by default.
        held_out: share of the flights that errors are measured on.
        seed: of the split into fitted and held-out flights.
        effects: kinds to try; the whole library by default.
        progress: called with a line of text as the work goes on.

    Returns:
        The verdict, the effects, the corrected model, the errors before and after.

    Raises:
        InputError: the campaign or an argument cannot be used.
    """
    if not 0.0 < held_out < 1.0:
        raise InputError(
            f"the held-out fraction is {held_out:g}; it must lie between 0 and 1."
        )
    unknown = [name for name in effects or () if name not in KINDS]
    if unknown:
        raise InputError(
            f"unknown effect '{unknown[0]}'; known are {', '.join(KINDS)}."
        )
    with threadpool_limits(limits=1, user_api="blas"):  # We thread over flights.
        run = _Run(progress)
        with run.stage("read"):
            if not isinstance(campaign, Campaign):
                campaign = load_campaign(Path(campaign), flights=flights, grades=grades)
            fitted, unseen = split_flights(campaign, held_out, seed)
        settings: dict[str, object] = {
            "seed": seed,
            "held_out": held_out,
            "flights": None if flights is None else list(flights),
            "grades": None if grades is None else list(grades),
            "effects": None if effects is None else list(effects),
        }
        names = tuple(f.name for f in fitted), tuple(f.name for f in unseen)
        return run.analyse(campaign, names, effects, settings)


@dataclasses.dataclass
class _Run:
    """The stages in order, timed."""

    progress: Progress
    seconds: dict[str, float] = dataclasses.field(default_factory=dict)

    @contextmanager
    def stage(self, name: str, words: str = "") -> Iterator[None]:
        """Times a stage and announces it."""
        self.progress(words or name)
        begin = time.perf_counter()
        yield
        self.seconds[name] = time.perf_counter() - begin

    def analyse(
        self,
        logged: Campaign,
        names: tuple[tuple[str, ...], tuple[str, ...]],
        effects: Sequence[str] | None,
        settings: dict[str, object],
    ) -> Result:
        """Runs all stages on a campaign that has been read."""
        vehicle = make_vehicle(logged)
        kinds = tuple(k for k in vehicle.kinds if effects is None or k in effects)
        if effects is not None and not kinds and "angle_sign" not in effects:
            raise InputError(
                f"none of the effects {', '.join(effects) or '(none given)'} can be "
                "told from what this campaign logs and leaves unknown."
            )
        with self.stage("compile", "compile the dynamics (once; it takes a minute)"):
            warm_up()
        with self.stage("smooth"):
            noise = measure_noise(logged)
        with self.stage("signs"):
            signs = Signs()
            if effects is None or "angle_sign" in effects:
                few = _pick(logged, names[0])
                signs = find_signs(logged, few, noise, vehicle)
        campaign = turn_campaign(logged, signs)
        if not signs.are_right:
            noise = measure_noise(campaign)
        fitted = _problem(campaign, names[0], noise, vehicle)
        unseen = _problem(campaign, names[1], noise, vehicle)
        with self.stage("trace"):
            search = Search(
                problem=fitted,
                theta=vehicle.theta,
                nuisance=vehicle.nuisance,
                kinds=kinds,
                progress=self.progress,
            )
            found = explain(search)
        # The models before the correction meet the log as it is, signs and all.
        before, fitted_before = unseen, fitted
        if not signs.are_right:
            before = _problem(logged, names[1], noise, vehicle)
            fitted_before = _problem(logged, names[0], noise, vehicle)
        with self.stage("refit"):
            plate = found.plate
            if plate is None:
                start = fit(fitted_before, vehicle.theta, vehicle.nuisance).theta
                plate = fit(fitted_before, start, vehicle.own).theta
        with self.stage("foretell"):
            corrected = dataclasses.replace(unseen, field=found.field)
            models = {
                "as_drawn": (before, vehicle.theta),
                "refitted": (before, plate),
                "corrected": (corrected, found.theta),
            }
            errors: dict[str, Errors | None] = {}
            forecasts: dict[str, list[Forecast]] = {}
            for name, (problem, theta) in models.items():
                errors[name], forecasts[name] = measure_errors(problem, theta)
            first = "as_drawn" if vehicle.is_known else "refitted"
            if not vehicle.is_known:
                errors["as_drawn"] = None
            before_table = _table_of_all(models[first], fitted_before)
            after_table = _table_of_all(models["corrected"], fitted)
        left = lack_of_fit(corrected, found.theta)
        return Result(
            campaign=logged.name,
            path=logged.path,
            fit_flights=names[0],
            held_out_flights=names[1],
            verdict=_verdict(found, signs),
            effects=_effects(found, signs),
            errors=errors,
            left_z=left.z,
            candidates=found.candidates,
            noise_position_m=noise.position,
            noise_pitch_rad=noise.pitch,
            model=_model(found, signs, campaign),
            held_out=_flown(before, forecasts, vehicle, signs),
            residual_before=before_table,
            residual_after=after_table,
            seconds=self.seconds,
            version=importlib.metadata.version("drake-glider"),
            settings={**settings, "notes": list(vehicle.notes)},
        )


def _pick(campaign: Campaign, names: tuple[str, ...]) -> tuple:
    return tuple(f for f in campaign.flights if f.name in names)


def _problem(
    campaign: Campaign, names: tuple[str, ...], noise: Noise, vehicle: Vehicle
) -> Problem:
    records = prepare(_pick(campaign, names), campaign, noise)
    return Problem(
        records=records,
        noise=noise,
        trim_is_known=vehicle.trim_is_known,
        prior=vehicle.prior,
    )


def _table_of_all(model: tuple[Problem, np.ndarray], fitted: Problem) -> ResidualTable:
    """Returns a model's residual over the fitted and the held-out flights."""
    problem, theta = model
    everything = dataclasses.replace(
        problem, records=[*fitted.records, *problem.records]
    )

    def trim(record: Record) -> float:
        errors = linearize(
            record,
            theta,
            (),
            problem.noise,
            field=problem.field,
            trim_is_known=problem.trim_is_known,
        )
        return float((errors.start + fitted_start(errors))[OFFSET])

    trims = in_parallel(trim, everything.records)
    return make_table(everything.records, theta, trims, problem.field)


def _verdict(found: Explanation, signs: Signs) -> str:
    kinds = [w.kind for w in found.weighed]
    if not kinds and signs.are_right:
        return "no_effect" if found.left_z < SILENT else "unexplained"
    if kinds and kinds[0] == "unexplained":
        return "unexplained"
    return "effect_found"


def _effects(found: Explanation, signs: Signs) -> tuple[FoundEffect, ...]:
    errors = dict(
        zip(found.fit.free, np.sqrt(np.diag(covariance(found.fit))), strict=True)
    )
    effects = []
    if not signs.are_right:
        effects.append(
            FoundEffect(
                kind="angle_sign",
                words=KINDS["angle_sign"].words,
                coefficients={
                    name: Estimate(value=float(getattr(signs, name)), std=0.0, unit="-")
                    for name in ("pitch", "elevator", "command")
                },
                evidence=signs.evidence,
                share=signs.share,
                indistinguishable_from=(),
                depends_on=KINDS["angle_sign"].depends_on,
            )
        )
    for weighed in found.weighed:
        if weighed.kind == "unexplained":
            assert found.unexplained is not None
            coefficients, words = (
                found.unexplained.coefficients,
                found.unexplained.words,
            )
            depends_on = found.unexplained.depends_on
        else:
            kind = KINDS[weighed.kind]
            coefficients = {
                c.name: Estimate(
                    value=float(found.theta[i]),
                    std=float(errors.get(i, 0.0)),
                    unit=c.unit,
                )
                for i, c in zip(slots_of(weighed.kind), kind.coefficients, strict=True)
            }
            words, depends_on = kind.words, kind.depends_on
        effects.append(
            FoundEffect(
                kind=weighed.kind,
                words=words,
                coefficients=coefficients,
                evidence=weighed.evidence,
                share=weighed.share,
                indistinguishable_from=weighed.alternatives,
                depends_on=depends_on,
            )
        )
    return tuple(effects)


def _model(found: Explanation, signs: Signs, campaign: Campaign) -> GliderModel:
    effects = []
    if not signs.are_right:
        effects.append(
            KINDS["angle_sign"](
                pitch=float(signs.pitch),
                elevator=float(signs.elevator),
                command=float(signs.command),
            )
        )
    kinds = [w.kind for w in found.weighed if w.kind != "unexplained"]
    if campaign.elevator == "fixed" and "elevator_trim" not in kinds:
        kinds.append("elevator_trim")  # The unknown angle at which it stands.
    for name in kinds:
        if name in KINDS:
            kind = KINDS[name]
            values = found.theta[list(slots_of(name))]
            names = [c.name for c in kind.coefficients]
            effects.append(kind(**dict(zip(names, map(float, values), strict=True))))
    return GliderModel(
        parameters=parameters_of(found.theta, campaign),
        effects=tuple(effects),
        field=None if found.unexplained is None else found.unexplained.data,
    )


def _flown(
    problem: Problem,
    forecasts: dict[str, list[Forecast]],
    vehicle: Vehicle,
    signs: Signs,
) -> tuple[HeldOutFlight, ...]:
    flights = []
    as_logged = {"corrected": np.array([1.0, 1.0, signs.pitch])}
    for i, record in enumerate(problem.records):
        rows = beginning_rows(record, problem.trim_is_known)
        flights.append(
            HeldOutFlight(
                name=record.flight.name,
                time=record.time,
                measured=record.flight.pose,
                flown={
                    name: forecasts[name][i].pose * as_logged.get(name, 1.0)
                    for name in MODELS
                    if name != "as_drawn" or vehicle.is_known
                },
                fitted_until=float(record.time[rows - 1]),
            )
        )
    return tuple(flights)
