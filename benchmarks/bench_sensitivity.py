"""Which constants of the tracer change its answers? Halves and doubles each of them.

    python -m benchmarks.bench_sensitivity --json FILE.jsonl [--number 32]
        [--nulls 8] [--flights 12] [--only NAME,...] [--group 8] [--jobs 2]

An answer is a campaign's verdict and the kinds it names; the campaigns are the first
flights of those of `bench_forms` with one effect: of few flights, answers change most
easily. Each constant of `glider.sysid.constants` is halved and doubled, with all its
numbers where it has several, and what changes is counted.

Most constants change little. So --group of them are first changed together, and split
for the answers that are others then: what two changes undo is not seen. Lines are kept
in FILE, and what is there is not run again.
"""

import argparse
import json
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

FACTORS = 0.5, 2.0

Campaign = tuple[int, bool]  # Its seed in `bench_forms`, and whether it is a null.
Change = Mapping[str, float]  # Constants, by name, and what they are multiplied by.

_WORKER = """
import dataclasses, json, sys
import glider.sysid.constants as constants
from benchmarks.bench_sensitivity import scaled
change, campaigns, flights = json.loads(sys.argv[1])
for name, factor in change.items():
    setattr(constants, name, scaled(getattr(constants, name), factor))
from glider.errors import InputError
from glider.sysid.pipeline import close_the_loop
from benchmarks.bench_forms import draw, label_of
for seed, null in campaigns:
    campaign, _ = draw(seed, count=1, null=null)
    few = dataclasses.replace(campaign, flights=campaign.flights[:flights])
    try:
        result = close_the_loop(few, seed=seed)
        answer = [result.verdict, sorted(map(label_of, result.effects))]
    except Exception as error:  # One campaign's answer, not the end.
        verdict = "refused" if isinstance(error, InputError) else "crashed"
        answer = [verdict, [type(error).__name__]]
    print(json.dumps([seed, null, *answer]), flush=True)
"""
"""Constants are changed before any other module has read them."""


def constants() -> list[str]:
    """Returns the names of the constants that steer the tracer."""
    import glider.sysid.constants as module

    return [name for name in vars(module) if name.isupper()]


def scaled(value: Any, factor: float) -> Any:
    """Returns a constant with all its numbers times a factor; counts stay counts."""
    if isinstance(value, dict):
        return {key: scaled(own, factor) for key, own in value.items()}
    if isinstance(value, tuple):
        return tuple(scaled(own, factor) for own in value)
    if isinstance(value, int):
        return max(1, round(value * factor))
    return value * factor


class Runs:
    """Answers under changed constants, kept in a file."""

    def __init__(self, file: Path, flights: int):
        """Takes the file of what was run before, and how many flights there are."""
        self.file, self.flights = file, flights
        lines = file.read_text().splitlines() if file.exists() else []
        self._kept = {
            (change, name): own for change, name, own in map(json.loads, lines)
        }

    def changed(self, change: Change, campaigns: Sequence[Campaign]) -> list[Campaign]:
        """Returns the campaigns that are answered otherwise under a change."""
        usual, now = self.answers({}, campaigns), self.answers(change, campaigns)
        pairs = zip(campaigns, usual, now, strict=True)
        return [campaign for campaign, before, after in pairs if before != after]

    def answers(self, change: Change, campaigns: Sequence[Campaign]) -> list[Any]:
        """Returns the answers to campaigns under changed constants."""
        what = json.dumps([sorted(change.items()), self.flights])
        keys = {(what, name_of(campaign)): campaign for campaign in campaigns}
        if missing := [own for key, own in keys.items() if key not in self._kept]:
            task = json.dumps([change, missing, self.flights])
            command = [sys.executable, "-c", _WORKER, task]
            with (
                subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as worker,
                self.file.open("a") as file,
            ):
                assert worker.stdout is not None
                for seed, null, *answer in map(json.loads, worker.stdout):
                    key = what, name_of((seed, null))
                    self._kept[key] = answer
                    file.write(json.dumps([*key, answer]) + "\n")
                    file.flush()
            if any(key not in self._kept for key in keys):
                raise RuntimeError(
                    f"the worker of {what} ended with {worker.returncode}"
                )
        return [self._kept[key] for key in keys]


def name_of(campaign: Campaign) -> str:
    """Returns what a table calls a campaign."""
    seed, null = campaign
    return f"{'null ' * null}{seed}"


def screen(
    runs: Runs, names: Sequence[str], factor: float, campaigns: Sequence[Campaign]
) -> Iterator[tuple[str, list[str]]]:
    """Yields each constant and the campaigns that it changes, group by group."""
    changed = runs.changed(dict.fromkeys(names, factor), campaigns)
    if len(names) == 1 or not changed:
        yield from ((name, [*map(name_of, changed)]) for name in names)
        return
    half = len(names) // 2
    yield from screen(runs, names[:half], factor, changed)
    yield from screen(runs, names[half:], factor, changed)


def show(
    names: Sequence[str], found: Mapping[tuple[str, float], list[str]], count: int
) -> None:
    """Prints which constants change which answers, those that change most first."""

    def total(name: str) -> int:
        return sum(len(found[name, factor]) for factor in FACTORS)

    print(f"| constant | halved: of {count} answers change | doubled |\n|---|---|---|")
    for name in sorted(names, key=total, reverse=True):
        if total(name):
            cells = [
                f"{len(own)}: {', '.join(own)}" if (own := found[name, f]) else "0"
                for f in FACTORS
            ]
            print(f"| `{name}` | {' | '.join(cells)} |")
    idle = [f"`{name}`" for name in names if not total(name)]
    print(f"\n{len(idle)} of {len(names)} change none: {', '.join(idle)}.")


def main() -> None:
    """Runs what is asked for, and prints the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", type=Path, required=True, help="file of what was run")
    parser.add_argument("--number", type=int, default=32, help="with an effect")
    parser.add_argument("--nulls", type=int, default=8, help="campaigns without one")
    parser.add_argument("--flights", type=int, default=12, help="of each campaign")
    parser.add_argument("--only", default="", help="names; all by default")
    parser.add_argument(
        "--group", type=int, default=8, help="changed together at first"
    )
    parser.add_argument("--jobs", type=int, default=2, help="groups at a time")
    args = parser.parse_args()
    campaigns = [(seed, False) for seed in range(args.number)]
    campaigns += [(seed, True) for seed in range(400, 400 + args.nulls)]
    runs = Runs(args.json, args.flights)
    names = [n for n in args.only.split(",") if n] or constants()
    groups = [names[k : k + args.group] for k in range(0, len(names), args.group)]
    runs.answers({}, campaigns)
    found: dict[tuple[str, float], list[str]] = {}

    def one(job: tuple[Sequence[str], float]) -> None:
        group, factor = job
        for name, changed in screen(runs, group, factor, campaigns):
            found[name, factor] = changed
            print(
                f"{name} x {factor:g}: {', '.join(changed) or 'no change'}", flush=True
            )

    with ThreadPoolExecutor(args.jobs) as pool:
        list(pool.map(one, [(group, f) for group in groups for f in FACTORS]))
    show(names, found, len(campaigns))


if __name__ == "__main__":
    main()
