"""Which throw next? Proposes throws to a hidden glider until two rivals are told apart.

The servo of the hidden glider is two milliseconds late: by a lag, or by a delay? Four
random flights do not tell. Each round proposes the throw that tells most, says what it
expects of it, flies it (the launch a little missed, motion capture with its noise) and
weighs both explanations again, until one has probability 0.95.

    python examples/next_throw.py --figure proposal.png
    python examples/next_throw.py --effect servo_lag --headless --json out.json

--json: {"truth", "found", "throws", "probabilities", "promised"}; the probabilities are
those before the first throw and after each. --figure: the first proposal.
"""

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from diagrams import showing
from diagrams.playback import GREY
from diagrams.tracks import path_track
from glider.report.next_throw import draw_proposal
from glider.report.next_throw_words import sentences
from glider.studies.throw_study import RIVALS, ThrowStudy, tell_rivals_apart


def run(
    effect: str,
    launches: int = 6,
    seed: int = 0,
    progress: showing.Progress = showing.silent,
) -> ThrowStudy:
    """Flies at most so many proposed throws of a glider with one of RIVALS."""
    return tell_rivals_apart(effect, most=launches, seed=seed, progress=progress)


def save_proposal(path: Path, study: ThrowStudy) -> None:
    """Saves the picture of the first proposal."""
    form = path.suffix.removeprefix(".")
    path.write_bytes(draw_proposal(study.proposals[0], form))


def main(arguments: Sequence[str] | None = None) -> None:
    """Tells the rivals apart as the command line says, prints and shows how."""
    parser = showing.make_parser(__doc__)
    words = "what the hidden glider has (default: %(default)s)"
    parser.add_argument("--effect", choices=RIVALS, default=RIVALS[1], help=words)
    showing.add_launches(parser, 6)
    args = showing.read_options(parser, arguments, figure="the first proposal, as PNG")
    with showing.working("compile (once)") as progress:
        found = run(args.effect, args.launches, args.seed, progress)
    for proposal in found.proposals[:1]:
        print(*sentences(proposal), sep="\n")
    print(found.describe())
    showing.write_json(args, found.key_figures())
    if found.proposals:
        showing.write_figure(args, save_proposal, found)
    tracks = [
        path_track(
            f"{'given' if k < found.given else 'proposed'} {k}",
            flight.time,
            np.column_stack([flight.pose, flight.elevator]),
            GREY if k < found.given else None,
        )
        for k, flight in enumerate(found.flights)
    ]
    showing.show(args, tracks[::-1], f"Which throw: {args.effect}", has_wire=False)


if __name__ == "__main__":
    sys.exit(showing.run(main))
