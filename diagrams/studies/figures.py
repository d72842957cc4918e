"""Figures of what studies found."""

from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from diagrams.studies.perch_study import PerchStudy
from diagrams.studies.rehearsal import Rehearsal
from diagrams.studies.sampled import Comparison
from glider.physics.state import ELEVATOR
from glider.report.plots.axes import legend_beside
from glider.report.plots.style import STYLE
from glider.simulation.flights import FlownFlight
from glider.studies.basis.basis_report import scores_of
from glider.studies.basis.basis_study import BasisStudy
from glider.studies.coefficients import corrected_coefficients
from glider.studies.learning_study import LearningStudy
from glider.studies.plots.basis import save_exercise_figure
from glider.studies.plots.coefficients import save_coefficients_figure
from glider.studies.plots.learning import save_learning_figure
from glider.studies.plots.perching import (
    AFTER,
    BEFORE,
    plot_commands,
    plot_misses,
    plot_perches,
)
from glider.studies.plots.sampling import save_sampling_figure
from glider.studies.residual_study import WORDS, ResidualStudy
from glider.studies.searches import Searches


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


def save_searches_figure(path: Path, searches: Searches, flown: Comparison) -> None:
    """Saves costs, the flights that the first searches drew, and the comparison."""
    drawn = {}
    for name, kept in searches.drawn.items():
        samples = {k: searches.fly(tried) for k, tried in kept.items()}
        drawn[name] = samples, searches.plans[name][0].states
    save_sampling_figure(
        path,
        searches.histories(),
        drawn,
        flown.plan.states,
        [flight.states for flight in flown.replanned],
        [flight.states for flight in flown.replayed],
    )


def save_residual_figure(path: Path, study: ResidualStudy) -> None:
    """Saves the coefficients of the held-out flights, measured and of each model."""
    seen = study.held_out
    values = {
        WORDS[name]: corrected_coefficients(seen, model.field)
        for name, model in study.models.items()
    }
    save_coefficients_figure(path, seen.variables["alpha"], seen.measured, values)


def save_learning_study(path: Path, study: LearningStudy) -> None:
    """Saves the rounds of learning: flights of the weights' loop, costs, misses."""
    paths = [turn.flights[0].states for turn in study.weights]
    save_learning_figure(path, paths, study.key_figures())


def save_basis_figure(path: Path, study: BasisStudy) -> None:
    """Saves the scores and the held-out flight of the exercise."""
    held_out = study.exercise.held_out
    times, measured = held_out.times, held_out.states[0]
    save_exercise_figure(path, scores_of(study.fits), times, measured, study.flown)


def _elevator(flight: FlownFlight) -> np.ndarray:
    return np.column_stack([flight.times, flight.states[:, ELEVATOR]])
