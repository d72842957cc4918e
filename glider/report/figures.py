"""The figures of a report, from what closing the loop found."""

import io
from collections.abc import Callable

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from glider.report.error_table import COLUMNS, columns_of, noise_floor
from glider.report.figure_data import (
    COEFFICIENTS,
    ERROR_PANELS,
    RESIDUALS,
    has_coefficients,
    residual_tables,
    residual_variables,
    shown_flights,
)
from glider.report.finding_figures import (
    WIDTH,
    draw_carried,
    draw_curves,
    draw_evidence,
    draw_folds,
    draw_spreads,
)
from glider.report.flight_errors import bounded, distance
from glider.report.plots.axes import legend, limit
from glider.report.plots.bars import plot_errors
from glider.report.plots.flights import plot_distance, plot_paths, plot_pitch
from glider.report.plots.residuals import plot_coefficient, plot_residual
from glider.report.plots.style import LABELS, STYLE, VARIABLES
from glider.sysid.result import Result

DPI = 160


def make_figures(result: Result) -> dict[str, bytes]:
    """Returns figure name to PNG; what there is nothing to show of is left out."""
    figures = {}
    with matplotlib.rc_context(STYLE):
        for name, draw in FIGURES.items():
            figure = draw(result)
            if figure is not None:
                FigureCanvasAgg(figure)
                layout = figure.get_layout_engine()
                if layout is not None:  # Once is enough, and saves a draw.
                    layout.execute(figure)
                    figure.set_layout_engine("none")
                buffer = io.BytesIO()
                figure.savefig(buffer, format="png", dpi=DPI)
                figures[name] = buffer.getvalue()
    return figures


def _draw_residual(result: Result) -> Figure | None:
    tables = residual_tables(result)
    variables = residual_variables(result)
    if not variables:
        return None
    figure = Figure(figsize=(WIDTH, 7.0), layout="constrained")
    grid = figure.subplots(3, len(variables), sharex="col", squeeze=False)
    for row, (label, unit) in enumerate(RESIDUALS.items()):
        for ax, name in zip(grid[row], variables, strict=True):
            plot_residual(
                ax,
                name,
                [table.variables[name] for table in tables.values()],
                [table.residual[:, row] for table in tables.values()],
                list(tables),
            )
            if row < 2:
                ax.set_xlabel("")
        grid[row][0].set_ylabel(f"{label} [{unit.name}]")
    figure.align_ylabels(grid[:, 0])
    legend(figure, grid[0][0])
    return figure


def _draw_held_out(result: Result) -> Figure | None:
    flights = shown_flights(result)
    if not flights:
        return None
    width = min(WIDTH, max(0.7 * WIDTH, 1.0 + 3.5 * len(flights)))
    figure = Figure(figsize=(width, 7.4), layout="constrained")
    grid = figure.subplots(3, len(flights), squeeze=False)
    for column, flight in zip(grid.T, flights, strict=True):
        flown = {m: bounded(flight.flown[m]) for m in COLUMNS if m in flight.flown}
        plot_paths(
            column[0], flight.measured, flown, flight.time <= flight.fitted_until
        )
        column[0].set_title(flight.name.removesuffix(".csv"))
        column[0].set_xlabel("x [m]")
        column[1].sharex(column[2])
        column[1].tick_params(labelbottom=False)
        plot_pitch(
            column[1],
            flight.time,
            flight.measured[:, 2],
            {m: pose[:, 2] for m, pose in flown.items()},
            flight.fitted_until,
        )
        plot_distance(
            column[2],
            flight.time,
            {m: distance(pose, flight.measured) for m, pose in flown.items()},
            flight.fitted_until,
            result.noise_position_m,
        )
        column[2].set_xlabel("time [s]")
    grid[0][0].set_ylabel("z [m]")
    grid[1][0].set_ylabel("pitch, nose down > 0 [°]")
    grid[2][0].set_ylabel("distance from the flight [m]")
    figure.align_ylabels(grid[:, 0])
    legend(figure, grid[0][0])
    return figure


def _draw_coefficients(result: Result) -> Figure | None:
    if not has_coefficients(result):
        return None
    tables = residual_tables(result)
    figure = Figure(figsize=(WIDTH, 6.0), layout="constrained")
    grid = figure.subplots(2, 3, sharex=True, sharey="col")
    for axes, (model, table) in zip(grid, tables.items(), strict=True):
        for ax, (name, label) in zip(axes, COEFFICIENTS.items(), strict=True):
            plot_coefficient(
                ax,
                table.variables["alpha"],
                table.coefficients[name],
                table.modelled[name],
                table.flight,
                model,
            )
            unit = " [m]" if name == "c_moment" else ""
            ax.set_title(f"${label}${unit}, {LABELS[model]}")
    for ax, name in zip(grid[0], COEFFICIENTS, strict=True):
        everything = [
            c[name] for t in tables.values() for c in (t.coefficients, t.modelled)
        ]
        limit(ax.set_ylim, np.concatenate(everything))
    for ax in grid[1]:
        ax.set_xlabel(VARIABLES["alpha"][0])
    legend(figure, *grid[:, 0])
    return figure


def _draw_errors(result: Result) -> Figure | None:
    errors = {m: e for m in columns_of(result) if (e := result.errors[m]) is not None}
    if not errors:
        return None
    figure = Figure(figsize=(WIDTH, 3.6), layout="constrained")
    axes = figure.subplots(
        1, 4, width_ratios=[len(panel.fields) + 0.25 for panel in ERROR_PANELS]
    )
    for ax, panel in zip(axes, ERROR_PANELS, strict=True):
        size = panel.unit.size
        plot_errors(
            ax,
            list(panel.fields.values()),
            {
                m: [bounded(getattr(e, f)) / size for f in panel.fields]
                for m, e in errors.items()
            },
            [noise_floor(result, f) / size for f in panel.fields],
        )
        ax.set_title(f"{panel.title} [{panel.unit.name}]")
    legend(figure, axes[0])
    return figure


FIGURES: dict[str, Callable[[Result], Figure | None]] = {
    "errors": _draw_errors,
    "curves": draw_curves,
    "carried": draw_carried,
    "coefficients": _draw_coefficients,
    "evidence": draw_evidence,
    "folds": draw_folds,
    "held_out": _draw_held_out,
    "spreads": draw_spreads,
    "residual": _draw_residual,
}
"""Function that makes each figure, by file name."""
