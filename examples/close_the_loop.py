"""Closes the loop on a campaign: what does the model lack, and how much does it matter?

python examples/close_the_loop.py [CAMPAIGN]
"""

import math
import sys
from collections.abc import Sequence
from pathlib import Path

from diagrams.programs import program
from glider import Result, close_the_loop


def run(campaign: Path, progress: program.Progress = program.silent) -> Result:
    """Finds what the model of a campaign's glider lacks, and adds it to the model."""
    return close_the_loop(campaign, progress=progress)


def describe(found: Result) -> str:
    """Returns verdict, effects and errors, a line each."""
    lines = [f"{found.campaign}: {found.verdict}"]
    for effect in found.effects:
        lines.append(f"  {effect.kind} ({effect.words})")
        for name, c in effect.coefficients.items():
            error = f" ± {c.std:.2g}" if math.isfinite(c.std) else ""
            lines.append(f"    {name} = {c.value:.4g}{error} {c.unit}")
    for model, errors in found.errors.items():
        if errors is not None:
            position = 1000.0 * errors.position_rms_m
            lines.append(f"  {model}: held-out position error {position:.1f} mm")
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> None:
    """Closes the loop as the command line says, and prints the result."""
    parser = program.make_parser(__doc__)
    program.add_campaign(parser)
    parser.add_argument("--model", type=Path, help="where to save the corrected model")
    parser.add_argument("--json", type=Path, help="where to save the key figures")
    args = parser.parse_args(arguments)
    program.check_files(args.model, args.json)
    with program.working("close the loop (compiles once)") as progress:
        found = run(args.campaign, progress)
    print(describe(found))
    if args.model:
        found.model.save(args.model)
    kinds = [effect.kind for effect in found.effects]
    program.write_json(args, {"verdict": found.verdict, "effects": kinds})


if __name__ == "__main__":
    sys.exit(program.run(main))
