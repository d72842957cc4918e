"""How small an effect do flights show, and does the tracer find it? Prints tables.

    python -m tests.benchmarks.bench_power [--counts 6,12,40] [--seeds 2] [--times 2]
        [--kinds mass,camber] [--jobs 1] [--lines FILE.jsonl] [--limits-only]

The first table has, for every size of the library's effects, the smallest that so many
flights show to an oracle, and the smallest that it tells from its rivals
(`glider.design.power`), from 40 flights of `tests.helpers.hidden` without an effect:
moving air of 0.1 m/s, trims that differ by 0.01 rad.

The second plants effects of some times the size that the oracle needs with the very
same launches, commands and air, and counts how often the tracer finds them: by name,
where the oracle names an effect at no more than NAMED times the size that shows it;
else listed, or said to be as good as what is listed. A line a campaign is kept in FILE,
and what is there is not run again.
"""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import joblib
import numpy as np

from glider.design.power import Limit, limits_of
from glider.errors import InputError
from glider.studies.known_truth import begin, task_of
from glider.sysid.likelihood.model_fit import fit_model
from glider.sysid.pipeline import close_the_loop
from tests.helpers.hidden import Thrower, campaign
from tests.helpers.one_effect import ONE_SIGN, PLANTED

NAMED = 3.5
"""Times the size that shows an effect, from which on a name of its own is not asked:
its rivals are then another 3 to 20 times as hard to tell apart."""


def find_limits(
    count: int, seed: int, kinds: Sequence[str] | None = None
) -> list[Limit]:
    """Returns the oracle's limits in flights without an effect."""
    task, noise = task_of(campaign(Thrower(None, seed).random(count, 0)))
    return limits_of(task, fit_model(task, begin(task, noise)), kinds)


def limit_table(limits: dict[int, Sequence[Limit]]) -> str:
    """Returns the limits in so many flights as a table in Markdown."""
    rows = [
        "| effect | coefficient | "
        + " | ".join(f"{n} flights" for n in limits)
        + " | named from | beside |",
        "|---|---|" + "---|" * (len(limits) + 2),
    ]
    for own in zip(*limits.values(), strict=True):
        limit = own[-1]
        unit = "" if limit.unit == "-" else f" {limit.unit}"
        sizes = " | ".join(f"{x.shown:.2g}{unit}" for x in own)
        times = limit.named / limit.shown
        named = f"{times:.1f} times" if np.isfinite(times) else "-"
        rows.append(
            f"| `{limit.kind}` | {limit.name} | {sizes} | {named} | `{limit.rival}` |"
        )
    return "\n".join(rows)


def is_by_name(limit: Limit) -> bool:
    """Returns whether an effect is asked for by its own name."""
    return limit.named <= NAMED * limit.shown


def run(kind: str, times: float, count: int, seed: int) -> dict[str, Any]:
    """Traces a campaign with an effect of a size."""
    drawn = 1000 * count + seed
    limit = find_limits(count, drawn, [kind])[0]
    size = limit.named if is_by_name(limit) else limit.shown
    sign = 1.0 if kind in ONE_SIGN or seed % 2 == 0 else -1.0
    planted = sign * times * size
    thrower = Thrower(kind, drawn, planted, limit.shapes)
    line: dict[str, Any] = {
        "kind": kind,
        "flights": count,
        "seed": seed,
        "times": times,
        "by_name": is_by_name(limit),
        "planted": planted,
    }
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
        own = [x for x in lines if x["flights"] == count]
        found = [x for x in own if is_found(x)]
        either = [x for x in own if x["kind"] in (*x["found"], *x["one_of"])]
        trusted = [x for x in found if x["verdict"] != "not_trusted"]
        rows.append(
            f"| {count} | {len(own)} | {len(found)} | {len(either)} | {len(trusted)} |"
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
    parser.add_argument("--kinds", default=",".join(PLANTED), help="that are planted")
    parser.add_argument("--jobs", type=int, default=1, help="campaigns at a time")
    parser.add_argument("--lines", type=Path, help="file of what is done")
    parser.add_argument("--limits-only", action="store_true", help="trace nothing")
    args = parser.parse_args()
    counts = [int(n) for n in args.counts.split(",")]
    print(limit_table({count: find_limits(count, 0) for count in counts}))
    if args.limits_only:
        return
    lines = []
    if args.lines and args.lines.exists():
        lines = [json.loads(x) for x in args.lines.read_text().splitlines()]
    lines = [x for x in lines if x["times"] == args.times]
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
