"""The loop of learning: flights round by round, what they cost, how far they miss."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps, rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from axes import few_ticks, legend_beside, limit
from glider.planning.problem import Hook
from glider.report.plots.style import COLORS, RED, STYLE

WEIGHTS = RED
TRACED = COLORS["corrected"]
REACH = Hook().reach
ORACLE_RATIO = 1.2
"""Ratio of a miss to the oracle's up to which it is as good."""


def plot_rounds(ax: Axes, paths: Sequence[np.ndarray], wire: Sequence[float]) -> None:
    """Draws flights of successive rounds, from light to dark.

    Args:
        ax: to draw into.
        paths: of each round, (K, 2 or more) x, z [m].
        wire: (x, z) [m]; a ring shows the reach of the article's hook.
    """
    shades = colormaps["viridis_r"](np.linspace(0.1, 1.0, len(paths)))
    for k, (path, shade) in enumerate(zip(paths, shades, strict=True)):
        label = f"round {k}" if k in (0, len(paths) - 1) else None
        ax.plot(*path[:, :2].T, color=shade, lw=1.2, label=label)
    angle = np.linspace(0.0, 2.0 * np.pi, 60)
    ring = np.array(wire)[:, None] + REACH * np.array([np.cos(angle), np.sin(angle)])
    ax.plot(*ring, color="k", lw=1.0, label=f"{100 * REACH:.0f} cm of the wire")
    limit(ax.set_ylim, np.concatenate(paths)[:, 1], margin=0.15)
    ax.set_aspect("equal", adjustable="box")  # A ring is round.
    ax.set_xlabel("x [m]")
    ax.set_ylabel("z [m]")
    legend_beside(ax)
    few_ticks(ax)


def plot_progress(
    ax: Axes, curves: Mapping[str, Sequence[float]], words: str, launches: int
) -> None:
    """Draws numbers of each round over the flights that it had learned from.

    Args:
        ax: to draw into; its vertical axis is logarithmic.
        curves: label to a number for each round.
        words: of the vertical axis.
        launches: flights in a round.
    """
    for (label, values), color in zip(curves.items(), (WEIGHTS, TRACED), strict=False):
        flights = launches * np.arange(len(values))
        ax.plot(flights, values, "o-", color=color, ms=3.5, lw=1.4, label=label)
    _log_scale(ax)
    ax.set_xlabel("flights learned from")
    ax.set_ylabel(words)


def _log_scale(ax: Axes) -> None:
    """Scales like `axes.log_scale`, with ticks at 2 and 5 as well."""
    ax.set_yscale("log")
    ax.yaxis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
    for set_formatter in (ax.yaxis.set_major_formatter, ax.yaxis.set_minor_formatter):
        set_formatter(lambda value, _: f"{value:g}")


def save_learning_figure(
    file: Path,
    paths: Sequence[np.ndarray],
    figures: Mapping[str, Any],
    wire: Sequence[float] = (0.0, 0.0),
) -> None:
    """Saves the article's three figures of the loop, and the misses beside them.

    Args:
        file: where to.
        paths: flights of the weights' loop, one for each round.
        figures: "rbf" (with "weight_change") and "traced", both with "terminal_cost"
            and "miss_m" of each round, "oracle_miss_m" and "launches", the flights in a
            round.
        wire: (x, z) [m].
    """
    launches, changes = figures["launches"], figures["rbf"]["weight_change"]
    both = {"weights": figures["rbf"], "traced": figures["traced"]}
    oracle = 1000.0 * figures["oracle_miss_m"]
    with rc_context(STYLE):
        figure = Figure(figsize=(13.0, 6.6), layout="constrained")
        ((flights, cost), (change, miss)) = figure.subplots(2, 2)
        plot_rounds(flights, paths, wire)
        flights.set_title("flights while the weights are learned", loc="left")
        costs = {name: values["terminal_cost"] for name, values in both.items()}
        plot_progress(cost, costs, "terminal cost", launches)
        legend_beside(cost)
        learned = launches * np.arange(1, len(changes) + 1)
        change.plot(learned, changes, "o-", color=WEIGHTS, ms=3.5, lw=1.4)
        _log_scale(change)
        change.set_xlabel("flights learned from")
        change.set_ylabel("change of the weights")
        misses = {k: [1000.0 * m for m in v["miss_m"]] for k, v in both.items()}
        plot_progress(miss, misses, "median miss [mm]", launches)
        miss.axhspan(0.0, ORACLE_RATIO * oracle, color="k", alpha=0.08, lw=0.0)
        miss.axhline(oracle, color="k", ls=(0, (4, 2)), label="the truth is known")
        miss.axhline(1000.0 * REACH, color="#888888", lw=0.8)
        legend_beside(miss)
        figure.savefig(file, dpi=150)
