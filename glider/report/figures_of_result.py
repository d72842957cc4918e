"""All figures of a report, by name."""

from collections.abc import Callable

from glider.report import flight_figures, model_figures
from glider.report.plots.figure import Figure
from glider.sysid.result import Result

FIGURES: dict[str, Callable[[Result], Figure | None]] = {
    "errors": model_figures.errors_figure,
    "curves": model_figures.curves_figure,
    "carried": model_figures.carried_figure,
    "coefficients": model_figures.coefficients_figure,
    "evidence": model_figures.evidence_figure,
    "folds": flight_figures.folds_figure,
    "held_out": flight_figures.held_out_figure,
    "spreads": flight_figures.spreads_figure,
    "residual": model_figures.residual_figure,
}
"""Function that makes each figure, by the name of its file."""


def make_figures(result: Result) -> dict[str, Figure]:
    """Name to figure; those with nothing to show are omitted."""
    figures = {name: make(result) for name, make in FIGURES.items()}
    return {name: figure for name, figure in figures.items() if figure is not None}
