"""Plans a perch, replays it without feedback, and flies it from many launches.

Direct collocation finds the flight (25 knots, then 41), finite-horizon LQR defends
it. A launch errs by 0.04 m in height, 0.1 m/s in speed and 0.02 rad in pitch, one
standard deviation each; a flight perches if it comes within 5 cm of the wire.

    python examples/perch.py
    python examples/perch.py --headless --json perch.json --figure perch.png
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich.console import Console

from diagrams.closed_loop import closed_loop
from diagrams.open_loop import open_loop
from diagrams.playback import GREY
from diagrams.showing import (
    add_launches,
    add_options,
    check_folders,
    run,
    show,
    write_figures,
)
from diagrams.simulate import simulate_flights
from diagrams.studies.figures import save_perch_figure
from diagrams.tracks import (
    flight_track,
    plan_track,
)
from glider.control.tvlqr_drake import tracking_regulator
from glider.physics.model import GliderModel
from glider.planning.dircol import plan
from glider.planning.problem import PerchingProblem
from glider.simulation.fly import AFTER
from glider.simulation.monte_carlo import (
    LaunchSpread,
    draw_launches,
)


def main(arguments: Sequence[str] | None = None) -> None:
    """Reads the command line, plans, flies, prints and shows what came out."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add_launches(parser, 20)
    parser.add_argument("--figure", metavar="FILE", type=Path, help="paths, as PNG")
    add_options(parser)
    args = parser.parse_args(arguments)
    check_folders(args.json, args.html, args.figure)

    model, problem = GliderModel(), PerchingProblem()
    rng = np.random.default_rng(args.seed)
    starts = draw_launches(problem, LaunchSpread(), args.launches, rng)
    with Console(stderr=True).status("plan (compiles once)") as status:
        planned = plan(model, problem, progress=status.update)
        duration = planned.duration + AFTER
        replay = open_loop(model, planned)
        [replayed] = simulate_flights(replay, planned.states[:1], duration)
        blind = simulate_flights(replay, starts, duration, progress=status.update)
        loop = closed_loop(model, tracking_regulator(model, planned))
        flights = simulate_flights(loop, starts, duration, progress=status.update)
    misses = [flight.miss for flight in flights]
    figures = {
        "cost": planned.cost,
        "duration": planned.duration,
        "knots": len(planned.times),
        "plan_seconds": planned.seconds,
        "max_defect": planned.max_defect,
        "path_defect": planned.path_defect,
        "open_loop_miss_m": replayed.miss,
        "open_loop_from_launches_miss_m": [flight.miss for flight in blind],
        "closed_loop_miss_m": misses,
        "perched": sum(flight.perched for flight in flights),
        "launches": len(flights),
        "seed": args.seed,
    }
    print(
        f"The plan costs {planned.cost:.2f} and takes {planned.duration:.4f} s "
        f"({len(planned.times)} knots, solved in {planned.seconds:.2f} s).\n"
        f"Replayed without feedback it misses by {1000 * replayed.miss:.2f} mm; "
        f"from {len(blind)} launches that err, {sum(f.perched for f in blind)} perch.\n"
        f"With feedback {figures['perched']} of {len(flights)} perch; the median "
        f"miss is {1000 * np.median(misses):.1f} mm, the largest "
        f"{1000 * max(misses):.1f} mm."
    )
    write_figures(args, figures)
    if args.figure:
        save_perch_figure(args.figure, planned, flights, blind)
    worst = flights[int(np.argmax(misses))]
    tracks = [flight_track("worst launch", worst), plan_track("plan", planned, GREY)]
    show(args, tracks, "Perch")


if __name__ == "__main__":
    sys.exit(run(main))
