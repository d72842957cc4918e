"""Residuals and coefficients against the variables that they may depend on."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from glider.report.plots.axes import few_ticks, finite, limit, thin
from glider.report.plots.style import COLORS, LABELS, VARIABLES, WIDTHS


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
    x: np.ndarray, y: np.ndarray, bins: int = 18
) -> tuple[np.ndarray, np.ndarray]:
    """Returns mean x and median y of equally wide bins that hold enough points."""
    centers, medians = binned_quantiles(x, y, (0.5,), bins)
    return centers, medians[0]


def binned_quantiles(
    x: np.ndarray,
    y: np.ndarray,
    quantiles: Sequence[float],
    bins: int = 18,
    fewest: int = 8,
) -> tuple[np.ndarray, np.ndarray]:
    """Returns mean x (m,) and quantiles of y (q, m) of equally wide bins.

    Bins that hold fewer than so many points are left out.
    """
    x, y = finite(x, y)
    full = []
    if x.size >= fewest:
        low, high = np.quantile(x, [0.005, 0.995])
        index = np.digitize(x, np.linspace(low, high, bins + 1)[1:-1])
        members = [index == b for b in range(bins)]
        full = [m for m in members if np.count_nonzero(m) >= fewest]
    columns = [np.quantile(y[m], quantiles) for m in full]
    return (
        np.array([np.mean(x[m]) for m in full]),
        np.array(columns).reshape(-1, len(quantiles)).T,
    )


def plot_coefficient(
    ax: Axes,
    alpha: np.ndarray,
    measured: np.ndarray,
    modelled: np.ndarray,
    flight: np.ndarray,
    model: str,
) -> None:
    """Draws a measured force or moment coefficient against the angle of attack.

    Each flight is a thin line, the middle two thirds of all flights' rows are a band,
    and the model is a line of medians.

    Args:
        ax: to draw into.
        alpha: (N,) [rad].
        measured: (N,).
        modelled: (N,).
        flight: (N,) number of the flight that each row is of.
        model: a key of COLORS.
    """
    degrees = np.degrees(alpha)
    color = COLORS["measured"]
    for number in np.unique(flight):
        rows = flight == number
        line = binned_quantiles(degrees[rows], measured[rows], (0.5,), 12, 2)
        ax.plot(line[0], line[1][0], color=color, lw=0.5, alpha=0.3)
    centers, band = binned_quantiles(degrees, measured, (1 / 6, 0.5, 5 / 6))
    ax.fill_between(centers, band[0], band[2], color=color, alpha=0.16, lw=0)
    ax.plot(centers, band[1], color=color, lw=3.0, label=LABELS["measured"])
    centers, medians = binned_median(degrees, modelled)
    ax.plot(centers, medians, color=COLORS[model], lw=1.8, label=LABELS[model])
    limit(ax.set_xlim, degrees, margin=0.04)
    few_ticks(ax, 6)
