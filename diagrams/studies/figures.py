"""Figures of what was planned and flown."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from diagrams.studies.rehearsal import Rehearsal
from glider.physics.state import STATE_NAMES
from glider.planning.plan import Plan
from glider.report.plots.style import STYLE
from glider.simulation.flights import FlownFlight
from glider.studies.plots.perching import (
    AFTER,
    BEFORE,
    plot_commands,
    plot_misses,
    plot_perches,
)

_ELEVATOR = STATE_NAMES.index("elevator")


def save_perch_figure(
    path: Path,
    plan: Plan,
    flights: Sequence[FlownFlight],
    replayed: Sequence[FlownFlight],
) -> None:
    """Saves the paths and the elevator of a plan and its flights."""
    with rc_context(STYLE):
        figure = Figure(figsize=(9.5, 5.6), layout="constrained")
        top, bottom = figure.subplots(2, 1, height_ratios=[3, 2])
        plot_perches(
            top,
            plan.states,
            [flight.states for flight in flights],
            [flight.states for flight in replayed],
        )
        elevators = [_elevator(flight) for flight in flights]
        plot_commands(bottom, plan.times, plan.states[:, _ELEVATOR], elevators)
        figure.savefig(path, dpi=150)


def save_rehearsals_figure(path: Path, before: Rehearsal, after: Rehearsal) -> None:
    """Saves the paths and the misses of two rehearsals of one glider."""
    with rc_context(STYLE):
        figure = Figure(figsize=(9.5, 7.0), layout="constrained")
        axes = figure.subplots(3, 1)
        for ax, rehearsal, name, color in (
            (axes[0], before, "as drawn", BEFORE),
            (axes[1], after, "corrected", AFTER),
        ):
            paths = [flight.states for flight in rehearsal.flights]
            plot_perches(ax, rehearsal.plan.states, paths, color=color)
            ax.set_title(f"planned with the glider {name}", loc="left")
            plot_misses(axes[2], rehearsal.misses, f"planned {name}", color)
        axes[2].legend(loc="best")
        figure.savefig(path, dpi=150)


def _elevator(flight: FlownFlight) -> np.ndarray:
    return np.column_stack([flight.times, flight.states[:, _ELEVATOR]])
