"""Which flight shows a filter where the wing sits and how large the elevator is?

An extended Kalman filter takes two numbers of the glider, the wing's offset l_w and
the elevator's area S_e, for slow states. It watches the article's cruise (powered, in
a drifting wind, launched half a metre too high; it starts with both at zero) and a
perch (l_w starts at 0.02 m, S_e at zero). Their gliders differ: the perch's has its
wing at l_w = 0, the cruise's at -0.03 m, and with that no perch plan is found. A
number can be known only as far as the motion depends on it, so beside the filter's
deviations stand the least that any estimator could reach, by Fisher information;
of a settled cruise (the perch's glider, from trim, in air that is still at first)
there is only that. Then: is a filter as uncertain as it says (NEES and NIS, 1 is
right), and is it good enough to perch with? Both are asked of the filter that
perches: motion capture at 120 Hz with 1 mm of noise.

    python examples/article/filter_parameters.py
    python examples/article/filter_parameters.py --headless --json f.json --figure f.png

--json: {"cruise", "perch": {"l_w", "S_e": [estimate, standard deviation, truth]},
"constant", "least_std", "seconds", "slow_nees", "nees", "nis", "consistency_of", ..}.
"cruise" and "perch" are of the article's filter, which lets the numbers drift, at the
flight's end; "constant" are those of one that takes them for constants, and
"least_std" the least deviations, both after "seconds". "slow_nees" is the NEES of l_w
and S_e of "constant" over 20 flights. "nees" and "nis" are of "consistency_of".
"""

import sys
from collections.abc import Sequence

import numpy as np

from diagrams import playback, program
from filter_flights import fly_on_estimate, perching_glider, watch_twice
from filter_report import PERCHES, FilterReport, save_filter_figure
from filter_study import CONSTANTS, settled_bound
from glider.control.tvlqr import tracking_policy
from glider.estimation.perching import watch_perches
from glider.planning.dircol import plan
from glider.planning.problem import PerchingProblem
from glider.simulation.monte_carlo import LaunchSpread, draw_launches


def fly(
    launches: int = 20, seed: int = 0, progress: program.Progress = program.silent
) -> FilterReport:
    """Filters a cruise and a perch in two ways, and perches on an estimate."""
    model, problem = perching_glider(), PerchingProblem()
    rng = np.random.default_rng(seed)
    policy = tracking_policy(model, plan(model, problem, progress=progress))
    drifting, constant = watch_twice(policy, rng, progress)
    starts = draw_launches(problem, LaunchSpread(), launches, rng)
    return FilterReport(
        plan=policy.plan,
        drifting=drifting,
        constant=constant,
        settled=settled_bound(model.parameters, rng, CONSTANTS),
        consistency=watch_perches(model, policy, PERCHES, rng).consistency,
        flown=fly_on_estimate(model, policy.plan, starts, rng, progress),
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Flies as the command line says, prints and shows the result."""
    parser = program.make_parser(__doc__)
    program.add_launches(parser, 20)
    args = program.read_options(parser, arguments, figure="of l_w and S_e")
    with program.working("plan (compiles once)") as progress:
        found = fly(args.launches, args.seed, progress)
    print(found.describe())
    program.write_json(args, found.key_figures() | {"seed": args.seed})
    program.write_figure(args, save_filter_figure, found)
    worst = playback.track_of(
        "worst launch on the estimate", found.flown.on_estimate.worst
    )
    tracks = [worst, playback.track_of("plan", found.plan, playback.GREY)]
    program.show(args, tracks, "Perch on an estimate")


if __name__ == "__main__":
    sys.exit(program.run(main))
