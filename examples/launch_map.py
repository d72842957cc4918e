"""Which launches can perch at all?

The article's glider is launched 3.5 m before the wire, anywhere within 0.8 m of its
height, with 4.5 to 9.5 m/s, the nose up or down by up to 0.4 rad. For each launch
Drake's solver looks for a plan that keeps all limits. All processors work on it: a
thousand launches take four minutes on two.

    python examples/launch_map.py --figure map.png
    python examples/launch_map.py --launches 500
    python examples/launch_map.py --cluster tcp://host:8786
"""

import sys
import time
from collections.abc import Sequence

import joblib
import numpy as np
from matplotlib.figure import Figure

from diagrams.programs import program
from glider import GliderModel, PerchingProblem, can_perch, workers_of

AXES = {
    "height [m]": (1, -0.8, 0.8),
    "pitch, nose down [rad]": (2, -0.4, 0.4),
    "launch speed [m/s]": (4, 4.5, 9.5),
}
"""What varies: its place in a launch state, and its limits."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Plans from each launch, and draws the share that has a plan."""
    parser = program.make_parser(__doc__)
    program.add_launches(parser, 1_000)
    parser.add_path("--figure", "FILE", "the map")
    parser.add_cluster()
    args = parser.parse_args(arguments)
    program.check_files(figure=args.figure)

    rng = np.random.default_rng(args.seed)
    model = GliderModel()
    problem = PerchingProblem()
    launches = np.tile(problem.launch, (args.launches, 1))
    for column, low, high in AXES.values():
        launches[:, column] = rng.uniform(low, high, args.launches)
    with program.working("plan (compiles once)", is_even=True) as progress:
        can_perch(model, problem, problem.launch)  # Compiles for all workers.
        begin = time.perf_counter()
        solve = joblib.delayed(can_perch)
        tasks = (solve(model, problem, launch) for launch in launches.tolist())
        planned = np.zeros(args.launches, dtype=bool)
        with workers_of(args.cluster):
            answers = joblib.Parallel(n_jobs=-1, return_as="generator")(tasks)
            for i, answer in enumerate(answers):
                planned[i] = answer
                done = i + 1
                words = f"plan ({done} of {args.launches} launches)"
                progress(program.Step(words, done / args.launches))
        seconds = time.perf_counter() - begin
    print(
        f"{np.sum(planned):,} of {len(planned):,} launches have a plan to the wire "
        f"({seconds:.0f} s, {1e3 * seconds / len(planned):.1f} ms each)."
    )

    if args.figure:
        figure = Figure(figsize=(8.0, 3.2), layout="constrained")
        cells = int(np.clip(np.sqrt(len(planned) / 12), 4, 24))
        *others, speed = AXES
        for ax, other in zip(figure.subplots(1, 2), others, strict=True):
            across = launches[:, AXES[speed][0]]
            along = launches[:, AXES[other][0]]
            total, *edges = np.histogram2d(across, along, cells)
            good, *_ = np.histogram2d(across[planned], along[planned], edges)
            share = np.where(total > 0, good / np.maximum(total, 1), np.nan)
            mesh = ax.pcolormesh(*edges, share.T, vmin=0.0, vmax=1.0)
            ax.set(xlabel=speed, ylabel=other)
        figure.colorbar(mesh, ax=ax, label="share of launches with a plan")
        figure.savefig(args.figure)


if __name__ == "__main__":
    sys.exit(program.run(main))
