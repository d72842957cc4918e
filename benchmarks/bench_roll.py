"""What is said of gliders that roll, where roll and yaw are not logged? Prints a table.

    python -m benchmarks.bench_roll [--banks 0,0.05,0.1,0.2,0.4] [--seeds 2] [--first 0]
        [--kinds none,profile_drag] [--logged] [--shares] [--jobs 1]

They fly in the independent simulator of `benchmarks.rolling_flight`, each flight with a
bank of its own that grows evenly, to either side, to about `banks` at its end. Odd
seeds fly in moving air. The glider has no effect, or one that is planted.

With --shares the table compares what the effects gain that a search without roll finds,
and what banks gain in their place: the search prefers banks from a share of 0.8 on.
"""

import argparse
import dataclasses
import re
import time

import joblib
import numpy as np

from benchmarks.hidden import ROWS, TRIM, campaign
from benchmarks.one_effect import plant
from benchmarks.rolling_flight import Rolls, fly_rolling
from glider.campaign.logs import Campaign
from glider.progress import silent
from glider.sysid.pipeline import close_the_loop
from glider.sysid.roll import RollSearch
from glider.sysid.search.moves import Search
from glider.sysid.search.tracing import trace
from tests.helpers.known_truth import task_of
from tests.helpers.lifelike import (
    COMMAND_RATE,
    Capture,
    draw_commands,
    draw_starts,
    log_poses,
)
from tests.helpers.lifelike_flight import STEP, Glider, elevator_paths, gusts

SIZES = {
    "profile_drag": 0.06,
    "camber": 0.06,
    "attached_lift": 1.5,
    "elevator_area": -0.15,
    "downwash": 0.3,
}
"""Effects that take turns at being planted, and how large they are."""

SHAPES = {"stall_angle": 0.25, "fade": 0.05}
AIR = (0.05, 0.25)
"""Standard deviation [m/s] and correlation time [s] of the gusts of odd seeds."""


def draw(
    bank: float, seed: int, kind: str, logged: bool = False
) -> tuple[Campaign, Rolls]:
    """Draws a campaign of a glider with an effect, or with none, and how it rolls."""
    rng = np.random.default_rng([seed, 71])
    count = int(rng.integers(14, 25))
    glider = Glider()
    if kind != "none":
        plant(glider, kind, SIZES[kind], SHAPES)
    glider.elevator_trim = glider.elevator_trim + TRIM * rng.normal(size=count)
    last = bank * rng.choice([-1.0, 1.0], count) * rng.uniform(0.4, 1.4, count)
    rolls = Rolls(
        first=0.2 * bank * rng.normal(size=count),
        last=last,
        fin=float(rng.choice([0.0, 0.003, 0.012])),
    )
    every = round(1.0 / (Capture().rate * STEP))
    steps = every * (ROWS - 1)
    commands = draw_commands(rng, count)
    path = elevator_paths(
        glider.servo, commands, 1.0 / COMMAND_RATE, 2 * steps, glider.elevator_limits
    )
    air = gusts(rng, *AIR, path.shape) if seed % 2 else None
    pose, aside = fly_rolling(glider, rolls, draw_starts(rng, count), path, air)
    flights = log_poses(rng, pose[::every], path[:: 2 * every], Capture(), commands)
    if logged:
        flights = tuple(
            dataclasses.replace(flight, attitude=aside[::every, i])
            for i, flight in enumerate(flights)
        )
    return campaign(flights), rolls


def ask(bank: float, seed: int, kind: str, logged: bool) -> str:
    """Returns a row: the campaign, and what is said of it."""
    begin = time.perf_counter()
    drawn, _ = draw(bank, seed, kind, logged)
    found = close_the_loop(drawn, seed=seed)
    taken = time.perf_counter() - begin
    kinds = ", ".join(effect.kind for effect in found.effects) or "nothing"
    errors = [found.errors[name] for name in ("nominal", "corrected", "floor")]
    sizes = " / ".join(f"{1e3 * e.position_rms_m:.1f}" for e in errors if e is not None)
    words = re.search(r"about (.*) rad at the end", found.reason)
    hint = words[1] if words else "none"
    return (
        f"| {bank:.2f} | {seed} | {kind} | {found.verdict} | {kinds} | {hint} "
        f"| {sizes} | {taken:.0f} |"
    )


def compare(bank: float, seed: int, kind: str, logged: bool) -> str:
    """Returns a row: the gain of the effects that are found, and that of banks."""
    drawn, _ = draw(bank, seed, kind, logged)
    task, noise = task_of(drawn)
    search = Search(task, silent)
    traced = trace(search, noise)
    gained = search.penalized_cost(traced.bare) - search.penalized_cost(traced.model)
    rolls = RollSearch(search=search, campaign=drawn, noise=noise, masks={})
    _, gain = rolls.fit_beside(traced.bare, 0.0)
    kinds = ", ".join(traced.model.kinds) or "nothing"
    share = f"{gain / gained:.2f}" if gained > 0.0 else "-"
    row = f"| {bank:.2f} | {seed} | {kind} | {kinds} |"
    return f"{row} {gained:.0f} | {gain:.0f} | {share} |"


def main() -> None:
    """Prints the table, a row a campaign."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--banks", default="0,0.05,0.1,0.2,0.4", help="[rad]")
    parser.add_argument("--seeds", type=int, default=2, help="of each bank")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--kinds", default="none,one", help="none, one of them, or one")
    parser.add_argument("--logged", action="store_true", help="with roll and yaw")
    parser.add_argument("--shares", action="store_true", help="compare gains")
    parser.add_argument("--jobs", type=int, default=1, help="campaigns at a time")
    args = parser.parse_args()
    known = list(SIZES)
    tasks = [
        joblib.delayed(compare if args.shares else ask)(
            float(bank),
            seed,
            known[seed % len(known)] if kind == "one" else kind,
            args.logged,
        )
        for seed in range(args.first, args.first + args.seeds)
        for bank in args.banks.split(",")
        for kind in args.kinds.split(",")
    ]
    columns = [
        "bank [rad]",
        "seed",
        "true",
        "verdict",
        "found",
        "hint [rad]",
        "mm",
        "s",
    ]
    if args.shares:
        columns[3:] = ["found", "gain [nats]", "of banks [nats]", "share"]
    print(f"| {' | '.join(columns)} |\n{'|---' * len(columns)}|")
    for row in joblib.Parallel(n_jobs=args.jobs, return_as="generator")(tasks):
        print(row, flush=True)


if __name__ == "__main__":
    main()
