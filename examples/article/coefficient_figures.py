"""Aerodynamic coefficients: measured, of the flat plate, and of a learned residual."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from axes import few_ticks, limit
from coefficients import corrected_coefficients
from glider.report.plots.binning import binned_quantiles, thin
from glider.report.plots.style import COLORS, STYLE, VARIABLES
from residual_study import WORDS, ResidualStudy

_SHADES = (COLORS["nominal"], COLORS["refitted"], COLORS["corrected"])
_LABELS = ("C_L", "C_D", "C_M [m]")


def plot_models(
    ax: Axes,
    alpha: np.ndarray,
    measured: np.ndarray,
    modelled: Mapping[str, np.ndarray],
) -> None:
    """Draws a coefficient against the angle of attack: points, and models' medians.

    Args:
        ax: to draw into.
        alpha: (N,) [rad].
        measured: (N,).
        modelled: label to (N,), the flat plate first, at most three.
    """
    label, factor = VARIABLES["alpha"]
    degrees = factor * alpha
    keep = thin(degrees, measured)
    ax.plot(degrees[keep], measured[keep], ".", color="k", ms=2.5, mew=0, alpha=0.35)
    ax.plot([], [], "o", color="k", ms=4, label="measured")
    for (name, values), shade in zip(modelled.items(), _SHADES, strict=False):
        centers, (medians,) = binned_quantiles(degrees, values, (0.5,), bins=30)
        ax.plot(centers, medians, color="white", lw=3.4)
        ax.plot(centers, medians, color=shade, lw=1.8, label=name)
    limit(ax.set_xlim, degrees, margin=0.03)
    limit(ax.set_ylim, measured)
    ax.set_xlabel(label)
    few_ticks(ax, 6)


def save_coefficients_figure(
    file: Path,
    alpha: np.ndarray,
    measured: np.ndarray,
    modelled: Mapping[str, np.ndarray],
) -> None:
    """Saves the three coefficients above, and what each model leaves of them below.

    Args:
        file: to write, of a kind that matplotlib knows by its name.
        alpha: (N,) [rad].
        measured: (N, 3) C_L, C_D, C_M.
        modelled: label to (N, 3), the flat plate first, at most three.
    """
    plate = next(iter(modelled.values()))
    with rc_context(STYLE):
        figure = Figure(figsize=(11.0, 6.6), layout="constrained")
        grid = figure.subplots(2, 3, sharex=True)
        for k, label in enumerate(_LABELS):
            top, bottom = grid[:, k]
            models = {name: values[:, k] for name, values in modelled.items()}
            plot_models(top, alpha, measured[:, k], models)
            over = {name: values - plate[:, k] for name, values in models.items()}
            plot_models(bottom, alpha, measured[:, k] - plate[:, k], over)
            top.set_ylabel(label)
            top.set_xlabel("")
            bottom.set_ylabel(f"{label} beyond the flat plate")
        handles, labels = grid[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=len(labels))
        figure.savefig(file, dpi=150)


def save_residual_figure(path: Path, study: ResidualStudy) -> None:
    """Saves the coefficients of the held-out flights, measured and of each model."""
    seen = study.held_out
    values = {
        WORDS[name]: corrected_coefficients(seen, model.residual)
        for name, model in study.models.items()
    }
    save_coefficients_figure(path, seen.variables["alpha"], seen.measured, values)
