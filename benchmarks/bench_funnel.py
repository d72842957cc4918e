"""How long funnels take, how wide they are, and what a proof takes.

python -m benchmarks.bench_funnel
"""

import time

import numpy as np

from glider.control.tvlqr import tracking_policy
from glider.physics.model import GliderModel
from glider.planning.dircol import plan
from glider.planning.problem import PerchingProblem
from glider.verification.funnel.build import make_funnel
from glider.verification.funnel.settings import FunnelSettings
from glider.verification.proof.check import check_funnel
from glider.verification.proof.flight_proof import prove_flights
from glider.verification.trials import ESCAPE_LEVEL, falsify_funnel

EVERY = 5
"""Of the intervals that the proof looks at."""


def main():
    """Prints a row for each inflation of the sampled remainder."""
    policy = tracking_policy(GliderModel(), plan(GliderModel(), PerchingProblem()))
    row = "{:>9} {:>8} {:>8} {:>9} {:>10} {:>10} {:>28} {}"
    names = ("remainder", "z [m]", "pitch °", "ẋ [m/s]", "made [s]", "check", "proof")
    print(row.format(*names, ""))
    for remainder in (0.0, 1.0, 1.1, 1.2):
        settings = FunnelSettings(remainder=remainder)
        funnel = make_funnel(GliderModel(), policy, settings)
        began = time.perf_counter()
        verdict = check_funnel(funnel)
        checked = time.perf_counter() - began
        began = time.perf_counter()
        proof = prove_flights(funnel, EVERY) if remainder > 1.0 else None
        proven = time.perf_counter() - began
        levels = falsify_funnel(funnel, 8000, np.random.default_rng(0))
        widths = funnel.half_widths()
        print(
            row.format(
                remainder,
                f"{widths[1]:.4f}",
                f"{np.degrees(widths[2]):.2f}",
                f"{widths[4]:.3f}",
                f"{funnel.seconds:.1f}",
                f"{checked:.1f} s",
                f"{proven:.0f} s, until {proof.until if proof else 0.0:.4f} s",
                f"{'holds' if verdict.holds else 'FAILS'}, "
                f"{np.sum(levels > ESCAPE_LEVEL)} of {len(levels)} escape",
            )
        )


if __name__ == "__main__":
    main()
