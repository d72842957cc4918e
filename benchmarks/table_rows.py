"""The rows of the tables that `benchmarks.tables` writes into the pages."""

import functools
import time
from pathlib import Path

import numpy as np

import basis_model
import basis_refinement
import collocation
import course
import filter_parameters
import funnel
import learning_loop
import residual_coefficients
import sampling_planners
import tracking_lqr
import van_der_pol
from benchmarks import bench_latency
from benchmarks.tables import Table
from examples.perch_corrected import rehearse
from glider.campaign.reader import load_campaign
from glider.campaign.samples import sample_names
from glider.physics.model import GliderModel
from glider.planning.problem import PerchingProblem
from glider.sysid.pipeline import close_the_loop
from glider.sysid.result import Result
from tests.helpers.known_truth import TRUTHS, limit_of


def millimeters(value: float) -> str:
    """Formats a length [m] with three digits at most."""
    return f"{1e3 * value:.{0 if value >= 0.1 else 1}f} mm"


def effects_of(result: Result) -> str:
    """Names the effects of a result; an unexplained one with its first variable."""
    names = [
        f"{e.kind} over {e.depends_on[0]}" if e.kind == "unexplained" else e.kind
        for e in result.effects
    ]
    return ", ".join(names) or "-"


def sample_row(name: str) -> list[str]:
    """Closes the loop on a sample campaign."""
    result = close_the_loop(name)
    limit = "-"
    if name in TRUTHS:
        limit = millimeters(limit_of(load_campaign(name), TRUTHS[name], result))
    nominal, corrected = (
        millimeters(result.errors[model].position_rms_m)
        for model in ("nominal", "corrected")
    )
    verdict = f"`{result.verdict}`"
    return [f"`{name}`", verdict, nominal, corrected, limit, effects_of(result)]


def perch_row(name: str) -> list[str]:
    """Perches of a glider before and after its logs are traced; seed 0."""
    truth = GliderModel.load(name)
    problem = PerchingProblem()
    rng = np.random.default_rng(0)
    nominal = GliderModel(parameters=truth.parameters)
    starts = problem.draw_launches(100, rng)
    _, before = rehearse(truth, nominal, problem, starts, rng)
    found = close_the_loop(before.campaign)
    starts = problem.draw_launches(100, rng)
    _, after = rehearse(truth, found.model, problem, starts, rng)
    cells = [f"`{name}`", effects_of(found)]
    for flights in (before, after):
        miss = float(np.median(flights.misses))
        cells += [f"{flights.perched} of 100", millimeters(miss)]
    return cells


_PERCHES = (
    "head_wind",
    "slow_servo",
    "attached_flow",
    "rough_skin",
    "set_wing",
    "wing_wash",
    "floor_vent",
)


def latency_row(controller: str) -> list[str]:
    """Latency of the station over ten minutes of flights."""
    return bench_latency.measure(controller, 10.0)


LESSONS = {
    "basis_model": basis_model,
    "basis_refinement": basis_refinement,
    "residual_coefficients": residual_coefficients,
    "filter_parameters": filter_parameters,
    "collocation": collocation,
    "tracking_lqr": tracking_lqr,
    "van_der_pol": van_der_pol,
    "funnel": funnel,
    "learning_loop": learning_loop,
    "sampling_planners": sampling_planners,
}
"""Lessons of the article's course, in its order."""

PICTURES = Path(__file__).parents[1] / "docs" / "pictures"

ITEMS = {
    f"{name}-{k}": (name, item)
    for name, lesson in LESSONS.items()
    for k, item in enumerate(lesson.ARTICLE, start=1)
}
"""Row of the table to its lesson and what the lesson calls it."""


@functools.cache
def taught(name: str) -> tuple[dict[str, str], float]:
    """Runs a lesson and draws its picture.

    Returns:
        what it found, and its processor time [s].
    """
    picture = PICTURES / f"article_{name}.png"
    begin = time.process_time()
    found = LESSONS[name].main(["--figure", str(picture)])
    return found, time.process_time() - begin


def article_row(name: str) -> list[str]:
    """A figure or number of the article and ours."""
    lesson, item = ITEMS[name]
    found, seconds = taught(lesson)
    ours = found[item]
    if ours == course.SHOWN:
        ours = f"[figure](#{lesson.replace('_', '-')})"
    theirs = LESSONS[lesson].ARTICLE[item]
    return [item, theirs, ours, f"`{lesson}.py`", f"{seconds:.0f}"]


TABLES = {
    "latency": Table(
        columns=bench_latency.COLUMNS,
        rows=("tvlqr", "mpc"),
        measure=latency_row,
        inputs=("problems/perching.yaml",),
    ),
    "article": Table(
        columns=("figure or number", "the article", "ours", "lesson", "seconds"),
        rows=tuple(ITEMS),
        measure=article_row,
        inputs=(
            *("campaigns/attached_lift.zip", "truths/low_reynolds.yaml"),
            *("vehicles/heavy.yaml", "vehicles/heavy_ekf.yaml"),
            "problems/sampling.yaml",
        ),
    ),
    "samples": Table(
        columns=("campaign", "verdict", "nominal", "corrected", "limit", "effects"),
        rows=sample_names(),
        measure=sample_row,
        inputs=("campaigns/{row}.zip",),
    ),
    "perches": Table(
        columns=("truth", "found", "perch before", "miss", "perch after", "miss"),
        rows=_PERCHES,
        measure=perch_row,
        inputs=("truths/{row}.yaml",),
    ),
}
