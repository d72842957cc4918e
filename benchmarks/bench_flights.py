"""How do time and memory grow with the flights? Prints a table; asserts nothing.

    python -m benchmarks.bench_flights [--flights 20 40 100] [--effects 1 5]
        [--seed 7] [--jobs 0]

Each campaign is traced in a process of its own, once the loops are compiled. Beside the
wall clock stands the processor's time, which neighbours on the machine lengthen less;
per flight neither should grow. `--jobs N` takes the flights to N processes of joblib.
"""

import argparse
import multiprocessing
import resource
import time

import joblib

from glider.campaign.logs import Campaign
from glider.compiled.warm_up import warm_up
from glider.sysid.pipeline import close_the_loop
from glider.sysid.replay.log_space import LIBRARY_SPACE
from tests.helpers.lifelike import draw_campaign


def trace(campaign: Campaign, jobs: int) -> str:
    """Traces a campaign and returns what it took."""
    warm_up(LIBRARY_SPACE)
    wall, processor = time.perf_counter(), time.process_time()
    if jobs:
        with joblib.parallel_config(backend="loky", n_jobs=jobs):
            result = close_the_loop(campaign)
    else:
        result = close_the_loop(campaign)
    wall, processor = time.perf_counter() - wall, time.process_time() - processor
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0  # [MB]
    count = len(campaign.flights)
    slowest = sorted(result.seconds.items(), key=lambda item: -item[1])[:3]
    return (
        f"{wall:7.1f} {processor:7.1f} {1e3 * processor / count:10.0f} {peak:8.0f}  "
        f"{result.verdict}: {'+'.join(e.kind for e in result.effects)}; "
        + ", ".join(f"{name} {seconds:.1f}" for name, seconds in slowest)
    )


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--flights", type=int, nargs="+", default=[20, 40, 100])
    parser.add_argument("--effects", type=int, nargs="+", default=[1, 5])
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--jobs", type=int, default=0)
    args = parser.parse_args()
    print("flights effects  wall s   CPU s  CPU ms/flight  peak MB  answer; stages [s]")
    for effects in args.effects:
        for flights in args.flights:
            campaign, _ = draw_campaign(args.seed, flights=flights, effects=effects)
            with multiprocessing.get_context("spawn").Pool(1) as alone:
                line = alone.apply(trace, (campaign, args.jobs))
            print(f"{flights:7d} {effects:7d} {line}", flush=True)


if __name__ == "__main__":
    main()
