"""The analysis of a campaign that `glider.sysid.pipeline` has read.

log -> smooth -> signs -> trace -> unexplained rest -> errors before and after
"""

import dataclasses
import importlib.metadata
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from glider.campaign.logs import Campaign
from glider.sysid.fit.output_error import fit, in_parallel
from glider.sysid.fit.prediction import (
    Prediction,
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
from glider.sysid.replay.theta import OFFSET
from glider.sysid.replay.vehicle import Vehicle
from glider.sysid.replay.warm_up import warm_up
from glider.sysid.result import (
    Errors,
    ResidualTable,
    Result,
)
from glider.sysid.search.candidates import Search
from glider.sysid.search.decision import explain
from glider.sysid.search.signs import find_signs


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
        logged: Campaign,
        names: tuple[tuple[str, ...], tuple[str, ...]],
        vehicle: Vehicle,
        kinds: tuple[str, ...],
        with_signs: bool,
        settings: dict[str, object],
    ) -> Result:
        """Runs all stages.

        Args:
            logged: the campaign as it was read.
            names: of the flights to fit and of those held out.
            vehicle: of the campaign.
            kinds: of vehicle.kinds, those to try.
            with_signs: whether to look for angles of the other sign first.
            settings: what the caller asked for, to be kept in the result.
        """
        layout = vehicle.layout
        with self.stage("compile", "compile the dynamics (once; it takes a minute)"):
            warm_up(layout)
        with self.stage("smooth"):
            noise = measure_noise(logged)
        with self.stage("signs"):
            signs = Signs()
            if with_signs:
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
        with self.stage("foretell", "predict"):  # As report.json names the stage.
            corrected = dataclasses.replace(unseen, field=found.field)
            models = {
                "as_drawn": (before, vehicle.theta),
                "refitted": (before, plate),
                "corrected": (corrected, found.theta),
            }
            errors: dict[str, Errors | None] = {}
            predictions: dict[str, list[Prediction]] = {}
            for name, (problem, theta) in models.items():
                errors[name], predictions[name] = measure_errors(problem, theta)
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
            held_out=flights_of(before, predictions, vehicle, signs),
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
