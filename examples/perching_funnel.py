"""Certifies a perch: how far may a launch err, for the drawn and the corrected glider?

A funnel is a tube of states about the plan that the closed loop never leaves and that
ends at the wire. Sums of squares prove it for the third-order dynamics, the servo's
rate and travel limits inside; every proof is then checked in whole numbers. Flights of
the full dynamics from its boundary try to break it. With --remainder the funnel bears
what the polynomials leave out, and with --prove that is proven to be all of it.

The true glider has an effect that its drawing lacks. It flies with the drawing's plan,
its logs are traced, and a second funnel is made with the model that was found. Does the
true glider stay in the drawing's funnel, and in the second? With --estimate the drawn
glider's feedback gets a filter's estimate instead of the state, from ever noisier
motion capture: how much error is borne?

    python examples/perching_funnel.py
    python examples/perching_funnel.py --truth slow_servo --figure funnels.png
    python examples/perching_funnel.py --remainder 1.1 --prove --headless --json f.json
    python examples/perching_funnel.py --load models/funnels --estimate 200
"""

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from rich.console import Console

from diagrams.showing import (
    add_options,
    add_truth,
    check_folders,
    run,
    whole_number,
    write_figures,
)
from diagrams.studies.funnel_estimate import (
    describe_estimates,
    estimate_figures,
    save_estimate_figure,
)
from diagrams.studies.funnel_figures import save_funnel_figure
from diagrams.studies.funnel_report import describe
from diagrams.studies.funnel_scene import show_funnel
from diagrams.studies.funnel_study import study_funnel
from diagrams.studies.rehearsal import (
    load_truth,
    rehearse,
)
from glider.errors import InputError
from glider.physics.model import GliderModel
from glider.planning.problem import PerchingProblem
from glider.simulation.monte_carlo import (
    LaunchSpread,
    draw_launches,
)
from glider.sysid.pipeline import close_the_loop
from glider.verification.funnel.funnel import save_funnel
from glider.verification.funnel.settings import FunnelSettings
from glider.verification.trials.estimated import study_estimates
from glider.verification.trials.falsify import falsify_funnel


def main(arguments: Sequence[str] | None = None) -> None:
    """Reads the command line, certifies, checks, attacks, prints and shows."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add_truth(parser, "head_wind")
    parser.add_argument("--samples", type=whole_number(8), default=8000, help="flights")
    parser.add_argument("--every", type=whole_number(1), default=1, help="exact checks")
    parser.add_argument(
        "--flights", type=whole_number(3), default=20, help="that are traced"
    )
    parser.add_argument(
        "--remainder", type=float, default=0.0, help="times the largest found"
    )
    prove_help = "prove the remainder; takes minutes"
    parser.add_argument("--prove", action="store_true", help=prove_help)
    parser.add_argument("--seed", type=whole_number(0), default=0, help="of flights")
    parser.add_argument("--load", metavar="DIR", type=Path, help="funnels saved there")
    parser.add_argument("--save", metavar="DIR", type=Path, help="where to save them")
    parser.add_argument("--figure", metavar="FILE", type=Path, help="tubes, as PNG")
    noisy_help = "flights on an estimate at each noise, drawn beside --figure"
    parser.add_argument(
        "--estimate", type=whole_number(1), metavar="N", help=noisy_help
    )
    add_options(parser)
    args = parser.parse_args(arguments)
    if args.prove and not (args.remainder or args.load):
        parser.error("--prove: there is nothing to prove without --remainder.")
    files = {"drawn": "drawn.npz", "corrected": f"{Path(args.truth).stem}.npz"}
    saved = [args.save / name for name in files.values()] if args.save else []
    second = None
    if args.figure and args.estimate:
        second = args.figure.with_stem(f"{args.figure.stem}_estimate")
    check_folders(args.json, args.html, args.figure, second, *saved)

    settings = FunnelSettings(remainder=args.remainder)
    truth, rng = load_truth(args.truth), np.random.default_rng(args.seed)
    studies, foreign = {}, {}
    with Console(stderr=True).status("plan (compiles once)") as status:
        sources: dict[str, Path | GliderModel]
        if args.load:
            sources = {name: args.load / file for name, file in files.items()}
        else:
            sources = {
                "drawn": GliderModel(parameters=truth.parameters),
                "corrected": trace_model(truth, args.flights, rng, status.update),
            }
        for name, source in sources.items():
            study = study_funnel(
                source,
                settings,
                args.samples,
                args.every,
                rng,
                status.update,
                prove=args.prove,
            )
            studies[name] = study
            if args.save:
                save_funnel(args.save / files[name], study.funnel)
            status.update(f"the {name} funnel, flown by the true glider")
            try:
                attack = falsify_funnel(study.funnel, args.samples, rng, model=truth)
            except InputError:  # The model has states that the true glider lacks.
                attack = None
            foreign[name] = attack
        drawn = studies["drawn"]
        estimated = []
        if count := args.estimate:
            estimated = study_estimates(
                drawn.funnel, count, rng, progress=status.update
            )
    for name, study in studies.items():
        print(describe(name, study.figures))
        if found := foreign[name]:
            words = f"{found.escapes} of {found.samples} flights leave it"
        else:
            words = "it has no meaning: their states differ"
        print(f"  Flown by {args.truth}, {words}.")
    report = drawn.figures | {"corrected": studies["corrected"].figures}
    report |= {"truth": args.truth, "seed": args.seed}
    for name, found in foreign.items():
        report[f"{name}_on_truth_escapes"] = found and found.escapes
        report[f"{name}_on_truth_samples"] = found and found.samples
    if estimated:
        print(f"drawn, on an estimate:\n{describe_estimates(estimated)}")
        report["estimate"] = estimate_figures(estimated)
    write_figures(args, report)
    if args.figure:
        save_funnel_figure(args.figure, studies)
    if second:
        save_estimate_figure(second, estimated)
    show_funnel(args, studies["corrected"], f"A certified perch: {args.truth}")


def trace_model(
    truth: GliderModel,
    flights: int,
    rng: np.random.Generator,
    progress: Callable[[str], None],
) -> GliderModel:
    """Returns what the logs of perches planned with the drawing tell of a glider.

    Args:
        truth: the glider that flies.
        flights: how many.
        rng: of the launches and of the noise of motion capture.
        progress: told what is being done.
    """
    problem, drawing = PerchingProblem(), GliderModel(parameters=truth.parameters)
    starts = draw_launches(problem, LaunchSpread(), flights, rng)
    flown = rehearse(truth, drawing, problem, starts, rng, progress)
    return close_the_loop(flown.campaign, progress=progress).model


if __name__ == "__main__":
    sys.exit(run(main))
