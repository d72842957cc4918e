"""Residuals and coefficients against the variables that they may depend on."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from glider.report.plots.axes import (
    few_ticks,
    finite,
    limit,
    thin,
)
from glider.report.plots.style import (
    COLORS,
    LABELS,
    VARIABLES,
    WIDTHS,
)


def plot_residual(
    ax: Axes,
    variable: str,
    values: Sequence[np.ndarray],
    residuals: Sequence[np.ndarray],
    models: Sequence[str],
) -> None:
    """Draws residuals of models against a variable, with their binned medians.

    Args:
        ax: to draw into.
        variable: a key of VARIABLES, or any other name.
        values: of the variable, one array (N,) a model [SI].
        residuals: one array (N,) a model.
        models: keys of COLORS, the last one on top.
    """
    label, factor = VARIABLES.get(variable, (variable.replace("_", " "), 1.0))
    scaled = [np.asarray(v) * factor for v in values]
    for x, y, model in zip(scaled, residuals, models, strict=True):
        keep = thin(x, y)
        ax.plot(x[keep], y[keep], ".", color=COLORS[model], ms=3, alpha=0.3, mew=0)
    for x, y, model in zip(scaled, residuals, models, strict=True):
        centers, medians = binned_median(x, y)
        width = WIDTHS.get(model, 1.6)
        ax.plot(centers, medians, color="white", lw=width + 1.6)
        ax.plot(centers, medians, color=COLORS[model], lw=width, label=LABELS[model])
    ax.axhline(0.0, color="#444444", lw=0.7)
    limit(ax.set_ylim, np.concatenate([np.ravel(r) for r in residuals]), around=0.0)
    limit(ax.set_xlim, np.concatenate(scaled))
    few_ticks(ax, 7)
    ax.set_xlabel(label)


def binned_median(
    x: np.ndarray, y: np.ndarray, bins: int = 18, fewest: int = 8
) -> tuple[np.ndarray, np.ndarray]:
    """Returns mean x and median y of equally wide bins that hold enough points."""
    x, y = finite(x, y)
    if x.size < fewest:
        return np.zeros(0), np.zeros(0)
    low, high = np.quantile(x, [0.005, 0.995])
    index = np.digitize(x, np.linspace(low, high, bins + 1)[1:-1])
    full = [b for b in range(bins) if np.count_nonzero(index == b) >= fewest]
    return (
        np.array([np.mean(x[index == b]) for b in full]),
        np.array([np.median(y[index == b]) for b in full]),
    )


def plot_coefficient(
    ax: Axes,
    alpha: np.ndarray,
    measured: np.ndarray,
    modelled: np.ndarray,
    model: str,
) -> None:
    """Draws a force or moment coefficient against the angle of attack.

    Args:
        ax: to draw into.
        alpha: (N,) [rad].
        measured: (N,).
        modelled: (N,).
        model: a key of COLORS.
    """
    degrees = np.degrees(alpha)
    keep = thin(degrees, measured)
    for values, name, size, opacity in (
        (measured, "measured", 3.0, 0.3),
        (modelled, model, 3.0, 0.55),
    ):
        ax.plot(
            degrees[keep],
            values[keep],
            ".",
            color=COLORS[name],
            ms=size,
            mew=0,
            alpha=opacity,
        )
        # A larger one for the legend.
        ax.plot([], [], "o", color=COLORS[name], ms=5, label=LABELS[name])
    limit(ax.set_xlim, degrees, margin=0.04)
    few_ticks(ax, 6)
