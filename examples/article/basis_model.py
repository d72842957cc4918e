"""Which features make an accelerating glider? The article's identification exercise.

Each acceleration is a sum of a few features of the flight, with coefficients by least
squares. The published scores come from formulas that count angles nose up, on flights
that count them nose down. The same mistake, in a log, is named by the tracer; with
the signs put right the same features leave a sixteenth, and better ones next to
nothing. Held-out flights choose the model, and coefficients refined until rollouts
fit (not only accelerations) fly the held-out flight closer still.

    python examples/article/basis_model.py
    python examples/article/basis_model.py --headless --json b.json --figure b.png

--json: {"scores": {"published_signs", "consistent_signs": {configuration: score}},
"best_subsets" (of the paper's features), "best_subsets_of_41": {"total",
"tangential", "normal", "pitch": [features]},
"regressions": {"published_signs", "consistent_signs": {configuration: CHANNELS},
"best_subsets", "best_subsets_of_41": CHANNELS}, where CHANNELS is {"tangential",
"normal", "pitch": {"rank", "condition" (null without full rank)}},
"cross_validation": {"published_signs", "consistent_signs": {candidate: rollout error
on held-out flights, null where it diverges}},
"signs": {"pitch", "elevator", "command": 1 or -1, "evidence", "share"}, of the
exercise's own numbers as a log; "traced": {effect: {"share"}}, of its flights filmed,
"rollout": {model: {"before", "after": {"weighted", "position_m", "pitch_rad"}}},
"held_out_end": [x, z, pitch] of configuration 6 under published signs}.
"""

import sys
from collections.abc import Sequence

import numpy as np

from basis_exercise import load_exercise
from basis_figures import save_basis_figure
from basis_logs import find_exercise_signs, trace_filmed
from basis_study import (
    BasisStudy,
    describe,
    fit_all,
    key_figures,
    refinements,
    validate,
)
from diagrams.playback import GREEN, RED, Track
from diagrams.programs import program


def run(
    ridge: float = 0.0, seed: int = 0, progress: program.Progress = program.silent
) -> BasisStudy:
    """Fits, chooses, traces and refines, from the exercise's own flights."""
    exercise, rng = load_exercise(), np.random.default_rng(seed)
    fits = fit_all(exercise, ridge)
    return BasisStudy(
        exercise=exercise,
        fits=fits,
        choice=validate(exercise, ridge),
        signs=find_exercise_signs(exercise, "nose_up"),
        traced=trace_filmed(exercise, "nose_up", rng, progress),
        rollouts=refinements(exercise, fits.models),
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Runs as the command line says, prints and shows the result."""
    parser = program.make_parser(__doc__)
    program.add_count(parser, "--seed", 0, "of the filmed log's noise", least=0)
    words = "of all fits, not of the search for subsets (default: 0, as published)"
    parser.add_argument("--ridge", metavar="GAMMA", type=float, default=0.0, help=words)
    args = program.read_options(parser, arguments, figure="as PNG")
    with program.working("fit and trace (compiles once)") as progress:
        study = run(args.ridge, args.seed, progress)
    print(describe(study))
    program.write_json(args, key_figures(study))
    program.write_figure(args, save_basis_figure, study)
    held_out = study.exercise.held_out
    wrong, right, *_ = study.flown.values()
    ghosts = {"published signs": (wrong, RED), "consistent signs": (right, GREEN)}
    ghosts = {"flight": (held_out.states[0], None)} | ghosts
    tracks = [
        Track(name=name, times=held_out.times, poses=path[:, :4], color=color)
        for name, (path, color) in ghosts.items()
    ]
    program.show(args, tracks, "Held-out flight", has_wire=False)


if __name__ == "__main__":
    sys.exit(program.run(main))
