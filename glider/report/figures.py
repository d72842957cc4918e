"""The figures of a report, from what closing the loop found."""

import io
import math
from collections.abc import Callable

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from glider.report.error_table import (
    COLUMNS,
    baseline,
    columns_of,
    noise_floor,
)
from glider.report.finding_figures import (
    WIDTH,
    draw_curves,
    draw_evidence,
    draw_folds,
    draw_spreads,
)
from glider.report.flight_errors import (
    bounded,
    distance,
    rank_flights,
)
from glider.report.plots.axes import (
    legend,
    limit,
)
from glider.report.plots.bars import plot_errors
from glider.report.plots.flights import (
    plot_distance,
    plot_paths,
    plot_pitch,
)
from glider.report.plots.residuals import (
    plot_coefficient,
    plot_residual,
)
from glider.report.plots.style import (
    LABELS,
    STYLE,
    VARIABLES,
)
from glider.sysid.result import (
    ResidualTable,
    Result,
)

MOST_FLIGHTS = 4
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
    before, after = result.residual_before, result.residual_after
    variables = _pick_variables(result)
    if not variables:
        return None
    figure = Figure(figsize=(WIDTH, 7.0), layout="constrained")
    grid = figure.subplots(3, len(variables), sharex="col", squeeze=False)
    labels = ("along the wing [m/s²]", "normal to it [m/s²]", "in pitch [rad/s²]")
    for row, label in enumerate(labels):
        for ax, name in zip(grid[row], variables, strict=True):
            plot_residual(
                ax,
                name,
                [before.variables[name], after.variables[name]],
                [before.residual[:, row], after.residual[:, row]],
                [baseline(result), "corrected"],
            )
            if row < 2:
                ax.set_xlabel("")
        grid[row][0].set_ylabel(label)
    figure.align_ylabels(grid[:, 0])
    legend(figure, grid[0][0])
    return figure


def _draw_held_out(result: Result) -> Figure | None:
    flights = _pick_flights(result)
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
    tables = {
        baseline(result): result.residual_before,
        "corrected": result.residual_after,
    }
    names = {"c_lift": "$C_L$", "c_drag": "$C_D$", "c_moment": "$C_M$ [m]"}
    if not all(
        "alpha" in t.variables and names.keys() <= t.coefficients.keys()
        for t in tables.values()
    ):
        return None
    figure = Figure(figsize=(WIDTH, 6.0), layout="constrained")
    grid = figure.subplots(2, 3, sharex=True, sharey="col")
    for axes, (model, table) in zip(grid, tables.items(), strict=True):
        for ax, (name, label) in zip(axes, names.items(), strict=True):
            plot_coefficient(
                ax,
                table.variables["alpha"],
                table.coefficients[name],
                table.modelled[name],
                table.flight,
                model,
            )
            ax.set_title(f"{label}, {LABELS[model]}")
    for ax, name in zip(grid[0], names, strict=True):
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
    panels = (
        ("acceleration [m/s²]", {"tangential": "along wing", "normal": "normal"}, 1.0),
        ("acceleration [rad/s²]", {"pitch": "in pitch"}, 1.0),
        (
            "position [mm]",
            {
                "position_rms_m": "RMS",
                "position_end_m": "at the end",
                "measured_pitch_position_rms_m": "measured\npitch, RMS",
            },
            1e3,
        ),
        ("pitch [°]", {"pitch_rms_rad": "RMS"}, math.degrees(1.0)),
    )
    noise = (
        math.nan,
        math.nan,
        1e3 * noise_floor(result, "position_rms_m"),
        math.degrees(noise_floor(result, "pitch_rms_rad")),
    )
    axes = figure.subplots(
        1, 4, width_ratios=[len(fields) + 0.25 for _, fields, _ in panels]
    )
    for ax, (label, fields, factor), level in zip(axes, panels, noise, strict=True):
        plot_errors(
            ax,
            list(fields.values()),
            {
                m: [factor * bounded(getattr(e, f)) for f in fields]
                for m, e in errors.items()
            },
            level,
        )
        ax.set_title(label)
    legend(figure, axes[0])
    return figure


FIGURES: dict[str, Callable[[Result], Figure | None]] = {
    "errors": _draw_errors,
    "curves": draw_curves,
    "coefficients": _draw_coefficients,
    "evidence": draw_evidence,
    "folds": draw_folds,
    "held_out": _draw_held_out,
    "spreads": draw_spreads,
    "residual": _draw_residual,
}
"""Function that makes each figure, by file name."""


def _pick_variables(result):
    """Returns up to three variables, those of the strongest effects first."""
    wanted = [name for e in result.effects for name in e.depends_on]
    if len(set(wanted)) < 2:
        wanted += ["alpha", "V"]
    tables = (result.residual_before, result.residual_after)
    there = [n for n in dict.fromkeys(wanted) if all(_varies(t, n) for t in tables)]
    return there[: max(2, min(3, len(there)))]


def _varies(table: ResidualTable, name: str) -> bool:
    values = table.variables.get(name, np.zeros(0))
    values = values[np.isfinite(values)]
    return values.size > 0 and float(np.ptp(values)) > 0.0


def _pick_flights(result):
    """Returns up to four held-out flights, from the best corrected to the worst."""
    ranked = rank_flights(result)
    count = min(MOST_FLIGHTS, len(ranked))
    ranks = np.linspace(0, len(ranked) - 1, count).round().astype(int)
    return [ranked[i] for i in ranks]
