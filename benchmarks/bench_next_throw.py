"""Do designed throws tell rivals apart sooner? Prints a table; asserts nothing.

    python -m benchmarks.bench_next_throw [--truths 20] [--first 0]
        [--most 12] [--jobs 1] [--lines FILE.jsonl]

Each hidden truth is a glider of `benchmarks.hidden`, with one small effect that has
close rivals; the air moves, and each flight has its trim. Two flights of the kind that
campaigns are made of are given. Then one throw at a time is flown until the right one
of the rivals has probability 0.95: designed; random, of that kind again; or the plain
perch of the glider nominal. Launches miss what was asked for as `ThrowLimits` says,
and a designed throw keeps to launches as the random ones have them. Only the rivals are
weighed: an oracle's, who knows which effects it may be.

A line a truth is kept in FILE as it is done, and a truth that is there is not run
again: a run goes on where it was stopped. The table has the flights that were needed,
`>` where so many were not enough, and how often what was promised of a designed throw
came true.
"""

import argparse
import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import joblib
import numpy as np

from benchmarks.hidden import RIVALS, Thrower, perch_throw, probability, weigh
from glider.experiments.proposal import propose
from glider.experiments.throw_limits import ThrowLimits
from glider.physics.model import GliderModel

ENOUGH = 0.95
"""Probability of the right explanation that ends a campaign."""

GIVEN = 2
"""Flights at the start."""

WAYS = ("designed", "random", "perch")

LIMITS = ThrowLimits(
    launch_height=[-0.05, 0.35],
    launch_speed=[6.4, 7.6],
    launch_climb=[-0.06, 0.06],
    launch_pitch=[-0.15, 0.07],
    x=[-4.0, 4.0],
    z=[-1.6, 1.2],
    pitch=[-1.2, 1.2],
    speed=9.5,
)
"""Launches within twice the spread of the random ones."""


def run(truth: int, most: int) -> dict[str, Any]:
    """Finds one hidden truth in each way."""
    names = list(RIVALS)
    name = names[truth % len(names)]
    rivals = RIVALS[name]
    kind = rivals[truth // len(names) % len(rivals)]
    promises: list[tuple[float, bool]] = []
    seconds: list[float] = []
    line: dict[str, Any] = {"truth": truth, "most": most, "rivals": name, "kind": kind}
    for way in WAYS:
        thrower = Thrower(kind, truth)
        flights = thrower.random(GIVEN, 0)
        line[way] = None
        promised = None
        for count in range(most + 1):
            known, task, noise, explanations = weigh(flights, rivals)
            if promised is not None:
                promises.append((promised, explanations[0].model.kinds == (kind,)))
                promised = None
            if probability(explanations, kind) >= ENOUGH:
                line[way] = count
                break
            if way == "random":
                flights += thrower.random(1, len(flights))
            elif way == "perch":
                flights += thrower.throw(perch_throw(), len(flights))
            elif len(explanations) > 1:
                proposal = propose(
                    known,
                    task,
                    noise,
                    explanations,
                    traced=GliderModel(),
                    launches=1,
                    limits=dataclasses.replace(LIMITS),
                    seed=truth + 1000 * count,
                )
                seconds.append(proposal.seconds)
                promised = proposal.chance_then
                flights += thrower.throw(proposal.throws[0], len(flights))
            else:  # Wrong, and sure of it.
                flights += thrower.random(1, len(flights))
    return line | {"promises": promises, "seconds": seconds}


def table(lines: Sequence[dict[str, Any]]) -> str:
    """Returns the README's table."""
    rows = [
        "| close rivals | truths | designed | random | perch |",
        "|---|---|---|---|---|",
    ]
    groups = {name: [x for x in lines if x["rivals"] == name] for name in RIVALS}
    for name, own in (*groups.items(), ("all", list(lines))):
        if own:
            words = ", ".join(RIVALS[name]) if name in RIVALS else "all, median"
            taken = " | ".join(_median(own, way) for way in WAYS)
            rows.append(f"| {words} | {len(own)} | {taken} |")
    return "\n".join(rows)


def _median(lines: Sequence[dict[str, Any]], way: str) -> str:
    counts = sorted(np.inf if x[way] is None else x[way] for x in lines)
    middle = 0.5 * (counts[(len(counts) - 1) // 2] + counts[len(counts) // 2])
    return f"{middle:g}" if np.isfinite(middle) else f">{lines[0]['most']}"


def calibration(lines: Sequence[dict[str, Any]]) -> str:
    """Returns how often promises came true, by what was promised."""
    promises = np.array([p for x in lines for p in x["promises"]]).reshape(-1, 2)
    rows = ["| promised | proposals | mean promise | came true |", "|---|---|---|---|"]
    for low, high in ((0.0, 0.7), (0.7, 0.85), (0.85, 0.95), (0.95, 1.01)):
        own = promises[(promises[:, 0] >= low) & (promises[:, 0] < high)]
        if len(own):
            said, true = own.mean(axis=0)
            span = f"{low:g} to {min(high, 1.0):g}"
            rows.append(f"| {span} | {len(own)} | {said:.2f} | {true:.2f} |")
    return "\n".join(rows)


def main() -> None:
    """Runs the truths that are not done, and prints what all lines say."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--truths", type=int, default=20, help="how many")
    parser.add_argument("--first", type=int, default=0, help="number of the first")
    parser.add_argument("--most", type=int, default=12, help="flights at most")
    parser.add_argument("--jobs", type=int, default=1, help="truths at a time")
    parser.add_argument("--lines", type=Path, help="file of what is done")
    args = parser.parse_args()
    lines = []
    if args.lines and args.lines.exists():
        lines = [json.loads(x) for x in args.lines.read_text().splitlines()]
    done = {x["truth"] for x in lines}
    tasks = [
        joblib.delayed(run)(truth, args.most)
        for truth in range(args.first, args.first + args.truths)
        if truth not in done
    ]
    for line in joblib.Parallel(n_jobs=args.jobs, return_as="generator")(tasks):
        lines.append(line)
        text = json.dumps(line)
        print(text, flush=True)
        if args.lines:
            with args.lines.open("a") as file:
                file.write(f"{text}\n")
    print(table(lines))
    print()
    print(calibration(lines))


if __name__ == "__main__":
    main()
