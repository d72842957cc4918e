"""Times our solvers beside those of other libraries, in one run.

Prints the tables of docs/benchmarks.md: processor times on one core, and their ratio,
taken in turn; of `aeroid`, a table of its own, what is found of simulated campaigns
(some 10 minutes). A library that is not installed is left out and said so; `pip install
'.[bench]'` brings all.

    python -m benchmarks.bench_peers [NAME ...]
"""

import importlib
import sys

from threadpoolctl import threadpool_limits

from benchmarks.peers.pairs import time_pair

PEERS = {
    "drake": "drake_planning",
    "pytorch-mppi": "torch_mppi",
    "filterpy": "filterpy_ekf",
    "pysindy": "sindy_regression",
    "aeroid": "aeroid_identification",
}
"""Peers, by the names that they install under, and the modules that compare."""

TABLES = ("aeroid",)
"""Those whose modules have `rows` of a table of their own in place of `pairs`."""


def main(names: list[str]) -> None:
    """Prints the table of the peers that are named, or of all."""
    unknown = [name for name in names if name not in PEERS]
    if unknown:
        sys.exit(f"{unknown[0]} is no peer; there are {', '.join(PEERS)}.")
    missing = []
    timed = [name for name in names or PEERS if name not in TABLES]
    if timed:
        print("| task | beside | ours | theirs | ratio | what both find |")
        print("|---|---|---|---|---|---|")
    for name in (*timed, *(own for own in names or PEERS if own in TABLES)):
        module = importlib.import_module(f"benchmarks.peers.{PEERS[name]}")
        try:
            found = module.rows() if name in TABLES else module.pairs()
        except ModuleNotFoundError as error:
            missing.append(f"{name} is left out: {error.name} is not installed.")
            continue
        if name in TABLES:
            print("\n" * bool(timed) + "\n".join(found))
            continue
        for pair in found:
            with threadpool_limits(1):
                timing = time_pair(pair)
            print(
                f"| {pair.task} | {pair.peer} | {_duration(timing.ours)} | "
                f"{_duration(timing.theirs)} | {timing.ratio:.2g} | {pair.told()} |",
                flush=True,
            )
    for sentence in missing:
        print(sentence)


def _duration(seconds: float) -> str:
    if seconds >= 1.0:
        return f"{seconds:.3g} s"
    return f"{1e3 * seconds:.3g} ms" if seconds >= 1e-3 else f"{1e6 * seconds:.3g} µs"


if __name__ == "__main__":
    main(sys.argv[1:])
