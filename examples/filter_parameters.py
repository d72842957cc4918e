"""Which flight tells a filter where the wing sits and how large the elevator is?

An extended Kalman filter takes two numbers of the glider, the wing's offset l_w and
the elevator's area S_e, for slow states, and starts with both at zero. It watches the
article's cruise (powered, in a drifting wind, launched half a metre too high), the
same cruise once it has settled, and a perch. A number can be known only as far as the
motion depends on it, so beside the filter's deviations stand the least that any
estimator could reach, by Fisher information. Then: is the filter as uncertain as it
says (NEES and NIS, 1 is right), and is it good enough to perch with?

    python examples/filter_parameters.py
    python examples/filter_parameters.py --headless --json f.json --figure f.png
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich.console import Console

from diagrams.estimated import fly_on_estimate
from diagrams.filter_figure import save_study_figure
from diagrams.playback import GREY
from diagrams.showing import (
    add_launches,
    add_options,
    check_folders,
    run,
    show,
    write_figures,
)
from diagrams.tracks import flight_track, plan_track
from glider.estimation.perching import watch_perches
from glider.estimation.study import CONSTANTS, RATE, SYMBOLS, watch_all
from glider.model_file import GliderModel
from glider.monte_carlo import LaunchSpread, draw_launches
from glider.parameters import load_parameters
from glider.paths import models_path
from glider.planning.dircol import plan
from glider.planning.problem import load_problem
from glider.plant import GliderPlant
from glider.riccati import compiled_policy


def main(arguments: Sequence[str] | None = None) -> None:
    """Reads the command line, filters, flies, prints and shows what came out."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--figure", metavar="FILE", type=Path, help="of l_w and S_e")
    add_launches(parser, 20)
    add_options(parser)
    args = parser.parse_args(arguments)
    check_folders(args.json, args.html, args.figure)

    cruising = load_parameters(models_path("vehicles", "heavy_ekf.yaml"))
    perching = load_parameters(models_path("vehicles", "heavy.yaml"))
    problem = load_problem(models_path("problems", "perching.yaml"))
    model, rng = GliderModel(parameters=perching), np.random.default_rng(args.seed)
    with Console(stderr=True).status("plan (compiles once)") as status:
        planned = plan(GliderPlant(model), problem, progress=status.update)
        policy = compiled_policy(GliderPlant(model), planned)
        status.update("filter (compiles once)")
        drifting = watch_all(cruising, perching, policy, rng)
        constant = watch_all(cruising, perching, policy, rng, CONSTANTS)
        trusted = watch_perches(model, policy, 200, rng).consistency
        starts = draw_launches(problem, LaunchSpread(), args.launches, rng)
        flown = fly_on_estimate(model, planned, starts, rng, status.update)

    end = len(constant["perch"].slow) - 1  # As long as the perch takes.
    misses = [flight.miss for flight in flown.on_estimate]
    figures = {
        **{name: watched.numbers for name, watched in drifting.items()},
        "constant": {name: watched.numbers for name, watched in constant.items()},
        "least_std": {
            name: dict(zip(SYMBOLS, watched.bound[end].tolist(), strict=True))
            for name, watched in constant.items()
        },
        "seconds": end / RATE,
        "nees": float(np.mean(trusted.nees)),
        "nis": float(np.mean(trusted.nis)),
        "nees_inside": trusted.nees_inside,
        "nis_inside": trusted.nis_inside,
        "miss_on_state_m": [flight.miss for flight in flown.on_state],
        "miss_on_estimate_m": misses,
        "launches": args.launches,
        "seed": args.seed,
    }
    for name, watched in constant.items():
        columns = watched.slow[end], watched.std[end], watched.bound[end]
        rows = zip(SYMBOLS, *columns, strict=True)
        told = "; ".join(
            f"{s} {m:.4f} ± {d:.4f} (least {b:.4f})" for s, m, d, b in rows
        )
        print(f"{name}, after {end / RATE:.2f} s: {told}")
    on_state = np.median(figures["miss_on_state_m"])
    print(
        f"Over 200 perches NEES is {figures['nees']:.3f} and NIS {figures['nis']:.3f}; "
        f"{trusted.nees_inside:.0%} and {trusted.nis_inside:.0%} of the samples are "
        f"in their 95 % bands.\n"
        f"On the estimate {sum(f.perched for f in flown.on_estimate)} of "
        f"{args.launches} launches perch, median miss {1000 * np.median(misses):.1f} "
        f"mm; on the true state {1000 * on_state:.1f} mm."
    )
    write_figures(args, figures)
    if args.figure:
        save_study_figure(args.figure, drifting, constant)
    worst = flown.on_estimate[int(np.argmax(misses))]
    tracks = [
        flight_track("worst launch on the estimate", worst),
        plan_track("plan", planned, GREY),
    ]
    show(args, tracks, "Perch on an estimate", parameters=perching)


if __name__ == "__main__":
    sys.exit(run(main))
