"""The options of the funnels' example, and the files that they name."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from diagrams.program import (
    add_count,
    add_truth,
    check_files,
    make_parser,
    read_options,
)
from diagrams.studies.funnel_figures import beside
from diagrams.studies.funnel_study import FunnelTrials
from glider.paths import models_path
from glider.planning.problem import PerchingProblem, load_problem
from glider.verification.funnel.settings import LAUNCH_SIZES, FunnelSettings


def read_funnel_options(
    words: str | None, arguments: Sequence[str] | None
) -> argparse.Namespace:
    """Reads the options, and checks the files to write.

    Args:
        words: of the help.
        arguments: of the command line; None for those of the process.

    Returns:
        What they say: `trials` is how to try funnels, `load` and `save` are the files
        of the nominal model and the corrected one, none where not asked for.

    Raises:
        InputError: a file cannot be written, or there are no such trials.
    """
    parser = make_parser(words)
    add_truth(parser, "head_wind")
    add_count(parser, "--samples", 8000, "flights", least=8)
    add_count(parser, "--every", 1, "exact checks")
    add_count(parser, "--flights", 20, "that are traced", least=3)
    parser.add_argument(
        "--remainder", type=float, default=0.0, help="times the largest found"
    )
    made = (
        "make the feedback with the funnel's shape, up to this gain [1/s], such as 40"
    )
    parser.add_argument("--elevator-gain", type=float, default=0.0, help=made)
    wide = "shape the funnels for errors of the launch, above all in height"
    parser.add_argument("--for-launches", action="store_true", help=wide)
    allowed = "make the second for the gliders that the logs allow with it"
    parser.add_argument("--confidence", metavar="P", type=float, help=allowed)
    takes = "for models/problems/perching_hook.yaml: the hook takes all of the last set"
    parser.add_argument("--hook", action="store_true", help=takes)
    prove = "prove that no flight leaves; takes minutes"
    parser.add_argument("--prove", action="store_true", help=prove)
    add_count(parser, "--seed", 0, "of flights", least=0)
    parser.add_argument("--load", metavar="DIR", type=Path, help="funnels saved there")
    parser.add_argument("--save", metavar="DIR", type=Path, help="where to save them")
    noisy = "flights on an estimate at each noise, drawn beside --figure"
    add_count(parser, "--estimate", None, noisy, metavar="N")
    args = read_options(parser, arguments, figure="tubes, as PNG")
    if args.prove and not (args.remainder or args.load):
        parser.error("--prove: there is nothing to prove without --remainder.")
    if args.confidence is not None and (args.load or not args.remainder):
        parser.error("--confidence: it takes a --remainder, and no --load.")
    if args.confidence is not None and not 0.0 < args.confidence < 1.0:
        parser.error("--confidence: a probability between 0 and 1 is needed.")
    args.load, args.save = (_files(at, args.truth) for at in (args.load, args.save))
    problem = PerchingProblem()
    if args.hook:
        problem = load_problem(models_path("problems", "perching_hook.yaml"))
    args.trials = FunnelTrials(
        problem=problem,
        hook=args.hook,
        settings=FunnelSettings(
            remainder=args.remainder,
            elevator_gain=args.elevator_gain,
            launch_sizes=LAUNCH_SIZES if args.for_launches else None,
        ),
        samples=args.samples,
        every=args.every,
        prove=args.prove,
        confidence=args.confidence,
    )
    check_files(*args.save)
    if args.figure and args.estimate:
        check_files(figure=beside(args.figure))
    return args


def _files(folder: Path | None, truth: str) -> tuple[Path, ...]:
    """Returns the files of both funnels in a folder; none without a folder."""
    if folder is None:
        return ()
    return folder / "drawn.npz", folder / f"{Path(truth).stem}.npz"
