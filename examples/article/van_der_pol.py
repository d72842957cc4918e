"""How much of a region of attraction can sums of squares prove?

The reversed Van der Pol oscillator goes to the origin from within its limit cycle.
With V from the Lyapunov equation, alternation between the multiplier and the level
proves the ellipse {V <= 2.3045}: less than half of the region. Where V may change too
and is of degree 4 or 6, alternation between the multiplier and V proves nearly all of
it. Every proof is checked in exact arithmetic; the solver is not trusted.

    python examples/article/van_der_pol.py
    python examples/article/van_der_pol.py --rounds 3 --json v.json --figure v.png
"""

import dataclasses
import sys
import time
from collections.abc import Sequence

import attraction as oscillator
from diagrams import program
from region_figures import save_regions_figure


@dataclasses.dataclass(frozen=True, kw_only=True)
class Result:
    """The level of the Lyapunov function, and what V of each degree proves."""

    level: float
    proved: dict[int, oscillator.Region]
    shares: dict[int, float]


def run(rounds: int = 16, progress: program.Progress = program.silent) -> Result:
    """Alternates for the level, then for V of degree 4 and 6; checks the proofs."""

    def tell(k: int, area: float) -> None:
        progress(f"round {k} of {rounds}: {area / oscillator.true_area():.1%}")

    V = oscillator.lyapunov_function()
    level = oscillator.largest_level(V)
    proved = {2: oscillator.certify(V / level, 1)}
    for degree in (4, 6):
        start = oscillator.start_of_degree(degree, V / level)
        grown = oscillator.grow(start, degree // 2, rounds, tell)
        proved[degree] = oscillator.certify(grown, degree // 2)
    shares = {degree: oscillator.share(region) for degree, region in proved.items()}
    return Result(level=level, proved=proved, shares=shares)


def main(arguments: Sequence[str] | None = None) -> None:
    """Alternates as the command line says, prints and draws what is proved."""
    parser = program.make_parser(__doc__)
    words = "of alternation, for V of degree 4 and 6 (default: %(default)s)"
    program.add_count(parser, "--rounds", 16, words, metavar="N")
    program.add_file(parser, "--json", "key figures")
    program.add_file(parser, "--figure", "the regions")
    parser.add_argument("--headless", action="store_true", help="there is no animation")
    args = parser.parse_args(arguments)
    program.check_files(args.json, figure=args.figure)
    begin = time.perf_counter()
    with program.working("level of the Lyapunov function") as progress:
        found = run(args.rounds, progress)
    print(f"With the Lyapunov function the level is {found.level:.4f}.")
    for degree, share in found.shares.items():
        print(f"V of degree {degree}: {share:.1%} of the region, proved and checked")
    told: dict = {"rho": found.level, "degree": found.shares, "rounds": args.rounds}
    told |= {
        "true_area": oscillator.true_area(),
        "seconds": time.perf_counter() - begin,
    }
    program.write_json(args, told)
    curves = {
        f"degree {k}: {found.shares[k]:.1%}": oscillator.boundary(region.polynomial)
        for k, region in found.proved.items()
    }
    program.write_figure(args, save_regions_figure, oscillator.limit_cycle(), curves)


if __name__ == "__main__":
    sys.exit(program.run(main))
