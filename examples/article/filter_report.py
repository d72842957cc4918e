"""A report of two parameters that a filter estimates: figures, words, a picture."""

import dataclasses
from pathlib import Path

import numpy as np

from filter_figures import Knowledge, save_knowledge_figure
from filter_flights import EstimatedPerches
from filter_study import RATE, SYMBOLS, ParameterTrack, slow_nees
from glider.estimation.consistency import Consistency
from glider.planning.plan import Plan

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
