"""All figures of a report, by name."""

from collections.abc import Callable

from glider.report.flight_figures import folds_figure, held_out_figure, spreads_figure
from glider.report.model_figures import (
    carried_figure,
    coefficients_figure,
    curves_figure,
    errors_figure,
    evidence_figure,
    residual_figure,
)
from glider.report.plots.figure import Figure
from glider.sysid.result import Result

FIGURES: dict[str, Callable[[Result], Figure | None]] = {
    "errors": errors_figure,
    "curves": curves_figure,
    "carried": carried_figure,
    "coefficients": coefficients_figure,
    "evidence": evidence_figure,
    "folds": folds_figure,
    "held_out": held_out_figure,
    "spreads": spreads_figure,
    "residual": residual_figure,
}
"""Function that makes each figure, by the name of its file."""


def make_figures(result: Result) -> dict[str, Figure]:
    """Name to figure; those with nothing to show are omitted."""
    figures = {name: make(result) for name, make in FIGURES.items()}
    return {name: figure for name, figure in figures.items() if figure is not None}
