"""Certifies a perch: how far may a launch err, for the nominal and the corrected model?

A funnel is a tube of states about the plan that the closed loop never leaves and that
ends at the wire. Sums of squares prove it for the third-order dynamics, the servo's
rate and travel limits inside; every proof is then checked in whole numbers. Flights of
the full dynamics from its boundary try to break it. With --remainder the funnel bears
what the polynomials leave out; --prove proves, in continuous time, that no flight
leaves; --confidence makes the second for all gliders that the logs allow; with --hook
the hook takes every state at its end.

The true glider has an effect that its nominal model lacks. It flies with that one's
plan, its logs are traced, and a second funnel is made with the model that was found.
Does the true glider stay in the first funnel, and in the second? With --estimate the
nominal model's feedback gets a filter's estimate instead of the state, from ever
noisier motion capture: how much error is borne?

    python examples/perching_funnel.py
    python examples/perching_funnel.py --truth slow_servo --figure funnels.png
    python examples/perching_funnel.py --hook --remainder 1.1 --prove --json f.json
    python examples/perching_funnel.py --load models/funnels --estimate 200
"""

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from diagrams import program
from diagrams.studies.funnel_figures import save_funnel_figures
from diagrams.studies.funnel_options import read_funnel_options
from diagrams.studies.funnel_report import describe, key_figures
from diagrams.studies.funnel_scene import show_funnel
from diagrams.studies.funnel_study import FunnelComparison, FunnelTrials, study_funnel
from diagrams.studies.rehearsal import trace_model
from glider.physics.model import GliderModel
from glider.verification.funnel.funnel import save_funnel
from glider.verification.trials.estimated import study_estimates


def run(
    truth: GliderModel,
    trials: FunnelTrials,
    seed: int = 0,
    *,
    load: tuple[Path, ...] = (),
    flights: int = 20,
    estimate: int | None = None,
    progress: program.Progress = program.silent,
) -> FunnelComparison:
    """Certifies perches with the nominal and with the traced model; tries both."""
    nominal, rng = GliderModel(parameters=truth.parameters), np.random.default_rng(seed)
    sources = load or (nominal, trace_model(truth, flights, rng, progress))
    nominal, corrected = (
        study_funnel(s, truth, trials, rng, progress) for s in sources
    )
    estimated = []
    if estimate:
        estimated = study_estimates(nominal.funnel, estimate, rng, progress=progress)
    return FunnelComparison(nominal=nominal, corrected=corrected, estimated=estimated)


def main(arguments: Sequence[str] | None = None) -> None:
    """Certifies as the command line says, prints and shows what came out."""
    args = read_funnel_options(__doc__, arguments)
    truth = program.load_truth(args.truth)
    options = {"load": args.load, "flights": args.flights, "estimate": args.estimate}
    with program.working("plan (compiles once)") as progress:
        found = run(truth, args.trials, args.seed, **options, progress=progress)
    for file, study in zip(args.save, found.studies.values(), strict=False):
        save_funnel(file, study.funnel)
    print(describe(found, args.truth))
    told = {"truth": args.truth, "seed": args.seed}
    program.write_json(args, key_figures(found) | told)
    program.write_figure(args, save_funnel_figures, found)
    show_funnel(args, found.corrected, f"A certified perch: {args.truth}")


if __name__ == "__main__":
    sys.exit(program.run(main))
