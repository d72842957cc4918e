"""The rows of the tables that `tests.benchmarks.tables` writes into the pages."""

import numpy as np

from examples import perch_corrected
from glider.campaign.reader import load_campaign
from glider.campaign.samples import sample_names
from glider.paths import models_path
from glider.physics.model import GliderModel
from glider.sysid.pipeline import close_the_loop
from glider.sysid.result import Result
from tests.benchmarks import bench_latency
from tests.benchmarks.tables import Table
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
    truth = GliderModel.load(models_path("truths", f"{name}.yaml"))
    flown = perch_corrected.fly(truth, launches=100, seed=0)
    cells = [f"`{name}`", effects_of(flown.found)]
    for rehearsal in (flown.before, flown.after):
        perched = int(np.sum(rehearsal.flights.perched))
        miss = float(np.median(rehearsal.flights.misses))
        cells += [f"{perched} of 100", millimeters(miss)]
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


TABLES = {
    "latency": Table(
        columns=bench_latency.COLUMNS,
        rows=("tvlqr", "mpc"),
        measure=latency_row,
        inputs=("problems/perching.yaml",),
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
