"""What closing the loop buys: the perch miss with the drawn and the corrected model.

The true glider has an effect that its drawing lacks, and the planner is not told.
With the drawing it plans, flies and logs; the logs are traced; with the corrected
model it plans and flies again. Launches err as in `perch.py`; commands come at 50 Hz.

    python examples/perch_corrected.py --truth head_wind
    python examples/perch_corrected.py --truth my_glider.yaml --headless --json out.json
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich.console import Console

from diagrams.playback import (
    GREY,
    RED,
)
from diagrams.showing import (
    add_launches,
    add_options,
    add_truth,
    check_folders,
    run,
    show,
    write_figures,
)
from diagrams.studies.figures import save_rehearsals_figure
from diagrams.studies.rehearsal import (
    Rehearsal,
    load_truth,
    rehearse,
)
from diagrams.tracks import (
    flight_track,
    plan_track,
)
from glider.physics.model import GliderModel
from glider.planning.problem import PerchingProblem
from glider.report.wording import headline
from glider.simulation.monte_carlo import (
    LaunchSpread,
    draw_launches,
)
from glider.sysid.pipeline import close_the_loop


def main(arguments: Sequence[str] | None = None) -> None:
    """Reads the command line, flies, traces, flies again, prints and shows."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add_truth(parser, "head_wind")
    add_launches(parser, 100, least=3)
    parser.add_argument("--figure", metavar="FILE", type=Path, help="paths, as PNG")
    add_options(parser)
    args = parser.parse_args(arguments)
    check_folders(args.json, args.html, args.figure)

    truth = load_truth(args.truth)
    problem, rng = PerchingProblem(), np.random.default_rng(args.seed)

    def fly(model: GliderModel) -> Rehearsal:
        starts = draw_launches(problem, LaunchSpread(), args.launches, rng)
        return rehearse(truth, model, problem, starts, rng, status.update)

    with Console(stderr=True).status("plan (compiles once)") as status:
        before = fly(GliderModel(parameters=truth.parameters))
        found = close_the_loop(before.campaign, progress=status.update)
        after = fly(found.model)

    true = [effect.kind.kind for effect in truth.effects]
    true += [] if truth.field is None else [truth.field.kind]
    figures: dict = {
        "effect_true": " + ".join(true) or "nothing",
        "effect_found": [effect.kind for effect in found.effects],
        "before": {"miss_m": before.misses, "perched": before.perched},
        "after": {"miss_m": after.misses, "perched": after.perched},
        "launches": args.launches,
        "seed": args.seed,
    }
    print(headline(found))
    for name, flown in (("as drawn", before), ("corrected", after)):
        print(
            f"planned {name}: {flown.perched} of {args.launches} launches perch, "
            f"median miss {1000 * np.median(flown.misses):.1f} mm"
        )
    write_figures(args, figures)
    if args.figure:
        save_rehearsals_figure(args.figure, before, after)
    tracks = [
        flight_track("planned corrected", after.flights[0]),
        flight_track("planned as drawn", before.flights[0], RED),
        plan_track("plan of the drawing", before.plan, GREY),
    ]
    show(args, tracks, f"Before and after: {args.truth}")


if __name__ == "__main__":
    sys.exit(run(main))
