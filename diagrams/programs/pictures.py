"""Pictures of the diagrams: python -m diagrams.programs.pictures [--out DIR].

For each diagram an .svg drawn by Matplotlib, and the .dot that Graphviz takes
(`dot -Tsvg closed_loop.dot`); where `dot` is installed, its .svg too.
"""

import argparse
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import matplotlib
from pydrake.systems.framework import Diagram

from diagrams.loops import closed_loop, open_loop
from diagrams.picture import make_picture
from diagrams.programs.program import run
from glider.physics.effects import SERVO_LAG
from glider.physics.model import GliderModel
from glider.planning import dircol
from glider.planning.problem import PerchingProblem
from glider.systems.regulator import tracking_regulator


def make_examples() -> dict[str, Diagram]:
    """Returns the diagrams to draw, by the names of their files."""
    nominal, lag = GliderModel(), GliderModel(effects=(SERVO_LAG(time_constant=0.03),))
    problem = PerchingProblem()

    def fly(model: GliderModel, **options: Any) -> Diagram:
        plan = dircol.plan(model, problem)
        regulator = tracking_regulator(model, plan)
        return closed_loop(nominal, regulator, planned=model, **options)

    plan = dircol.plan(nominal, problem)
    return {
        "open_loop": open_loop(nominal, plan),
        "closed_loop": fly(nominal),
        "closed_loop_sampled": fly(
            lag, command_rate=50.0, feedback_noise=True, motion_capture=120.0
        ),
    }


def save_pictures(diagrams: dict[str, Diagram], folder: Path) -> list[Path]:
    """Writes the pictures of diagrams into a folder; returns the files."""
    folder.mkdir(parents=True, exist_ok=True)
    files = []
    for name, diagram in diagrams.items():
        dot = folder / f"{name}.dot"
        dot.write_text(diagram.GetGraphvizString(), encoding="utf-8")
        picture = folder / f"{name}.svg"
        with matplotlib.rc_context({"svg.hashsalt": name}):  # The same each time.
            make_picture(diagram).savefig(picture, metadata={"Date": None})
        files += [dot, picture]
        if program := shutil.which("dot"):
            picture = folder / f"{name}.graphviz.svg"
            subprocess.run([program, "-Tsvg", str(dot), "-o", str(picture)], check=True)
            files.append(picture)
    return files


def main() -> None:
    """Runs the command."""
    parser = argparse.ArgumentParser(
        prog="python -m diagrams.programs.pictures", description=__doc__
    )
    parser.add_argument("--out", type=Path, default=Path("out/diagrams"))
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)  # Before the work.
    for file in save_pictures(make_examples(), args.out):
        print(file)


if __name__ == "__main__":
    sys.exit(run(main))
