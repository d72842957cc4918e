"""Which flight tells a filter where the wing sits and how large the elevator is?

An extended Kalman filter takes two numbers of the glider, the wing's offset l_w and
the elevator's area S_e, for slow states. It watches the article's cruise (powered, in
a drifting wind, launched half a metre too high; it starts with both at zero) and a
perch (l_w starts at 0.02 m, S_e at zero). Their gliders differ: the perch's has its
wing at l_w = 0, the cruise's at -0.03 m, and with that no perch plan is found. A
number can be known only as far as the motion depends on it, so beside the filter's
deviations stand the least that any estimator could reach, by Fisher information;
of a settled cruise (the perch's glider, from trim, in air that is still at first)
there is only that. Then: is a filter as uncertain as it says (NEES and NIS, 1 is
right), and is it good enough to perch with? Both are asked of the filter that
perches: motion capture at 120 Hz with 1 mm of noise.

    python examples/filter_parameters.py
    python examples/filter_parameters.py --headless --json f.json --figure f.png

--json: {"cruise", "perch": {"l_w", "S_e": [estimate, standard deviation, truth]},
"constant", "least_std", "seconds", "slow_nees", "nees", "nis", "consistency_of", ..}.
"cruise" and "perch" are of the article's filter, which lets the numbers drift, at the
flight's end; "constant" are those of one that takes them for constants, and
"least_std" the least deviations, both after "seconds". "slow_nees" is the NEES of l_w
and S_e of "constant" over 20 flights. "nees" and "nis" are of "consistency_of".
"""

import argparse
import dataclasses
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from rich.console import Console

from diagrams.estimated_loop import (
    EstimatedPerches,
    fly_on_estimate,
)
from diagrams.playback import GREY
from diagrams.showing import (
    add_launches,
    add_options,
    check_folders,
    run,
    show,
    write_figures,
)
from diagrams.studies.filter_figure import save_study_figure
from diagrams.tracks import (
    flight_track,
    plan_track,
)
from glider.control.tvlqr import compiled_policy
from glider.estimation.consistency import Consistency
from glider.estimation.perching import watch_perches
from glider.paths import models_path
from glider.physics.model import GliderModel
from glider.physics.parameters import load_parameters
from glider.planning.dircol import plan
from glider.planning.problem import load_problem
from glider.simulation.monte_carlo import (
    LaunchSpread,
    draw_launches,
)
from glider.studies.filter_study import (
    CONSTANTS,
    RATE,
    SYMBOLS,
    Watched,
    settled_bound,
    slow_nees,
    watch_all,
)

TRUSTED = "motion capture at 120 Hz with 1 mm of noise, over 200 perches"
"""Of which filter NEES and NIS are."""

