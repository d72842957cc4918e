"""How small an effect do flights show, and does the tracer find it? Prints tables.

    python -m tests.benchmarks.bench_power [--counts 6,12,40] [--seeds 2] [--times 2]
        [--kinds mass,camber] [--lines FILE.jsonl] [--limits-only]

The first table has, for every size of the library's effects, the smallest that so many
flights show to an oracle (`glider.design.power`), from 40 flights of `tests.helpers.
hidden` without an effect: moving air of 0.1 m/s, trims that differ by 0.01 rad. The
second plants effects of twice that size in the same gliders and counts how often the
tracer lists them, lists one that it says they cannot be told from, and trusts what it
lists. A line a campaign is kept in FILE, and what is there is not run again.
"""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from glider.design.power import Limit, limits_of
from glider.errors import InputError
from glider.studies.known_truth import begin, task_of
from glider.sysid.likelihood.model_fit import fit_model
from glider.sysid.pipeline import close_the_loop
from tests.helpers.hidden import ONE_SIGN, SIZES, Thrower, campaign

LIKE = 40
"""Flights that the limits are taken from."""


def find_limits() -> list[Limit]:
    """Returns the oracle's limits."""
    flights = Thrower(None, 0).random(LIKE, 0)
    task, noise = task_of(campaign(flights))
    return limits_of(task, fit_model(task, begin(task, noise)))


def limit_table(limits: Sequence[Limit], counts: Sequence[int]) -> str:
    """Returns the limits as a table in Markdown."""
    rows = [
        "| effect | coefficient | " + " | ".join(f"{n} flights" for n in counts) + " |",
        "|---|---|" + "---|" * len(counts),
    ]
    for limit in limits:
        unit = "" if limit.unit == "-" else f" {limit.unit}"
        sizes = " | ".join(f"{limit.smallest(n):.2g}{unit}" for n in counts)
        rows.append(f"| `{limit.kind}` | {limit.name} | {sizes} |")
    return "\n".join(rows)


def run(kind: str, size: float, count: int, seed: int) -> dict[str, Any]:
    """Traces a campaign with an effect of a size."""
    sign = 1.0 if kind in ONE_SIGN or seed % 2 == 0 else -1.0
    thrower = Thrower(kind, 1000 * count + seed, sign * size)
    line: dict[str, Any] = {"kind": kind, "flights": count, "seed": seed}
    try:
        result = close_the_loop(campaign(thrower.random(count, 0)))
    except InputError as error:
        return line | {"verdict": str(error), "found": [], "one_of": []}
    return line | {
        "verdict": result.verdict,
        "found": [e.kind for e in result.effects],
        "one_of": [k for e in result.effects for k in e.indistinguishable_from],
    }


def power_table(lines: Sequence[dict[str, Any]], counts: Sequence[int]) -> str:
    """Returns how often planted effects were found, in Markdown."""
    rows = [
        "| flights | campaigns | listed | listed or one of | trusted |",
        "|---|---|---|---|---|",
    ]
    for count in counts:
        own = [x for x in lines if x["flights"] == count]
        named = [x for x in own if x["kind"] in x["found"]]
        either = [x for x in own if x["kind"] in (*x["found"], *x["one_of"])]
        trusted = [x for x in either if x["verdict"] != "not_trusted"]
        rows.append(
            f"| {count} | {len(own)} | {len(named)} | {len(either)} | {len(trusted)} |"
        )
    return "\n".join(rows)


def main() -> None:
    """Prints the limits, and runs what is not done."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--counts", default="6,12,40", help="of flights")
    parser.add_argument("--seeds", type=int, default=2, help="campaigns of each kind")
    words = "size over the oracle's limit"
    parser.add_argument("--times", type=float, default=2.0, help=words)
    parser.add_argument("--kinds", default=",".join(SIZES), help="that are planted")
    parser.add_argument("--lines", type=Path, help="file of what is done")
    parser.add_argument("--limits-only", action="store_true", help="trace nothing")
    args = parser.parse_args()
    counts = [int(n) for n in args.counts.split(",")]
    limits = find_limits()
    print(limit_table(limits, counts))
    if args.limits_only:
        return
    sizes = {x.kind: x for x in reversed(limits)}  # The first coefficient's.
    lines = []
    if args.lines and args.lines.exists():
        lines = [json.loads(x) for x in args.lines.read_text().splitlines()]
    lines = [x for x in lines if x["times"] == args.times]
    done = {(x["kind"], x["flights"], x["seed"]) for x in lines}
    for count in counts:
        for seed in range(args.seeds):
            for kind in args.kinds.split(","):
                if (kind, count, seed) in done:
                    continue
                size = args.times * sizes[kind].smallest(count)
                lines.append(run(kind, size, count, seed) | {"times": args.times})
                print(json.dumps(lines[-1]), flush=True)
                if args.lines:
                    with args.lines.open("a") as file:
                        file.write(json.dumps(lines[-1]) + "\n")
    print(power_table(lines, counts))


if __name__ == "__main__":
    main()
