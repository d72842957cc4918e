"""How much of a region of attraction can sums of squares prove?

The reversed Van der Pol oscillator goes to the origin from within its limit cycle.
With V from the Lyapunov equation, alternation between the multiplier and the level
proves the ellipse {V <= 2.3045}: less than half of the region. Where V may change too
and is of degree 4 or 6, alternation between the multiplier and V proves nearly all of
it. Every proof is checked in exact arithmetic; the solver is not trusted.

    python examples/van_der_pol.py
    python examples/van_der_pol.py --rounds 3 --json v.json --figure v.png
"""

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from diagrams.showing import (
    check_folders,
    run,
    whole_number,
    write_figures,
)
from glider.studies.plots.regions import save_regions_figure
from glider.studies.van_der_pol import (
    area,
    boundary,
    certify,
    grow,
    largest_level,
    limit_cycle,
    lyapunov_function,
    start_of_degree,
    true_area,
)


def main(arguments: Sequence[str] | None = None) -> None:
    """Reads the command line, alternates, checks and prints what is proved."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--rounds",
        metavar="N",
        type=whole_number(1),
        default=16,
        help="of alternation, for V of degree 4 and 6 (default: %(default)s)",
    )
    parser.add_argument("--json", metavar="FILE", type=Path, help="key figures")
    parser.add_argument("--figure", metavar="FILE", type=Path, help="the regions")
    parser.add_argument("--headless", action="store_true", help="there is no animation")
    args = parser.parse_args(arguments)
    check_folders(args.json, None, args.figure)

    begin, V = time.perf_counter(), lyapunov_function()
    with Console(stderr=True).status("level of the Lyapunov function") as status:
        level = largest_level(V)
        proved = {2: certify(V / level, 1)}
        for degree in (4, 6):

            def tell(k: int, size: float, degree: int = degree) -> None:
                status.update(
                    f"degree {degree}, round {k} of {args.rounds}: "
                    f"{size / true_area():.1%}"
                )

            half = degree // 2
            start = start_of_degree(degree, V / level)
            proved[degree] = certify(grow(start, half, args.rounds, tell), half)
    shares = {
        degree: area(region.polynomial) / true_area()
        for degree, region in proved.items()
    }
    print(f"With the Lyapunov function the level is {level:.4f}.")
    for degree, share in shares.items():
        print(f"V of degree {degree}: {share:.1%} of the region, proved and checked")
    figures = {
        "rho": level,
        "degree": {str(degree): share for degree, share in shares.items()},
        "true_area": true_area(),
        "rounds": args.rounds,
        "seconds": time.perf_counter() - begin,
    }
    write_figures(args, figures)
    if args.figure:
        curves = {
            f"degree {degree}: {shares[degree]:.1%}": boundary(region.polynomial)
            for degree, region in proved.items()
        }
        save_regions_figure(args.figure, limit_cycle(), curves)


if __name__ == "__main__":
    sys.exit(run(main))
