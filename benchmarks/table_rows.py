"""The rows of the tables that `benchmarks.tables` writes into the pages."""

import numpy as np

import learn_residual
from benchmarks import bench_latency
from benchmarks.tables import Table
from examples.perch_corrected import rehearse
from glider.campaign.reader import load_campaign
from glider.campaign.samples import sample_names
from glider.physics.model import GliderModel
from glider.planning.problem import PerchingProblem
from glider.sysid.pipeline import close_the_loop
from glider.sysid.result import Result
from residual_study import learn_residuals
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


def coefficients_row(name: str) -> list[str]:
    """Held-out error of learned residual coefficients beside a traced effect's."""
    campaign = load_campaign(name)
    learned = learn_residuals(campaign).models
    cells = [learned[key].errors.position_rms_m for key in ("plate", "26", "126")]
    traced = close_the_loop(campaign).errors["corrected"].position_rms_m
    return [f"`{name}`", *(millimeters(cell) for cell in (*cells, traced))]


def learning_row(name: str) -> list[str]:
    """Median misses of the rounds of learn_residual.py; seed 0."""
    found = learn_residual.run(GliderModel.load(name), seed=0)
    weights = [f"{1e3 * turn.miss:.1f}" for turn in found.weights]
    traced = [f"{1e3 * turn.miss:.1f}" for turn in found.traced]
    effects = dict.fromkeys(found.traced[-1].identified.effects)
    return [
        f"`{name}`",
        weights[0],
        f"{1e3 * found.oracle:.1f}",
        ", ".join(traced[1:]),
        ", ".join(effects) or "nothing",
        ", ".join(weights[1:4]) + f" .. {weights[-1]}",
    ]


TABLES = {
    "latency": Table(
        columns=bench_latency.COLUMNS,
        rows=("tvlqr", "mpc"),
        measure=latency_row,
        inputs=("problems/perching.yaml",),
    ),
    "coefficients": Table(
        columns=(
            *("campaign", "flat plate", "26 weights", "126 weights"),
            "the traced effect",
        ),
        rows=("attached_lift", "slow_servo"),
        measure=coefficients_row,
        inputs=("campaigns/{row}.zip",),
    ),
    "learning": Table(
        columns=(
            *("truth", "nominal model", "oracle", "tracer, rounds 1, 2, 3"),
            *("traced to in the last", "weights, rounds 1, 2, 3 .. 19"),
        ),
        rows=(
            *("attached_flow", "head_wind", "rough_skin", "slow_servo"),
            "low_reynolds",
        ),
        measure=learning_row,
        inputs=("truths/{row}.yaml",),
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
