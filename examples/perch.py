"""Plans a perch, replays it without feedback, and flies it from many launches.

Direct collocation finds the flight (25 knots, then 41), finite-horizon LQR tracks
it. Launches are perturbed: standard deviations of 0.04 m in height, 0.1 m/s in speed
and 0.02 rad in pitch. A flight perches if a hook can take it at the wire: within
5 cm, not faster than 2.8 m/s, nose up by 20° to 67°.

    python examples/perch.py
    python examples/perch.py --headless --figure perch.png
"""

import sys
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from diagrams import closed_loop, open_loop, playback, simulate_flights
from diagrams.programs import program
from glider import GliderModel, PerchingProblem, plan, tracking_regulator


def main(arguments: Sequence[str] | None = None) -> None:
    """Plans and flies, and shows the launch that misses by most."""
    parser = program.make_parser(__doc__)
    program.add_launches(parser, 20)
    words = "file, or the name of one in models/problems (default: %(default)s)"
    parser.add_argument("--problem", default="perching", help=words)
    words = "paths and elevator, as PNG"
    args = program.read_options(parser, arguments, figure=words)

    # The problem holds launch, wire, limits and weights; the plan holds states,
    # elevator rates and times at its knots.
    model = GliderModel()
    problem = PerchingProblem.load(args.problem)
    with program.working("plan (compiles once)"):
        planned = plan(model, problem)
    print(
        f"The plan costs {planned.cost:.2f} and takes {planned.duration:.4f} s "
        f"({len(planned.times)} knots, solved in {planned.seconds:.2f} s)."
    )

    # A Drake diagram each: the plan's commands to the servo of a glider, ...
    replay = open_loop(model, planned)
    # ... and time-varying LQR about the plan, u = u*(t) - K(t) (x - x*(t)).
    loop = closed_loop(model, tracking_regulator(model, planned))

    rng = np.random.default_rng(args.seed)
    starts = problem.draw_launches(args.launches, rng)
    end = planned.duration + 0.1  # A glider may pass the wire late.
    with program.working("fly"):
        alone = simulate_flights(replay, planned.states[:1], end, problem=problem)
        blind = simulate_flights(replay, starts, end, problem=problem)
        flown = simulate_flights(loop, starts, end, problem=problem)
    print(f"Replayed without feedback it misses by {1000 * alone[0].miss:.2f} mm.")
    print(f"From perturbed launches, without feedback: {blind.describe()}.")
    print(f"With feedback: {flown.describe()}.")

    if args.figure:
        figure = Figure(figsize=(9.5, 5.6), layout="constrained")
        top, bottom = figure.subplots(2, 1, height_ratios=[3, 2])
        program.plot_perches(top, planned, flown, blind)
        for flight in flown:
            elevator = np.degrees(flight.states[:, 3])
            bottom.plot(flight.times, elevator, color="#0072B2", lw=0.7, alpha=0.5)
        elevator = np.degrees(planned.states[:, 3])
        bottom.plot(planned.times, elevator, color="k", lw=1.8, ls=(0, (4, 2)))
        bottom.set(xlabel="time [s]", ylabel="elevator, up > 0 [°]")
        figure.savefig(args.figure, dpi=150)
    worst = playback.track_of("worst launch", flown.worst)
    ghost = playback.track_of("plan", planned, playback.GREY)
    program.show(args, [worst, ghost], "Perch")


if __name__ == "__main__":
    sys.exit(program.run(main))
