"""TVLQR, MPPI and planning again by collocation over the seven truths: README's table.

    python -m benchmarks.bench_controllers [--estimated] [LAUNCHES] [TRUTH ...]

The drawn model knows nothing of a truth's effect; the corrected one is what the logs of
100 flights tell. Launches err as today, and two and three times as wide. A flight
perches if the hook takes it: near enough, slow enough, the nose up as it should be.
With --estimated the controllers get what a Kalman filter with the same model makes of
motion capture (1 mm, 120 Hz), not the true state; of the corrected models alone.
The last column times MPC's plans, each of which has the period of a command.
"""

import argparse

import numpy as np

from examples.perch_corrected import rehearse
from examples.replan import COMMAND_RATE, CONTROLLERS, race
from glider.physics.model import GliderModel
from glider.planning.problem import PerchingProblem
from glider.sysid.pipeline import close_the_loop

TRUTHS = (
    "head_wind",
    "slow_servo",
    "attached_flow",
    "rough_skin",
    "set_wing",
    "wing_wash",
    "floor_vent",
)
WIDTHS = (1, 2, 3)
FLIGHTS = 100
PERIOD_MS = 1e3 / COMMAND_RATE


def latency(seconds: np.ndarray) -> str:
    """Returns median and worst time of plans [ms], and the share past a command's."""
    times_ms = 1e3 * seconds
    half, worst, late = np.median(times_ms), times_ms.max(), times_ms > PERIOD_MS
    return f"{half:.1f}, {worst:.1f}, {100 * late.mean():.1f} %"


def main(
    launches: int = 20, truths: tuple[str, ...] = TRUTHS, estimated: bool = False
) -> None:
    """Prints the table, a row as soon as it is known."""
    problem, seconds, failures = PerchingProblem(), [], 0
    print(f"Perches of {launches}, launches 1, 2 and 3 times as wide; median miss [mm]")
    columns = *CONTROLLERS, f"plans: median, worst [ms], past {PERIOD_MS:.0f} ms"
    print("| truth | model | " + " | ".join(columns) + " |")
    print("|---|---|" + "---|" * len(columns))
    for name in truths:
        truth = GliderModel.load(name)
        drawn = GliderModel(parameters=truth.parameters)
        rng = np.random.default_rng(0)
        starts = problem.draw_launches(FLIGHTS, rng)
        _, logged = rehearse(truth, drawn, problem, starts, rng)
        corrected = close_the_loop(logged.campaign).model
        models = {"corrected": corrected}
        if not estimated:
            models = {"drawn": drawn, "corrected": corrected}
        for label, model in models.items():
            cells = {controller: [] for controller in CONTROLLERS}
            took = []
            for times in WIDTHS:
                rng = np.random.default_rng([1, times])
                starts = problem.draw_launches(launches, rng, scale=times)
                unsure = times if estimated else None
                _, flights, plans = race(truth, model, problem, starts, unsure=unsure)
                took.append(np.array([again.seconds for again in plans]))
                failures += sum(again.failed for again in plans)
                for controller, flown in flights.items():
                    cells[controller].append(flown)
            row = [
                f"{', '.join(str(f.perched) for f in flown)} "
                f"({', '.join(f'{1e3 * np.median(f.misses):.1f}' for f in flown)})"
                for flown in cells.values()
            ]
            row.append(latency(np.concatenate(took)))
            seconds += took
            print(f"| `{name}` | {label} | " + " | ".join(row) + " |", flush=True)
    everything = np.concatenate(seconds)
    print(
        f"{len(everything)} plans again, {failures} failed: {latency(everything)}; "
        f"99th percentile {1e3 * np.percentile(everything, 99):.1f} ms"
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("launches", nargs="?", type=int, default=20)
    parser.add_argument("truths", nargs="*", metavar="TRUTH", default=list(TRUTHS))
    parser.add_argument("--estimated", action="store_true", help="fly by the filter")
    asked = parser.parse_args()
    unknown = set(asked.truths) - set(TRUTHS)
    if unknown:
        parser.error(f"no truth {sorted(unknown)[0]!r}; there are {', '.join(TRUTHS)}")
    main(asked.launches, tuple(asked.truths), asked.estimated)
