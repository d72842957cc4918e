"""Figures of what studies found."""

from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from diagrams.perch_plots import AFTER, BEFORE, plot_commands, plot_misses, plot_perches
from diagrams.studies.perch_study import PerchStudy
from diagrams.studies.rehearsal import Rehearsal
from glider.physics.state import ELEVATOR
from glider.report.plots.axes import legend_beside
from glider.report.plots.style import STYLE
from glider.simulation.flown_flights import FlownFlight


def save_perch_figure(path: Path, study: PerchStudy) -> None:
    """Saves the paths and the elevator of a plan and its flights."""
    plan, flights = study.plan, study.flights
    with rc_context(STYLE):
        figure = Figure(figsize=(9.5, 5.6), layout="constrained")
        top, bottom = figure.subplots(2, 1, height_ratios=[3, 2])
        plot_perches(
            top,
            plan.states,
            [flight.states for flight in flights],
            [flight.states for flight in study.blind],
        )
        elevators = [_elevator(flight) for flight in flights]
        plot_commands(bottom, plan.times, plan.states[:, ELEVATOR], elevators)
        figure.savefig(path, dpi=150)


def save_rehearsals_figure(path: Path, before: Rehearsal, after: Rehearsal) -> None:
    """Saves the paths and the misses of two rehearsals of one glider."""
    with rc_context(STYLE):
        figure = Figure(figsize=(9.5, 7.0), layout="constrained")
        axes = figure.subplots(3, 1)
        for ax, rehearsal, name, color in (
            (axes[0], before, "nominal", BEFORE),
            (axes[1], after, "corrected", AFTER),
        ):
            paths = [flight.states for flight in rehearsal.flights]
            plot_perches(ax, rehearsal.plan.states, paths, color=color)
            ax.set_title(f"planned with the {name} model", loc="left")
            plot_misses(axes[2], rehearsal.flights.misses, f"planned {name}", color)
        legend_beside(axes[2])
        figure.savefig(path, dpi=150)


def _elevator(flight: FlownFlight) -> np.ndarray:
    return np.column_stack([flight.times, flight.states[:, ELEVATOR]])
