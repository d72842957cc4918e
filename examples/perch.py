"""Plans a perch, replays it without feedback, and flies it from many launches.

Direct collocation finds the flight (25 knots, then 41), finite-horizon LQR defends
it. A launch errs by 0.04 m in height, 0.1 m/s in speed and 0.02 rad in pitch, one
standard deviation each; a flight perches if a hook can take it at the wire: within
5 cm, not faster than 2.8 m/s, nose up by 20° to 67°.

    python examples/perch.py
    python examples/perch.py --headless --json perch.json --figure perch.png
"""

import sys
from collections.abc import Sequence

import numpy as np

from diagrams import program
from diagrams.loops import closed_loop
from diagrams.loops import open_loop
from diagrams.playback import GREY
from diagrams.simulate import simulate_flights
from diagrams.studies.figures import save_perch_figure
from diagrams.studies.perch_study import PerchStudy
from diagrams.tracks import flight_track, plan_track
from glider.control.tvlqr_drake import tracking_regulator
from glider.physics.model import GliderModel
from glider.planning.dircol import plan
from glider.planning.problem import PerchingProblem
from glider.simulation.fly import AFTER
from glider.simulation.monte_carlo import LaunchSpread, draw_launches


def fly(
    launches: int = 20, seed: int = 0, progress: program.Progress = program.silent
) -> PerchStudy:
    """Plans, replays the plan, and flies it from launches that err."""
    model, problem, rng = GliderModel(), PerchingProblem(), np.random.default_rng(seed)
    starts = draw_launches(problem, LaunchSpread(), launches, rng)
    planned = plan(model, problem, progress=progress)
    replay = open_loop(model, planned)
    loop = closed_loop(model, tracking_regulator(model, planned))
    duration = planned.duration + AFTER
    [replayed] = simulate_flights(replay, planned.states[:1], duration)
    return PerchStudy(
        plan=planned,
        replayed=replayed,
        blind=simulate_flights(replay, starts, duration, progress=progress),
        flights=simulate_flights(loop, starts, duration, progress=progress),
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Flies as the command line says, prints and shows what came out."""
    parser = program.make_parser(__doc__)
    program.add_launches(parser, 20)
    args = program.read_options(parser, arguments, figure="paths, as PNG")
    with program.working("plan (compiles once)") as progress:
        flown = fly(args.launches, args.seed, progress)
    print(flown.describe())
    program.write_json(args, flown.key_figures() | {"seed": args.seed})
    program.write_figure(args, save_perch_figure, flown)
    worst, planned = flight_track("worst launch", flown.flights.worst), flown.plan
    program.show(args, [worst, plan_track("plan", planned, GREY)], "Perch")


if __name__ == "__main__":
    sys.exit(program.run(main))
