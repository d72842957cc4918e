"""Closes the loop on a campaign: what does the model lack, and how much does it matter?

python examples/close_the_loop.py [CAMPAIGN] [--model FILE]
"""

import math
import sys
from collections.abc import Sequence
from pathlib import Path

from diagrams.programs import program
from glider import close_the_loop


def main(arguments: Sequence[str] | None = None) -> None:
    """Finds what the model of a campaign's glider lacks, and prints it."""
    parser = program.make_parser(__doc__)
    words = "folder of flight logs, or the name of a sample (default: %(default)s)"
    sample = Path("attached_lift")
    parser.add_argument("campaign", nargs="?", type=Path, default=sample, help=words)
    parser.add_path("--model", "FILE", "where to save the corrected model")
    args = parser.parse_args(arguments)
    program.check_files(args.model)

    with program.working("close the loop (compiles once)") as progress:
        found = close_the_loop(args.campaign, progress=progress)
    print(f"{found.campaign}: {found.verdict}")
    for effect in found.effects:
        print(f"  {effect.kind} ({effect.words})")
        for name, c in effect.coefficients.items():
            error = f" ± {c.std:.2g}" if math.isfinite(c.std) else ""
            print(f"    {name} = {c.value:.4g}{error} {c.unit}")
    for model, errors in found.errors.items():
        if errors is not None:
            position = 1000.0 * errors.position_rms_m
            print(f"  {model}: held-out position error {position:.1f} mm")
    if args.model:
        found.model.save(args.model)


if __name__ == "__main__":
    sys.exit(program.run(main))
