"""Which flight shows a filter where the wing sits and how large the elevator is?

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

    python examples/article/filter_parameters.py
    python examples/article/filter_parameters.py --headless --json f.json --figure f.png

--json: {"cruise", "perch": {"l_w", "S_e": [estimate, standard deviation, truth]},
"constant", "least_std", "seconds", "slow_nees", "nees", "nis", "consistency_of", ..}.
"cruise" and "perch" are of the article's filter, which lets the numbers drift, at the
flight's end; "constant" are those of one that takes them for constants, and
"least_std" the least deviations, both after "seconds". "slow_nees" is the NEES of l_w
and S_e of "constant" over 20 flights. "nees" and "nis" are of "consistency_of".
"""

import dataclasses
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from diagrams import playback
from diagrams.programs import program
from filter_consistency import Consistency, watch_perches
from filter_figures import Knowledge, save_knowledge_figure
from filter_flights import (
    EstimatedPerches,
    fly_on_estimate,
    perching_glider,
    watch_twice,
)
from filter_study import (
    CONSTANTS,
    RATE,
    SYMBOLS,
    ParameterTrack,
    settled_bound,
    slow_nees,
)
from glider.control.tvlqr import tracking_policy
from glider.planning.dircol import plan
from glider.planning.plan import Plan
from glider.planning.problem import PerchingProblem

PERCHES = 200
"""Number of perches that NEES and NIS of the filter that perches are taken over."""

TRUSTED = f"motion capture at 120 Hz with 1 mm of noise, over {PERCHES} perches"
"""Description of that filter, and of the perches."""

LABELS = ("wing offset l_w [m]", "elevator area S_e [m²]")

SHOWN = 1.0
"""Time of each flight in the picture [s]; afterwards a cruise adds little."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class FilterReport:
    """Flights that were watched, by name, and the filter that perches."""

    plan: Plan
    """Plan of the perches."""

    drifting: dict[str, ParameterTrack]
    """Flights watched by the article's filter, which lets the numbers drift."""

    constant: list[dict[str, ParameterTrack]]
    """The same, with other noise, by one that takes the numbers for constants."""

    settled: np.ndarray
    """Least deviations in a settled cruise, (K + 1, 2)."""

    consistency: Consistency
    """Consistency of the filter that perches, over PERCHES perches."""

    flown: EstimatedPerches
    """Launches with that filter's estimate, and without."""

    @property
    def end(self) -> int:
        """The sample at which a perch is over."""
        return len(self.constant[0]["perch"].slow) - 1

    @property
    def least(self) -> dict[str, np.ndarray]:
        """Least deviations (2,) then, by flight."""
        bounds = {name: watched.bound for name, watched in self.constant[0].items()}
        bounds["settled cruise"] = self.settled
        return {name: bound[self.end] for name, bound in bounds.items()}

    @property
    def slow_nees(self) -> dict[str, float]:
        """NEES of the constants at a flight's end, by flight; 1 is right."""
        return {
            name: slow_nees([flights[name] for flights in self.constant])
            for name in self.drifting
        }

    def key_figures(self) -> dict[str, object]:
        """Returns estimates, bounds and the filter's consistency, for a file."""
        known = {name: watched.numbers() for name, watched in self.drifting.items()}
        first = self.constant[0].items()
        trusted = self.consistency
        return {
            **known,
            "constant": {name: watched.numbers(self.end) for name, watched in first},
            "least_std": {
                name: dict(zip(SYMBOLS, bound.tolist(), strict=True))
                for name, bound in self.least.items()
            },
            "seconds": self.end / RATE,
            "slow_nees": self.slow_nees,
            "nees": float(np.mean(trusted.nees)),
            "nis": float(np.mean(trusted.nis)),
            "nees_inside": trusted.nees_inside,
            "nis_inside": trusted.nis_inside,
            "consistency_of": TRUSTED,
            "on_state": self.flown.on_state.key_figures(),
            "on_estimate": self.flown.on_estimate.key_figures(),
            "launches": len(self.flown.on_estimate),
        }

    def describe(self) -> str:
        """Returns the bounds of each flight, and the perching filter's consistency."""
        lines = []
        for name, least in self.least.items():
            bounds = zip(SYMBOLS, least, strict=True)
            words = [f"{symbol} at least ± {bound:.4f}" for symbol, bound in bounds]
            if name in self.drifting:
                words = self._with_estimates(name, words)
            lines.append(f"{name}, after {self.end / RATE:.2f} s: {'; '.join(words)}")
        trusted, flown = self.consistency, self.flown
        return "\n".join(
            [
                *lines,
                f"Of {TRUSTED}, NEES is {np.mean(trusted.nees):.3f} and NIS "
                f"{np.mean(trusted.nis):.3f}; {trusted.nees_inside:.0%} and "
                f"{trusted.nis_inside:.0%} of the samples are in their 95 % bands.",
                f"On its estimate {flown.on_estimate.describe()};\n"
                f"on the true state {flown.on_state.describe()}.",
            ]
        )

    def _with_estimates(self, name: str, bounds: list[str]) -> list[str]:
        known = self.constant[0][name].numbers(self.end).values()
        words = [
            f"{bound}, filter {mean:.4f} ± {std:.4f} (true {true:g})"
            for bound, (mean, std, true) in zip(bounds, known, strict=True)
        ]
        nees = f"NEES over {len(self.constant)} flights {self.slow_nees[name]:.2f}"
        return [*words, nees]


def save_filter_figure(path: Path, report: FilterReport) -> None:
    """Saves estimates and deviations of both numbers along the flights."""
    drifting, constant = (
        [_known(name, watched) for name, watched in flights.items()]
        for flights in (report.drifting, report.constant[0])
    )
    save_knowledge_figure(path, LABELS, drifting, constant)


def _known(name: str, watched: ParameterTrack) -> Knowledge:
    kept = watched.flight.times <= SHOWN
    return Knowledge(
        name=name,
        times=watched.flight.times[kept],
        means=watched.slow[kept],
        stds=watched.std[kept],
        bounds=watched.bound[kept],
        truth=watched.truth,
    )


def fly(
    launches: int = 20, seed: int = 0, progress: program.Progress = program.silent
) -> FilterReport:
    """Filters a cruise and a perch in two ways, and perches on an estimate."""
    model, problem = perching_glider(), PerchingProblem()
    rng = np.random.default_rng(seed)
    policy = tracking_policy(model, plan(model, problem, progress=progress))
    drifting, constant = watch_twice(policy, rng, progress)
    starts = problem.draw_launches(launches, rng)
    return FilterReport(
        plan=policy.plan,
        drifting=drifting,
        constant=constant,
        settled=settled_bound(model.parameters, rng, CONSTANTS),
        consistency=watch_perches(model, policy, PERCHES, rng).consistency,
        flown=fly_on_estimate(model, policy.plan, starts, rng, progress),
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Flies as the command line says, prints and shows the result."""
    parser = program.make_parser(__doc__)
    program.add_launches(parser, 20)
    args = program.read_options(parser, arguments, figure="of l_w and S_e")
    with program.working("plan (compiles once)") as progress:
        found = fly(args.launches, args.seed, progress)
    print(found.describe())
    program.write_json(args, found.key_figures() | {"seed": args.seed})
    program.write_figure(args, save_filter_figure, found)
    worst = playback.track_of(
        "worst launch on the estimate", found.flown.on_estimate.worst
    )
    tracks = [worst, playback.track_of("plan", found.plan, playback.GREY)]
    program.show(args, tracks, "Perch on an estimate")


if __name__ == "__main__":
    sys.exit(program.run(main))
