"""Flights whose commands act later than their predictor assumes. Prints a table.

    python -m benchmarks.bench_late_commands [FUNNEL] [--flights 2000]

The proof of a latency is for one that is always the same. Here the clock of a funnel of
held commands samples the state, and the predictor flies it on, as the proof has it, for
10 ms; but each command acts later, until the next one does: all but the first, which
acts from the launch on, or the first too, before which nothing moves the elevator.
Flights start on the inlet's boundary, in the funnel's wind, with gliders on
the edge of its set, and climb (`glider.verification.trials`).
"""

import argparse
import dataclasses

import numpy as np
from threadpoolctl import threadpool_limits

from glider import funnels
from glider.control.predictor import Hold, held_command
from glider.paths import models_path
from glider.verification import trials

LATENCY = 0.01
"""That the predictor assumes [s]."""

DELAYS = (0.0, 0.001, 0.002, 0.004, 0.008)
"""By how much later each command acts [s]."""


def predict(model, policy, times, states, waiting, hold):
    """Returns the command that would be right without a delay."""
    hold = dataclasses.replace(hold, latency=LATENCY)
    return held_command(model, policy, times, states, waiting, hold)


def sample_times(funnel, hold, genes):
    """Returns when the clock samples first: as if there were no delay."""
    return np.full(len(genes), funnel.settings.period - LATENCY)


class Late(trials._HeldFlight):
    """Flights whose first command is late, too."""

    def levels(self):
        """Flies to the end; the first stretch begins without a command."""
        self.is_first = True
        return super().levels()

    def fly(self, command, duration, begins=False):
        """Flies on; after the launch the command waits."""
        late = self._loop.hold.latency - LATENCY
        if self.is_first and late > 0.0:
            super().fly(0.0 * command, late, begins=True)
            duration = duration - late
        self.is_first = False
        super().fly(command, duration, begins)


def main():
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    funnel = models_path("funnels", "held_head_wind_95_hook.npz")
    parser.add_argument("funnel", nargs="?", default=funnel, help="file of a funnel")
    parser.add_argument("--flights", type=int, default=2000, help="random ones a row")
    args = parser.parse_args()
    given = funnels.load_funnel(args.funnel)
    trials.held_command, trials._phases = predict, sample_times
    print("| late | by | random flights that leave | all that leave | most V | V(T) |")
    print("|---|---|---|---|---|---|")
    rows = [("all but the first", trials._HeldFlight, delay) for delay in DELAYS]
    rows += [("all", Late, delay) for delay in DELAYS[1:4]]
    for name, flight, delay in rows:
        trials._HeldFlight = flight
        loop = trials.FlownLoop(
            hold=Hold(
                period=given.settings.period, latency=LATENCY + delay, predicts=True
            ),
            wind=given.settings.wind,
            gliders=given.allowed if given.is_of_set else None,
        )
        rng = np.random.default_rng(0)
        found = trials.falsify_funnel(given, args.flights, rng, loop)
        left = int(np.sum(~(found.levels[~found.climbed] <= trials.ESCAPE_LEVEL)))
        print(
            f"| {name} | {1e3 * delay:g} ms | {left:,} of {args.flights:,} | "
            f"{found.escapes:,} of {len(found.levels):,} | "
            f"{found.levels.max():.2f} | {found.ends.max():.2f} |",
            flush=True,
        )


if __name__ == "__main__":
    with threadpool_limits(limits=1, user_api="blas"):  # Small matrices.
        main()
