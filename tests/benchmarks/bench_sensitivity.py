"""Which constants of the tracer change its answers? Halves and doubles each of them.

    python -m tests.benchmarks.bench_sensitivity --json FILE.jsonl [--seeds 2,14,37]
        [--nulls 400,401] [--only NAME,...] [--group 8] [--jobs 2]

An answer is a campaign's verdict and the kinds it names; the campaigns are those of
`bench_forms`. Each constant of `glider.sysid.constants` is halved and doubled, with all
its numbers where it has several, and what changes is counted.

Most constants change nothing. So --group of them are first changed together: where no
answer is another one, none of them matters, unless two changes undo each other; where
one is, the group is split. Lines are kept in FILE, and what is there is not run again.
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
import json, sys
import glider.sysid.constants as constants
from tests.benchmarks.bench_sensitivity import scaled
change, campaigns = json.loads(sys.argv[1])
for name, factor in change.items():
    setattr(constants, name, scaled(getattr(constants, name), factor))
from tests.benchmarks.bench_forms import run
for seed, null in campaigns:
    line = run(seed, None, None, null)
    print(json.dumps([seed, null, line["verdict"], sorted(line["kinds"])]), flush=True)
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


def answers(change: Change, campaigns: Sequence[Campaign]) -> dict[str, Any]:
    """Returns the answers to some campaigns, by campaign, under changed constants."""
    command = [sys.executable, "-c", _WORKER, json.dumps([change, campaigns])]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    lines = [json.loads(text) for text in done.stdout.splitlines()]
    found = {f"{'null ' * null}{seed}": answer for seed, null, *answer in lines}
    if len(found) < len(campaigns):
        found["crash"] = done.stderr.strip().splitlines()[-1:]
    return found


class Runs:
    """Answers under changed constants, kept in a file."""

    def __init__(self, file: Path, campaigns: Sequence[Campaign]):
        """Takes the file of what was run before."""
        self.file, self.campaigns = file, campaigns
        lines = file.read_text().splitlines() if file.exists() else []
        self._kept = dict(map(json.loads, lines))

    def changed(self, change: Change) -> list[str]:
        """Returns the campaigns that are answered otherwise under a change."""
        usual, now = self._answers({}), self._answers(change)
        return [name for name in {**usual, **now} if usual.get(name) != now.get(name)]

    def _answers(self, change: Change) -> dict[str, Any]:
        key = json.dumps([sorted(change.items()), self.campaigns])
        if key not in self._kept:
            self._kept[key] = answers(change, self.campaigns)
            with self.file.open("a") as file:
                file.write(json.dumps([key, self._kept[key]]) + "\n")
        return self._kept[key]


def screen(
    runs: Runs, names: Sequence[str], factor: float
) -> Iterator[tuple[str, list[str]]]:
    """Yields each constant and the campaigns that it changes, group by group."""
    changed = runs.changed(dict.fromkeys(names, factor))
    if len(names) == 1 or not changed:
        yield from ((name, changed) for name in names)
        return
    half = len(names) // 2
    yield from screen(runs, names[:half], factor)
    yield from screen(runs, names[half:], factor)


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
    parser.add_argument("--seeds", default="2,14,37", help="of campaigns with effects")
    parser.add_argument("--nulls", default="400,401", help="of campaigns without")
    parser.add_argument("--only", default="", help="names; all by default")
    parser.add_argument(
        "--group", type=int, default=8, help="changed together at first"
    )
    parser.add_argument("--jobs", type=int, default=2, help="groups at a time")
    args = parser.parse_args()
    campaigns = [
        (int(seed), null)
        for text, null in ((args.seeds, False), (args.nulls, True))
        for seed in filter(None, text.split(","))
    ]
    runs = Runs(args.json, campaigns)
    names = [n for n in args.only.split(",") if n] or constants()
    groups = [names[k : k + args.group] for k in range(0, len(names), args.group)]
    runs.changed({})
    found: dict[tuple[str, float], list[str]] = {}

    def one(job: tuple[Sequence[str], float]) -> None:
        group, factor = job
        for name, changed in screen(runs, group, factor):
            found[name, factor] = changed
            print(
                f"{name} x {factor:g}: {', '.join(changed) or 'no change'}", flush=True
            )

    with ThreadPoolExecutor(args.jobs) as pool:
        list(pool.map(one, [(group, f) for group in groups for f in FACTORS]))
    show(names, found, len(campaigns))


if __name__ == "__main__":
    main()