FLIGHTS = 20
"""Over which the constants' NEES is taken."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Found:
    """What came out: flights by name, and the filter that perches."""

    drifting: Mapping[str, Watched]
    constant: Mapping[str, Watched]
    slow_nees: Mapping[str, float]
    settled: np.ndarray
    trusted: Consistency
    flown: EstimatedPerches

    @property
    def end(self) -> int:
        """The sample at which a perch is over."""
        return len(self.constant["perch"].slow) - 1

    @property
    def least(self) -> dict[str, np.ndarray]:
        """(2,) least deviations then, by flight."""
        rows = {name: watched.bound for name, watched in self.constant.items()}
        rows["settled cruise"] = self.settled
        return {name: bound[self.end] for name, bound in rows.items()}


def main(arguments: Sequence[str] | None = None) -> None:
    """Reads the command line, filters, flies, prints and shows what came out."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--figure", metavar="FILE", type=Path, help="of l_w and S_e")
    add_launches(parser, 20)
    add_options(parser)
    args = parser.parse_args(arguments)
    check_folders(args.json, args.html, args.figure)

    cruising = load_parameters(models_path("vehicles", "heavy_ekf.yaml"))
    perching = load_parameters(models_path("vehicles", "heavy.yaml"))
    problem = load_problem(models_path("problems", "perching.yaml"))
    model, rng = GliderModel(parameters=perching), np.random.default_rng(args.seed)
    with Console(stderr=True).status("plan (compiles once)") as status:
        planned = plan(model, problem, progress=status.update)
        policy = compiled_policy(model, planned)
        status.update("filter (compiles once)")
        drifting = watch_all(cruising, perching, policy, rng)
        constant = [
            watch_all(cruising, perching, policy, rng, CONSTANTS)
            for _ in range(FLIGHTS)
        ]
        starts = draw_launches(problem, LaunchSpread(), args.launches, rng)
        found = Found(
            drifting=drifting,
            constant=constant[0],
            slow_nees={
                name: slow_nees([case[name] for case in constant]) for name in drifting
            },
            settled=settled_bound(perching, rng, CONSTANTS),
            trusted=watch_perches(model, policy, 200, rng).consistency,
            flown=fly_on_estimate(model, planned, starts, rng, status.update),
        )

    figures = {**key_figures(found), "launches": args.launches, "seed": args.seed}
    describe(found)
    write_figures(args, figures)
    if args.figure:
        save_study_figure(args.figure, found.drifting, found.constant)
    worst = max(found.flown.on_estimate, key=lambda flight: flight.miss)
    tracks = [
        flight_track("worst launch on the estimate", worst),
        plan_track("plan", planned, GREY),
    ]
    show(args, tracks, "Perch on an estimate", parameters=perching)


def key_figures(found: Found) -> dict[str, object]:
    """Returns what --json writes."""
    constant, trusted = found.constant.items(), found.trusted
    return {
        **{name: watched.numbers() for name, watched in found.drifting.items()},
        "constant": {name: watched.numbers(found.end) for name, watched in constant},
        "least_std": {
            name: dict(zip(SYMBOLS, bound.tolist(), strict=True))
            for name, bound in found.least.items()
        },
        "seconds": found.end / RATE,
        "slow_nees": found.slow_nees,
        "nees": float(np.mean(trusted.nees)),
        "nis": float(np.mean(trusted.nis)),
        "nees_inside": trusted.nees_inside,
        "nis_inside": trusted.nis_inside,
        "consistency_of": TRUSTED,
        "miss_on_state_m": [flight.miss for flight in found.flown.on_state],
        "miss_on_estimate_m": [flight.miss for flight in found.flown.on_estimate],
    }


def describe(found: Found) -> None:
    """Prints what each flight tells, and how good the filter is that perches."""
    for name, least in found.least.items():
        told = [f"{s} at least ± {b:.4f}" for s, b in zip(SYMBOLS, least, strict=True)]
        if name in found.constant:
            known = found.constant[name].numbers(found.end).values()
            told = [
                f"{word}, filter {mean:.4f} ± {std:.4f} (true {true:g})"
                for word, (mean, std, true) in zip(told, known, strict=True)
            ]
            told.append(f"NEES over {FLIGHTS} flights {found.slow_nees[name]:.2f}")
        print(f"{name}, after {found.end / RATE:.2f} s: {'; '.join(told)}")
    trusted, flown = found.trusted, found.flown
    on_state, on_estimate = (
        1000.0 * np.median([flight.miss for flight in flights])
        for flights in (flown.on_state, flown.on_estimate)
    )
    print(
        f"Of {TRUSTED}, NEES is {np.mean(trusted.nees):.3f} and NIS "
        f"{np.mean(trusted.nis):.3f}; {trusted.nees_inside:.0%} and "
        f"{trusted.nis_inside:.0%} of the samples are in their 95 % bands.\n"
        f"On its estimate {sum(f.perched for f in flown.on_estimate)} of "
        f"{len(flown.on_estimate)} launches perch, median miss {on_estimate:.1f} mm; "
        f"on the true state {on_state:.1f} mm."
    )


if __name__ == "__main__":
    sys.exit(run(main))
