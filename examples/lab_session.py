"""A session in the lab, from the first throw to the corrected perch, without a page.

The station flies a simulated glider live, in two processes in real time: throws that
are planned with the nominal model and miss the wire. They are traced, the plan is made
again with the corrected model, and as many throws are flown with it.

    python examples/lab_session.py
    python examples/lab_session.py --truth slow_servo --folder out/servo --json out.json

The folder is a campaign for `glider close-the-loop`, and `glider lab FOLDER` shows it
in the browser. A session that was ended goes on where it was.

--json: {"truth", "verdict", "effects", "position_rms_m", "before", "after"}; before and
after are perches and throws.
"""

import dataclasses
import sys
from collections.abc import Sequence
from pathlib import Path

from diagrams.programs import fly_session, program
from glider import GliderModel


@dataclasses.dataclass(frozen=True, kw_only=True)
class Session:
    """A session that was completed."""

    truth: str  #: Name or file of the simulated glider.
    verdict: str  #: Of the throws with the nominal plan.
    effects: list[str]  #: That were found in them.
    position_rms_m: dict[str, float]  #: Of predictions, by model.
    before: list[int]  #: Perches and throws with the nominal plan.
    after: list[int]  #: The same with the corrected plan.


def run(
    truth: str,
    launches: int,
    seed: int,
    folder: Path,
    progress: program.Progress = program.silent,
) -> Session:
    """Flies as many launches, traces, plans again and flies as many."""
    found = fly_session(folder, truth, launches, seed, progress)
    answer = found.answer
    assert answer is not None  # It was completed.
    return Session(
        truth=truth,
        verdict=answer.verdict,
        effects=[effect.kind for effect in answer.effects],
        position_rms_m=dict(answer.errors),
        before=list(found.before),
        after=list(found.after),
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Flies as the command line says and prints the result."""
    parser = program.make_parser(__doc__)
    program.add_truth(parser, "head_wind")
    program.add_launches(parser, 10, 3)
    program.add_file(parser, "--json", "the result")
    words = "of the session (default: %(default)s)"
    folder = Path("out/lab_session")
    parser.add_argument("--folder", type=Path, default=folder, help=words)
    args = parser.parse_args(arguments)
    program.check_files(args.json)
    GliderModel.load(args.truth)  # Is there one?
    found = run(args.truth, args.launches, args.seed, args.folder, _show)
    program.write_json(args, dataclasses.asdict(found))


def _show(line: str) -> None:
    print(line, flush=True)  # The station prints, too.


if __name__ == "__main__":
    sys.exit(program.run(main))
