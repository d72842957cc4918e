"""How long funnels take, and how wide they are.

python -m tests.benchmarks.bench_funnel
"""

import time

import numpy as np

from glider.model_file import GliderModel
from glider.planning.dircol import plan
from glider.planning.problem import PerchingProblem
from glider.plant import GliderPlant
from glider.riccati import compiled_policy
from glider.verification.attack import attack_funnel
from glider.verification.build import make_funnel
from glider.verification.check import check_funnel
from glider.verification.settings import FunnelSettings


def main():
    """Prints a row for each inflation of the sampled remainder."""
    policy = compiled_policy(GliderPlant(), plan(GliderPlant(), PerchingProblem()))
    row = "{:>9} {:>8} {:>8} {:>9} {:>10} {:>10} {:>12}"
    print(
        row.format("remainder", "z [m]", "pitch °", "ẋ [m/s]", "made [s]", "check", "")
    )
    for remainder in (0.0, 1.0, 2.0):
        settings = FunnelSettings(remainder=remainder)
        funnel = make_funnel(GliderModel(), policy, settings)
        began = time.perf_counter()
        verdict = check_funnel(funnel)
        checked = time.perf_counter() - began
        attack = attack_funnel(funnel, 8000, np.random.default_rng(0))
        widths = funnel.half_widths()
        print(
            row.format(
                remainder,
                f"{widths[1]:.4f}",
                f"{np.degrees(widths[2]):.2f}",
                f"{widths[4]:.3f}",
                f"{funnel.seconds:.1f}",
                f"{checked:.1f} s",
                f"{'holds' if verdict.holds else 'FAILS'}, "
                f"{attack.escapes} of {attack.samples} escape",
            )
        )


if __name__ == "__main__":
    main()
