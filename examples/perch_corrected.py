"""What closing the loop buys: the perch miss with the nominal and the corrected model.

The true glider has an effect that its nominal model lacks, and the planner is not told.
With the nominal model it plans, flies and logs; the logs are traced; with the corrected
model it plans and flies again. Launches err as in `perch.py`; commands come at 50 Hz.

    python examples/perch_corrected.py --truth head_wind
    python examples/perch_corrected.py --truth my_glider.yaml --headless --json out.json
"""

import sys
from collections.abc import Sequence

import numpy as np

from diagrams import program
from diagrams.playback import GREY, RED
from diagrams.studies.figures import save_rehearsals_figure
from diagrams.studies.rehearsal import Correction, Rehearsal, rehearse
from diagrams.tracks import flight_track, plan_track
from glider.physics.model import GliderModel
from glider.planning.problem import PerchingProblem
from glider.simulation.monte_carlo import LaunchSpread, draw_launches
from glider.sysid.pipeline import close_the_loop


def fly(
    truth: GliderModel,
    launches: int = 100,
    seed: int = 0,
    progress: program.Progress = program.silent,
) -> Correction:
    """Flies with the nominal model, traces the logs, and flies with what they show."""
    problem, rng = PerchingProblem(), np.random.default_rng(seed)

    def fly_with(model: GliderModel) -> Rehearsal:
        starts = draw_launches(problem, LaunchSpread(), launches, rng)
        return rehearse(truth, model, problem, starts, rng, progress)

    before = fly_with(GliderModel(parameters=truth.parameters))
    found = close_the_loop(before.campaign, progress=progress)
    after = fly_with(found.model)
    return Correction(truth=truth, before=before, found=found, after=after)


def main(arguments: Sequence[str] | None = None) -> None:
    """Flies as the command line says, prints and shows what came out."""
    parser = program.make_parser(__doc__)
    program.add_truth(parser, "head_wind")
    program.add_launches(parser, 100, least=3)
    args = program.read_options(parser, arguments, figure="paths, as PNG")
    truth = program.load_truth(args.truth)
    with program.working("plan (compiles once)") as progress:
        flown = fly(truth, args.launches, args.seed, progress)
    print(flown.describe())
    program.write_json(args, flown.key_figures() | {"seed": args.seed})
    program.write_figure(args, save_rehearsals_figure, flown.before, flown.after)
    tracks = [
        flight_track("planned corrected", flown.after.flights[0]),
        flight_track("planned nominal", flown.before.flights[0], RED),
        plan_track("plan of the nominal model", flown.before.plan, GREY),
    ]
    program.show(args, tracks, f"Before and after: {args.truth}")


if __name__ == "__main__":
    sys.exit(program.run(main))
