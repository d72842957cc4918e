"""How small an effect do flights show, and does the tracer find it? Prints tables.

    python -m benchmarks.bench_power [--counts 6,12,40] [--seeds 2] [--times 2]
        [--kinds mass,camber,none] [--jobs 1] [--lines FILE.jsonl]
        [--limits-only | --power-only]

The first table has, for every size of the library's effects, the smallest that so many
flights show to an oracle, and the smallest that it distinguishes from its rivals
(`benchmarks.power`), the median of DRAWS campaigns of `benchmarks.hidden`
without an effect: moving air of 0.1 m/s, trims that differ by 0.01 rad.

The second plants effects of some times the size that the oracle needs with the very
same launches, commands and air, and counts how often the tracer finds them: by name,
where the oracle names an effect at no more than NAMED times the size that shows it;
else listed, or said to be as good as what is listed. Of the kind `none` nothing is
planted, and nothing is to be listed. A line a campaign is kept in FILE, and what is
there is not run again.
"""

import argparse
import dataclasses
import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import joblib
import numpy as np

from benchmarks.hidden import Thrower, campaign
from benchmarks.one_effect import ONE_SIGN, PLANTED
from benchmarks.power import Limit, limits_of
from glider.errors import InputError
from glider.sysid.likelihood.model_fit import fit_model
from glider.sysid.pipeline import close_the_loop
from tests.helpers.known_truth import begin, task_of

DRAWS = 5
"""Campaigns of which a limit is the median: each has its own flights."""

NAMED = 3.5
"""Times the size that shows an effect, above which no name of its own is asked:
its rivals are then another 3 to 20 times as hard to tell apart."""


def find_limits(
    count: int, seed: int, kinds: Sequence[str] | None = None
) -> list[Limit]:
    """Returns the oracle's limits in flights without an effect."""
    task, noise = task_of(campaign(Thrower(None, seed).random(count, 0)))
    return limits_of(task, fit_model(task, begin(task, noise)), kinds)


def median_limits(count: int, jobs: int) -> dict[tuple[str, str], Limit]:
    """Returns the median limits of some campaigns, by kind and coefficient."""
    draws = (joblib.delayed(find_limits)(count, seed) for seed in range(DRAWS))
    told: dict[tuple[str, str], list[Limit]] = {}
    for limits in joblib.Parallel(n_jobs=jobs)(draws):
        for limit in limits:
            told.setdefault((limit.kind, limit.name), []).append(limit)
    return {
        key: dataclasses.replace(
            own[0],
            shown=float(np.median([x.shown for x in own])),
            named=float(np.median([x.named for x in own])),
            rival=Counter(x.rival for x in own).most_common(1)[0][0],
        )
        for key, own in told.items()
    }


def limit_table(limits: dict[int, dict[tuple[str, str], Limit]]) -> str:
    """Returns the limits in so many flights as a table in Markdown."""
    rows = [
        "| effect | coefficient | "
        + " | ".join(f"{n} flights" for n in limits)
        + " | named from | beside |",
        "|---|---|" + "---|" * (len(limits) + 2),
    ]
    for (kind, name), last in limits[max(limits)].items():
        unit = "" if last.unit == "-" else f" {last.unit}"
        own = [x.get((kind, name)) for x in limits.values()]
        sizes = " | ".join("-" if x is None else f"{x.shown:.2g}{unit}" for x in own)
        times = last.named / last.shown
        named = f"{times:.1f} times" if np.isfinite(times) else "-"
        rows.append(f"| `{kind}` | {name} | {sizes} | {named} | `{last.rival}` |")
    return "\n".join(rows)


def is_by_name(limit: Limit) -> bool:
    """Returns whether an effect is asked for by its own name."""
    return limit.named <= NAMED * limit.shown


def run(kind: str, times: float, count: int, seed: int) -> dict[str, Any]:
    """Traces a campaign with an effect of a size."""
    drawn = 1000 * count + seed
    line: dict[str, Any] = {"kind": kind, "flights": count, "seed": seed}
    if kind == NOTHING:
        thrower = Thrower(None, drawn)
    else:
        limit = find_limits(count, drawn, [kind])[0]
        size = limit.named if is_by_name(limit) else limit.shown
        sign = 1.0 if kind in ONE_SIGN or seed % 2 == 0 else -1.0
        planted = sign * times * size
        thrower = Thrower(kind, drawn, planted, limit.shapes)
        line |= {"times": times, "by_name": is_by_name(limit), "planted": planted}
    try:
        result = close_the_loop(campaign(thrower.random(count, 0)))
    except InputError as error:
        return line | {"verdict": str(error), "found": [], "one_of": []}
    return line | {
        "verdict": result.verdict,
        "reason": result.reason,
        "found": [e.kind for e in result.effects],
        "one_of": [k for e in result.effects for k in e.indistinguishable_from],
    }


NOTHING = "none"
"""Kind of campaigns without an effect."""


def is_found(line: dict[str, Any]) -> bool:
    """Returns whether an effect was found as it was asked for."""
    if line["by_name"]:
        return line["kind"] in line["found"]
    return line["kind"] in (*line["found"], *line["one_of"])


def power_table(lines: Sequence[dict[str, Any]], counts: Sequence[int]) -> str:
    """Returns how often planted effects were found, in Markdown."""
    rows = [
        "| flights | campaigns | found | found or one of | found, and trusted |",
        "|---|---|---|---|---|",
    ]
    for count in counts:
        own = [x for x in lines if x["flights"] == count and x["kind"] != NOTHING]
        found = [x for x in own if is_found(x)]
        either = [x for x in own if x["kind"] in (*x["found"], *x["one_of"])]
        trusted = [x for x in found if x["verdict"] != "not_trusted"]
        rows.append(
            f"| {count} | {len(own)} | {len(found)} | {len(either)} | {len(trusted)} |"
        )
    bare = [x for x in lines if x["flights"] in counts and x["kind"] == NOTHING]
    if bare:
        alarms = sum(bool(x["found"]) for x in bare)
        rows.append(f"Without an effect: {len(bare)} campaigns, {alarms} with one.")
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
    parser.add_argument("--kinds", default=",".join(PLANTED), help="that are planted")
    parser.add_argument("--jobs", type=int, default=1, help="campaigns at a time")
    parser.add_argument("--lines", type=Path, help="file of what is done")
    only = parser.add_mutually_exclusive_group()
    only.add_argument("--limits-only", action="store_true", help="trace nothing")
    only.add_argument("--power-only", action="store_true", help="no table of limits")
    args = parser.parse_args()
    counts = [int(n) for n in args.counts.split(",")]
    if not args.power_only:
        print(limit_table({n: median_limits(n, args.jobs) for n in counts}))
    if args.limits_only:
        return
    lines = []
    if args.lines and args.lines.exists():
        lines = [json.loads(x) for x in args.lines.read_text().splitlines()]
    lines = [x for x in lines if x.get("times", args.times) == args.times]
    done = {(x["kind"], x["flights"], x["seed"]) for x in lines}
    tasks = [
        joblib.delayed(run)(kind, args.times, count, seed)
        for count in counts
        for seed in range(args.seeds)
        for kind in args.kinds.split(",")
        if (kind, count, seed) not in done
    ]
    for line in joblib.Parallel(n_jobs=args.jobs, return_as="generator")(tasks):
        lines.append(line)
        print(json.dumps(line), flush=True)
        if args.lines:
            with args.lines.open("a") as file:
                file.write(json.dumps(line) + "\n")
    print(power_table(lines, counts))


if __name__ == "__main__":
    main()
