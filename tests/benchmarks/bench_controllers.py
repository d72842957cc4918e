"""TVLQR, MPPI and planning anew by collocation over the seven truths: README's table.

    python -m tests.benchmarks.bench_controllers [--estimated] [LAUNCHES] [TRUTH ...]

The drawn model knows nothing of a truth's effect; the corrected one is what the logs of
100 flights tell. Launches err as today, and two and three times as wide. A flight
perches if the hook takes it: near enough, slow enough, the nose up as it should be.
With --estimated the controllers get what a Kalman filter with the same model makes of
motion capture (1 mm, 120 Hz), not the true state; of the corrected models alone.
"""

import argparse

import numpy as np

from diagrams.studies.controllers import CONTROLLERS, race
from diagrams.studies.rehearsal import load_truth, trace_model
from glider.physics.model import GliderModel
from glider.planning.problem import PerchingProblem
from glider.simulation.monte_carlo import LaunchSpread, draw_launches

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


def widened(times: int) -> LaunchSpread:
    """Returns launches that err so many times as much."""
    usual = LaunchSpread()
    return LaunchSpread(
        height=times * usual.height,
        speed=times * usual.speed,
        pitch=times * usual.pitch,
    )


def main(
    launches: int = 20, truths: tuple[str, ...] = TRUTHS, estimated: bool = False
) -> None:
    """Prints the table, a row as soon as it is known."""
    problem, seconds, failures = PerchingProblem(), [], 0
    print(f"Perches of {launches}, launches 1, 2 and 3 times as wide; median miss [mm]")
    print("| truth | model | " + " | ".join(CONTROLLERS) + " |")
    print("|---|---|" + "---|" * len(CONTROLLERS))
    for name in truths:
        truth = load_truth(name)
        corrected = trace_model(truth, FLIGHTS, np.random.default_rng(0)).model
        models = {"corrected": corrected}
        if not estimated:
            drawn = GliderModel(parameters=truth.parameters)
            models = {"drawn": drawn, "corrected": corrected}
        for label, model in models.items():
            cells = {controller: [] for controller in CONTROLLERS}
            for times in WIDTHS:
                rng = np.random.default_rng([1, times])
                starts = draw_launches(problem, widened(times), launches, rng)
                unsure = times if estimated else None
                raced = race(truth, model, problem, starts, unsure=unsure)
                seconds.append(raced.seconds)
                failures += raced.failures
                for controller, flown in raced.flights.items():
                    cells[controller].append(flown)
            row = [
                f"{', '.join(str(f.perched) for f in flown)} "
                f"({', '.join(f'{1e3 * np.median(f.misses):.1f}' for f in flown)})"
                for flown in cells.values()
            ]
            print(f"| `{name}` | {label} | " + " | ".join(row) + " |", flush=True)
    times_ms = 1e3 * np.concatenate(seconds)
    half, most = np.percentile(times_ms, [50, 99])
    print(
        f"{len(times_ms)} plans anew, {failures} failed: median {half:.1f} ms, 99th "
        f"percentile {most:.1f} ms, worst {times_ms.max():.1f} ms, of 20 ms"
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
