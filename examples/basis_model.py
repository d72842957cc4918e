"""Which features make an accelerating glider? The article's identification exercise.

Each acceleration is a sum of a few features of the flight, with coefficients by least
squares. The published scores come from formulas that count angles nose up, on flights
that count them nose down. The same mistake, in a log, is named by the tracer; with
the signs put right the same features leave a sixteenth, and better ones next to
nothing. Flights left out choose the model, and coefficients refined until rollouts
fit (not only accelerations) fly the held-out flight closer still.

    python examples/basis_model.py
    python examples/basis_model.py --headless --json basis.json --figure basis.png

--json: {"scores": {"published_signs", "consistent_signs": {configuration: score}},
"best_subsets": {"total", "tangential", "normal", "pitch": [features]}, "held_out_end":
[x, z, pitch] of configuration 6 under published signs, and the rest as printed}.
"""

import argparse
import math
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich.console import Console
from threadpoolctl import threadpool_limits

from diagrams.playback import GREEN, RED, Track, stage_of
from diagrams.showing import (
    add_options,
    check_folders,
    run,
    show,
    whole_number,
    write_figures,
)
from glider.plots.basis import save_exercise_figure
from glider.sysid.basis_choice import configured, cross_validate, searched
from glider.sysid.basis_exercise import load_exercise
from glider.sysid.basis_features import FEATURES, PAPER
from glider.sysid.basis_logs import exercise_campaign, filmed_campaign
from glider.sysid.basis_model import CHANNELS, best_numbers, fit_basis, fly_again
from glider.sysid.basis_refinement import refine, rollout_error
from glider.sysid.noise import measure_noise
from glider.sysid.pipeline import close_the_loop
from glider.sysid.signs import find_signs
from glider.sysid.vehicle import make_vehicle


def main(arguments: Sequence[str] | None = None) -> None:
    """Reads the command line, scores, traces, chooses, refines, prints and shows."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--seed", type=whole_number(0), default=0, help="of the filmed log's noise"
    )
    parser.add_argument("--figure", metavar="FILE", type=Path, help="as PNG")
    add_options(parser)
    args = parser.parse_args(arguments)
    check_folders(args.json, args.html, args.figure)

    exercise = load_exercise()
    fitted, held_out, sets = exercise.fitted, exercise.held_out, exercise.configurations
    scores, choice, subsets, models = {}, {}, {}, {}
    for signs, angles in (("published", "nose_up"), ("consistent", "nose_down")):
        frame = exercise.frame(angles)
        fits = {c: fit_basis(fitted, frame, numbers) for c, numbers in sets.items()}
        scores[f"{signs}_signs"] = {c: int(fit.score) for c, fit in fits.items()}
        models[f"configuration 6 {signs} signs"] = fits["6"].model
        candidates = {c: configured(numbers) for c, numbers in sets.items()}
        candidates |= {f"best {k}": searched(frame, PAPER, k) for k in (1, 2, 3)}
        errors = cross_validate(fitted, frame, candidates)
        choice[signs] = {c: e if math.isfinite(e) else None for c, e in errors.items()}
        print(f"{signs} signs leave {scores[f'{signs}_signs']}")
        print(f"  left-out flights choose '{min(errors, key=errors.__getitem__)}'")
    for name, features in (("best_subsets", PAPER), ("best_subsets_of_41", FEATURES)):
        numbers = best_numbers(fitted, frame, tuple(features))
        best = fit_basis(fitted, frame, numbers)
        subsets[name] = {
            "total": best.score,
            **dict(zip(CHANNELS, numbers, strict=True)),
        }
        models[name.replace("_", " ")] = best.model
        print(f"{name} {numbers} leave {best.score:.2f}")

    own, rollout = exercise_campaign(exercise, "nose_up"), {}
    with Console(stderr=True).status("trace (compiles once)") as status:
        with threadpool_limits(limits=1, user_api="blas"):  # Small matrices.
            signs = find_signs(own, own.flights, measure_noise(own), make_vehicle(own))
        rng = np.random.default_rng(args.seed)
        filmed = filmed_campaign(exercise, "nose_up", rng)
        found = close_the_loop(filmed, progress=status.update)
        traced = {effect.kind: {"share": effect.share} for effect in found.effects}
        print(f"logged as published, the tracer names {', '.join(traced)}")
        status.update("refine")
        for name, model in models.items():
            pair = (model, refine(model, fitted))
            errors = [vars(rollout_error(m, held_out)) for m in pair]
            rollout[name] = dict(zip(("before", "after"), errors, strict=True))
            before, after = (e["weighted"] for e in errors)
            print(f"{name}: held-out rollout {before:.4f}, refined {after:.4f}")

    flown = {name: fly_again(model, held_out)[0] for name, model in models.items()}
    published, consistent, *_ = flown.values()
    figures = {"scores": scores, **subsets, "held_out_end": published[-1, :3].tolist()}
    figures |= {"cross_validation": choice, "signs": vars(signs)}
    figures |= {"traced": traced, "rollout": rollout}
    write_figures(args, figures)
    flight = held_out.states[0]
    times = held_out.step * np.arange(len(flight))
    if args.figure:
        save_exercise_figure(args.figure, scores, times, flight, flown)
    shown = (("flight", flight, None), ("published signs", published, RED))
    tracks = [
        Track(name=name, times=times, poses=poses[:, :4], color=color)
        for name, poses, color in (*shown, ("consistent signs", consistent, GREEN))
    ]
    show(args, tracks, "Held-out flight", stage=stage_of(tracks[0], wire=None))


if __name__ == "__main__":
    sys.exit(run(main))
