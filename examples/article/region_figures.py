"""Regions of attraction in the plane."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from glider.report.plots.axes import few_ticks, legend_beside
from glider.report.plots.style import BLUE, GREEN, ORANGE, STYLE

_COLORS = (ORANGE, GREEN, BLUE)


def save_regions_figure(
    path: Path, truth: np.ndarray, proved: Mapping[str, np.ndarray]
) -> None:
    """Saves closed curves: the true region's boundary and those of proved ones.

    Args:
        path: of the picture.
        truth: (2, K).
        proved: label to (2, K).
    """
    with rc_context(STYLE):
        figure = Figure(figsize=(8.5, 6.5), layout="constrained")
        ax = figure.subplots()
        ax.fill(*truth, color="#EDEDED", lw=0)
        ax.plot(*_closed(truth), color="k", lw=1.8, label="limit cycle, simulated")
        for (label, curve), color in zip(proved.items(), _COLORS, strict=False):
            ax.plot(*_closed(curve), color=color, lw=1.6, label=label)
        ax.set_aspect("equal", adjustable="datalim")
        ax.set_xlabel("x₁")
        ax.set_ylabel("x₂")
        legend_beside(ax)
        few_ticks(ax)
        figure.savefig(path, dpi=150)


def _closed(curve: np.ndarray) -> np.ndarray:
    return np.column_stack([curve, curve[:, 0]])
