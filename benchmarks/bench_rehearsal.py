"""Does a rehearsal predict the power of the tracer? Prints a table.

    python -m benchmarks.bench_rehearsal [--campaigns 6] [--effects 8] [--seed 0]
        [--lines FILE.jsonl]

Campaigns of different numbers of flights, launches, noise and moving air are rehearsed.
In each, effects are planted with a size at which the predicted power is neither none
nor all, flown and traced. The sum of the predicted powers is compared with the number
that the tracer named, over all campaigns and by the predicted power.
"""

import argparse
import dataclasses
import json
from pathlib import Path

import numpy as np

from glider.campaign.motion_capture import MotionCapture
from glider.experiments.explanations import explain, findings_of
from glider.experiments.proposal import read_task
from glider.experiments.rehearsal import Rehearser
from glider.physics.model import GliderModel
from glider.simulation.campaigns import CampaignPlan
from glider.sysid.pipeline import close_the_loop

BETWEEN = (0.4, 1.4)
"""Sizes that are planted, over the smallest that is visible."""


def rehearser_of(rng: np.random.Generator, seed: int) -> Rehearser:
    """Draws a campaign without an effect, traces it and makes it ready to be drawn."""
    noise = rng.uniform(0.3, 3.0)
    usual = MotionCapture()
    capture = dataclasses.replace(
        usual,
        position=noise * usual.position,
        pitch=noise * usual.pitch,
        elevator=noise * usual.elevator,
    )
    plan = CampaignPlan(
        flights=int(rng.integers(8, 31)),
        duration=float(rng.uniform(0.6, 1.0)),
        capture=capture,
    )
    campaign = plan.simulate(GliderModel(), rng, f"drawn_{seed}")
    findings = findings_of(close_the_loop(campaign))
    reading = read_task(campaign, findings)
    model = explain(reading.task, reading.noise, findings)[0].model
    return Rehearser(reading, model, seed)


def lines_of(number: int, effects: int, seed: int):
    """Yields what is predicted of effects in one campaign, and what was named."""
    rng = np.random.default_rng([seed, number])
    rehearser = rehearser_of(rng, number)
    for kind in rng.permutation(rehearser.chosen(None))[:effects]:
        usual = rehearser.rehearsed(kind, 1.0)
        size = usual.visible * rng.uniform(*BETWEEN)
        planted = rehearser.rehearsed(kind, size / usual.coefficient.scale)
        found = rehearser.traced(planted, int(rng.integers(1 << 30)))
        named = [own.kind for own in found.effects]
        alike = [name for own in found.effects for name in own.indistinguishable_from]
        yield {
            "campaign": number,
            "flights": len(rehearser.reading.task.records),
            "known": rehearser.model.kinds,
            "effect": str(kind),
            "size": size,
            "visible": usual.visible,
            "power": planted.power,
            "instead": planted.instead,
            "verdict": found.verdict,
            "named": named,
            "alike": alike,
        }


def is_named(line: dict) -> bool:
    """Whether the tracer named the effect, or one that is indistinguishable."""
    return line["effect"] in (*line["named"], *line["alike"])


def table(lines: list[dict]) -> str:
    """Returns the predicted and the measured power, by the predicted one."""
    rows = [
        "| predicted power | campaigns | predicted | named | named and trusted |",
        "|---|---|---|---|---|",
    ]
    for low, high in ((0.0, 0.33), (0.33, 0.67), (0.67, 0.95), (0.95, 1.01), (0, 1.01)):
        own = [x for x in lines if low <= x["power"] < high]
        if own:
            predicted = np.mean([x["power"] for x in own])
            named = np.mean([is_named(x) for x in own])
            trusted = sum(x["verdict"] != "not_trusted" for x in own if is_named(x))
            rows.append(
                f"| {low:.0%} to {min(high, 1.0):.0%} | {len(own)} | {predicted:.0%} | "
                f"{named:.0%} | {trusted / len(own):.0%} |"
            )
    return "\n".join(rows)


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--campaigns", type=int, default=6, help="that are drawn")
    parser.add_argument("--effects", type=int, default=8, help="planted in each")
    parser.add_argument("--seed", type=int, default=0, help="of what is drawn")
    parser.add_argument("--lines", type=Path, help="file of what is done")
    args = parser.parse_args()
    lines = []
    for number in range(args.campaigns):
        for line in lines_of(number, args.effects, args.seed):
            lines.append(line)
            print(json.dumps(line), flush=True)
            if args.lines:
                with args.lines.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(line) + "\n")
    print(table(lines))


if __name__ == "__main__":
    main()
