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

from glider.campaign.logs import (
    Campaign,
    split_flights,
)
from glider.campaign.reader import load_campaign
from glider.errors import InputError
from glider.physics.effects import ANGLE_SIGN, EffectKind
from glider.sysid.fit.output_error import fit, in_parallel
from glider.sysid.fit.prediction import (
    Forecast,
    measure_errors,
)
from glider.sysid.fit.whiteness import lack_of_fit
from glider.sysid.outcome import (
    effects_of,
    flights_of,
    model_of,
    verdict_of,
)
from glider.sysid.replay.noise import (
    Noise,
    measure_noise,
)
from glider.sysid.replay.problem import Problem
from glider.sysid.replay.record import (
    Record,
    prepare,
)
from glider.sysid.replay.residual import make_table
from glider.sysid.replay.sensitivity import (
    fitted_start,
    linearize,
)
from glider.sysid.replay.signs import Signs, turn_campaign
from glider.sysid.replay.theta import (
    OFFSET,
    Layout,
    layout_of,
)
from glider.sysid.replay.vehicle import (
    Vehicle,
    make_vehicle,
)
from glider.sysid.replay.warm_up import warm_up
from glider.sysid.result import (
    Errors,
    ResidualTable,
    Result,
)
from glider.sysid.search.candidates import Search
from glider.sysid.search.decision import explain
from glider.sysid.search.signs import find_signs

Progress = Callable[[str], None]


def close_the_loop(
    campaign: Path | str | Campaign,
    *,
    flights: Sequence[str] | None = None,
    grades: Sequence[str] | None = None,
    held_out: float = 0.3,
    seed: int = 0,
    effects: Sequence[str] | None = None,
    own_effects: Sequence[EffectKind] = (),
    progress: Progress = lambda text: None,
) -> Result:
    """Finds what a glider's model lacks, adds it, and measures what that buys.

    Args:
        campaign: a campaign's folder, or one in memory.
        flights: names of flights to use; all by default.
        grades: grades of `index.csv` to use; all by default.
        held_out: share of the flights that errors are measured on.
        seed: of the split into fitted and held-out flights.
        effects: names of the kinds to try; by default the whole library and
            `own_effects`.
        own_effects: kinds that the library lacks, of any stage but the actuator.
            They are traced, weighed and carried by the model like the library's.
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
    layout = layout_of(tuple(own_effects))
    unknown = [name for name in effects or () if name not in layout.kinds]
    if unknown:
        raise InputError(
            f"unknown effect '{unknown[0]}'; known are {', '.join(layout.kinds)}."
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
            "own_effects": [e.kind for e in own_effects],
        }
        names = tuple(f.name for f in fitted), tuple(f.name for f in unseen)
        return run.analyse(campaign, names, effects, layout, settings)


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
        layout: Layout,
        settings: dict[str, object],
    ) -> Result:
        """Runs all stages on a campaign that has been read."""
        vehicle = make_vehicle(logged, layout)
        kinds = tuple(k for k in vehicle.kinds if effects is None or k in effects)
        if effects is not None and not kinds and ANGLE_SIGN.kind not in effects:
            raise InputError(
                f"none of the effects {', '.join(effects) or '(none given)'} can be "
                "told from what this campaign logs and leaves unknown."
            )
        with self.stage("compile", "compile the dynamics (once; it takes a minute)"):
            warm_up(layout)
        with self.stage("smooth"):
            noise = measure_noise(logged)
        with self.stage("signs"):
            signs = Signs()
            if effects is None or ANGLE_SIGN.kind in effects:
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
            verdict=verdict_of(found, signs),
            effects=effects_of(found, signs, layout),
            errors=errors,
            left_z=left.z,
            candidates=found.candidates,
            noise_position_m=noise.position,
            noise_pitch_rad=noise.pitch,
            model=model_of(found, signs, campaign, layout),
            held_out=flights_of(before, forecasts, vehicle, signs),
            residual_before=before_table,
            residual_after=after_table,
            seconds=self.seconds,
            version=importlib.metadata.version("drake-glider"),
            own_effects=layout.own,
            settings={**settings, "notes": list(vehicle.notes)},
        )


def _pick(campaign: Campaign, names: tuple[str, ...]) -> tuple:
    return tuple(f for f in campaign.flights if f.name in names)


def _problem(
    campaign: Campaign, names: tuple[str, ...], noise: Noise, vehicle: Vehicle
) -> Problem:
    records = prepare(_pick(campaign, names), campaign, noise, vehicle.layout)
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
        errors = linearize(problem, record, theta)
        return float((errors.start + fitted_start(errors))[OFFSET])

    trims = in_parallel(trim, everything.records)
    return make_table(everything.records, theta, trims, problem.field)
