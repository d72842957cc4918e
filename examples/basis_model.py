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
"best_subsets" (of the paper's features), "best_subsets_of_41": {"total",
"tangential", "normal", "pitch": [features]},
"regressions": {"published_signs", "consistent_signs": {configuration: CHANNELS},
"best_subsets", "best_subsets_of_41": CHANNELS}, where CHANNELS is {"tangential",
"normal", "pitch": {"rank", "condition" (null without full rank)}},
"cross_validation": {"published_signs", "consistent_signs": {candidate: rollout error
on flights left out, null where it blows up}},
"signs": {"pitch", "elevator", "command": 1 or -1, "evidence", "share"}, of the
exercise's own numbers as a log; "traced": {effect: {"share"}}, of its flights filmed,
"rollout": {model: {"before", "after": {"weighted", "position_m", "pitch_rad"}}},
"held_out_end": [x, z, pitch] of configuration 6 under published signs}.
"""

import argparse
import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from rich.console import Console
from threadpoolctl import threadpool_limits

from diagrams.playback import (
    GREEN,
    RED,
    Track,
    stage_of,
)
from diagrams.showing import (
    add_options,
    check_folders,
    run,
    show,
    whole_number,
    write_figures,
)
from glider.studies.basis.basis_exercise import (
    Exercise,
    load_exercise,
)
from glider.studies.basis.basis_logs import (
    exercise_campaign,
    filmed_campaign,
)
from glider.studies.basis.basis_model import (
    CHANNELS,
    BasisDynamics,
    BasisFit,
    fly_again,
)
from glider.studies.basis.basis_study import (
    fit_configurations,
    fit_subsets,
    refinements,
    validate,
)
from glider.studies.plots.basis import save_exercise_figure
from glider.sysid.pipeline import close_the_loop
from glider.sysid.replay.noise import measure_noise
from glider.sysid.replay.vehicle import make_vehicle
from glider.sysid.search.signs import find_signs


def read_options(arguments: Sequence[str] | None) -> argparse.Namespace:
    """Returns the options of the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--seed", type=whole_number(0), default=0, help="of the filmed log's noise"
    )
    parser.add_argument(
        "--ridge",
        metavar="GAMMA",
        type=float,
        default=0.0,
        help="of all fits, not of the search for subsets (default: 0, as published)",
    )
    parser.add_argument("--figure", metavar="FILE", type=Path, help="as PNG")
    add_options(parser)
    args = parser.parse_args(arguments)
    check_folders(args.json, args.html, args.figure)
    return args


def channels_of(fit: BasisFit) -> dict[str, dict]:
    """Returns rank and condition of each channel for --json."""
    return {
        channel: {"rank": r.rank, "condition": finite(r.condition)}
        for channel, r in zip(CHANNELS, fit.regressions, strict=True)
    }


def finite(value: float) -> float | None:
    """Returns a number, or None where JSON has none."""
    return value if math.isfinite(value) else None


def score(exercise: Exercise, ridge: float) -> tuple[dict, dict[str, BasisDynamics]]:
    """Fits and prints what configurations and subsets leave; returns models too."""
    told: dict = {"scores": {}, "regressions": {}}
    models = {}
    for signs, fits in fit_configurations(exercise, ridge).items():
        told["scores"][signs] = {name: int(fit.score) for name, fit in fits.items()}
        told["regressions"][signs] = {n: channels_of(fit) for n, fit in fits.items()}
        models[f"configuration 6 {signs.replace('_', ' ')}"] = fits["6"].model
        print(f"{signs} leave {told['scores'][signs]}")
    for name, fit in fit_subsets(exercise, ridge).items():
        numbers = dict(zip(CHANNELS, fit.model.numbers, strict=True))
        told[name] = {"total": fit.score, **numbers}
        told["regressions"][name] = channels_of(fit)
        models[name.replace("_", " ")] = fit.model
        print(f"{name} {fit.model.numbers} leave {fit.score:.2f}")
    return told, models


def choose(exercise: Exercise, ridge: float) -> dict[str, dict]:
    """Prints what flights left out choose, and returns all errors."""
    choice = validate(exercise, ridge)
    for signs, errors in choice.items():
        best = min(errors, key=errors.__getitem__)
        print(f"{signs}: left-out flights choose '{best}', {errors[best]:.4f} off")
    return {s: {n: finite(e) for n, e in es.items()} for s, es in choice.items()}


def trace(exercise: Exercise, seed: int) -> dict[str, dict]:
    """Prints and returns what is wrong with the exercise logged as published."""
    log = exercise_campaign(exercise, "nose_up")
    filmed = filmed_campaign(exercise, "nose_up", np.random.default_rng(seed))
    with Console(stderr=True).status("trace (compiles once)") as status:
        with threadpool_limits(limits=1, user_api="blas"):  # Small matrices.
            signs = find_signs(log, log.flights, measure_noise(log), make_vehicle(log))
        found = close_the_loop(filmed, progress=status.update)
    traced = {effect.kind: {"share": effect.share} for effect in found.effects}
    print(
        f"logged as published, pitch, elevator and command have signs {signs.pitch}, "
        f"{signs.elevator}, {signs.command}; the tracer names {', '.join(traced)}"
    )
    return {"signs": vars(signs), "traced": traced}


def refine_models(exercise: Exercise, models: Mapping[str, BasisDynamics]) -> dict:
    """Prints and returns how close models fly before and after refinement."""
    with Console(stderr=True).status("refine"):
        rollout = refinements(exercise, models)
    for name, errors in rollout.items():
        before, after = (error.weighted for error in errors.values())
        print(f"{name}: held-out rollout {before:.4f}, refined {after:.4f}")
    return {n: {k: vars(e) for k, e in es.items()} for n, es in rollout.items()}


def main(arguments: Sequence[str] | None = None) -> None:
    """Scores, chooses, traces, refines, and shows the held-out flight."""
    args = read_options(arguments)
    exercise = load_exercise()
    figures, models = score(exercise, args.ridge)
    figures["cross_validation"] = choose(exercise, args.ridge)
    figures |= trace(exercise, args.seed)
    figures["rollout"] = refine_models(exercise, models)
    held_out = exercise.held_out
    flown = {name: fly_again(model, held_out)[0] for name, model in models.items()}
    published, consistent, *_ = flown.values()
    figures["held_out_end"] = published[-1, :3].tolist()
    write_figures(args, figures)
    flight = held_out.states[0]
    times = held_out.step * np.arange(len(flight))
    if args.figure:
        save_exercise_figure(args.figure, figures["scores"], times, flight, flown)
    shown = (("flight", flight, None), ("published signs", published, RED))
    tracks = [
        Track(name=name, times=times, poses=poses[:, :4], color=color)
        for name, poses, color in (*shown, ("consistent signs", consistent, GREEN))
    ]
    show(args, tracks, "Held-out flight", stage=stage_of(tracks[0], wire=None))


if __name__ == "__main__":
    sys.exit(run(main))
