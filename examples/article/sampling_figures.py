"""Searches that sample: their costs, and the flights that they draw."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib import colormaps, rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from axes import few_ticks, legend_beside, log_scale
from diagrams.programs.program import plot_perches
from glider.report.plots.style import BLUE, GREEN, RED, STYLE
from sampled import Comparison
from searches import Searches

_COLORS = (BLUE, RED, GREEN)


def plot_costs(ax: Axes, costs: Mapping[str, np.ndarray]) -> None:
    """Draws cost histories, for each method the median over seeds and the range.

    Args:
        ax: to draw into.
        costs: method to (seeds, iterations + 1).
    """
    for (name, runs), color in zip(costs.items(), _COLORS, strict=False):
        iterations = np.arange(runs.shape[1])
        low, high = np.min(runs, axis=0), np.max(runs, axis=0)
        ax.fill_between(iterations, low, high, color=color, alpha=0.2, lw=0)
        median = np.median(runs, axis=0)
        label = f"{name}, {len(runs)} seeds: {median[-1]:.1f} at the end"
        ax.plot(iterations, median, color=color, label=label)
    log_scale(ax)
    ax.set_xlabel("iteration")
    ax.set_ylabel("cost of the mean")
    legend_beside(ax)


def plot_samples(ax: Axes, drawn: Mapping[int, np.ndarray], found: np.ndarray) -> None:
    """Draws the paths of sampled flights, one colour an iteration.

    Args:
        ax: to draw into.
        drawn: number of the iteration to (B, N + 1, 2 or more) x, z [m].
        found: (N + 1, 2 or more) of the sequence that was found.
    """
    shades = colormaps["viridis"](np.linspace(0.9, 0.0, len(drawn)))
    for (iteration, paths), shade in zip(drawn.items(), shades, strict=True):
        for k, path in enumerate(paths):
            label = f"iteration {iteration}" if k == 0 else None
            ax.plot(*path[:, :2].T, color=shade, lw=0.6, alpha=0.6, label=label)
    ax.plot(*found[:, :2].T, color="#D55E00", lw=1.8, label="found")
    ax.plot(0.0, 0.0, "o", color="k", ms=5)
    ax.set_aspect("equal", adjustable="datalim")
    ax.set_xlabel("x [m]")
    ax.set_ylabel("z [m]")
    for handle in legend_beside(ax).get_lines():
        handle.set_linewidth(2.0)
    few_ticks(ax)


def save_searches_figure(path: Path, searches: Searches, flown: Comparison) -> None:
    """Saves costs, flights that the first searches drew, and the comparison in flight.

    Args:
        path: of the picture.
        searches: from many seeds.
        flown: the plan replayed, tracked and replanned by sampling.
    """
    with rc_context(STYLE):
        figure = Figure(figsize=(9.5, 10.0), layout="constrained")
        top, middle, bottom = figure.subfigures(
            3, 1, height_ratios=[3, 3.4, 3], squeeze=False
        ).ravel()
        plot_costs(top.add_subplot(), searches.histories())
        for k, (name, kept) in enumerate(searches.drawn.items()):
            samples = {k: searches.fly(tried) for k, tried in kept.items()}
            ax = middle.add_subplot(1, len(searches.drawn), k + 1)
            plot_samples(ax, samples, searches.plans[name][0].states)
            ax.set_title(f"{name}: sampled flights", loc="left")
        ax = bottom.add_subplot()
        plot_perches(ax, flown.plan, flown.replanned, flown.replayed)
        ax.set_title("receding horizon: replans 50 times a second", loc="left")
        figure.savefig(path, dpi=150)
