"""How long and how much memory does `python -m glider close-the-loop` take?

    python -m benchmarks.bench_speed [CASE ...] [--runs 1] [--keep FOLDER]

Each case is a lifelike campaign (effects in the library's forms, turbulence, trims) in
a folder, and the command a process of its own, from the prompt to the written report;
the first run, of a small campaign, compiles and is not counted. A line has processor
time, wall time, the largest memory of the process, and the wall time of each stage as
the report gives it; of several runs, the one with the least processor time.
"""

import argparse
import json
import os
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

from glider.campaign.writer import save_campaign
from tests.helpers.lifelike import draw_campaign

FIVE = "attached_lift", "profile_drag", "servo_lag", "camber", "pitch_damping"
EIGHT = *FIVE, "wind", "mass", "center_of_pressure"

CASES = {
    "one": (40, FIVE[:1]),
    "five": (40, FIVE),
    "eight": (40, EIGHT),
    "many": (500, FIVE[:1]),
}
"""Number of flights, and the effects that their glider has undeclared."""


class Run(NamedTuple):
    """A finished process."""

    processor: float  #: User and system time [s].
    wall: float  #: [s]
    memory: float  #: Largest resident size [MB].
    report: dict  #: The written report.json.


def folder_of(case: str, parent: Path) -> Path:
    """Writes the campaign of a case, unless it is there, and returns its folder."""
    folder = parent / case
    if not folder.exists():
        flights, kinds = CASES[case]
        planted = [(kind, "library") for kind in kinds]
        campaign, _ = draw_campaign(7, flights, planted, moving_air=True, broken=False)
        save_campaign(folder, campaign)
    return folder


def run(folder: Path, out: Path) -> Run:
    """Runs the command on a campaign; RuntimeError if it fails."""
    command = ["-m", "glider", "close-the-loop", str(folder), "--out", str(out)]
    begin = time.perf_counter()
    process = os.posix_spawn(
        sys.executable,
        [sys.executable, *command],
        os.environ,
        file_actions=[(os.POSIX_SPAWN_OPEN, 1, os.devnull, os.O_WRONLY, 0)],
    )
    _, status, used = os.wait4(process, 0)
    if status:
        raise RuntimeError(f"{' '.join(command)} ends with status {status}")
    return Run(
        processor=used.ru_utime + used.ru_stime,
        wall=time.perf_counter() - begin,
        memory=used.ru_maxrss / 1024,
        report=json.loads((out / "report.json").read_text()),
    )


def show(case: str, best: Run) -> None:
    """Prints the row of a case."""
    stages = " ".join(f"{k} {v:.1f}" for k, v in best.report["seconds"].items())
    found = "+".join(effect["kind"] for effect in best.report["effects"])
    print(
        f"| {case} | {CASES[case][0]} | {best.processor:.1f} | {best.wall:.1f} | "
        f"{best.memory:.0f} | {stages} | {best.report['verdict']}: {found} |",
        flush=True,
    )


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("cases", nargs="*", default=list(CASES), metavar="CASE")
    parser.add_argument("--runs", type=int, default=1)
    parser.add_argument("--keep", type=Path, help="where campaigns and reports stay")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        parent = args.keep or Path(scratch)
        small, _ = draw_campaign(0, 8, [], moving_air=False, broken=False)
        save_campaign(Path(scratch) / "small", small)
        run(Path(scratch) / "small", Path(scratch) / "warm")
        print("| case | flights | processor s | wall s | MB | stages s | answer |")
        print("|---|---|---|---|---|---|---|")
        for case in args.cases:
            folder = folder_of(case, parent)
            out = parent / f"{case}_report"
            runs = [run(folder, out) for _ in range(args.runs)]
            show(case, min(runs, key=lambda own: own.processor))


if __name__ == "__main__":
    main()
