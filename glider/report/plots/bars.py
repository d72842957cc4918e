"""Evidence and errors as bars."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes

from glider.report.plots.axes import evidence_ticks, log_scale
from glider.report.plots.style import BLUE, COLORS, LABELS

_PICKED = BLUE
_CONFUSED = "#8CC3E6"
_OTHER = "#B5B5B5"


def plot_evidence(
    ax: Axes,
    evidence: Mapping[str, float],
    picked: Sequence[str] = (),
    confused: Sequence[str] = (),
) -> None:
    """Draws each candidate's evidence as a bar, the strongest on top.

    Args:
        ax: to draw into.
        evidence: candidate to log-likelihood gained [nats], NaN where it has none.
        picked: candidates that the model took.
        confused: candidates that the data cannot tell from those.
    """
    names = sorted(evidence, key=lambda k: _or_lowest(evidence[k]), reverse=True)
    colors = [
        _PICKED if n in picked else _CONFUSED if n in confused else _OTHER
        for n in names
    ]
    values = np.array([evidence[n] for n in names], dtype=float)
    bars = np.where(np.isfinite(values), values, 0.0)
    rows = np.arange(len(names))
    ax.barh(rows, bars, height=0.72, color=colors)
    ax.axvline(0.0, color="#444444", lw=0.8)
    ax.set_xscale("symlog", linthresh=10.0, linscale=0.6)
    for row, (name, value) in enumerate(zip(names, values, strict=True)):
        text = f"{value:,.0f}" if abs(value) >= 10.0 else f"{value:.1f}"
        ax.annotate(
            text if math.isfinite(value) else "none",
            (max(bars[row], 0.0), row),
            xytext=(4, 0),
            textcoords="offset points",
            va="center",
            fontsize=8.5,
            fontweight="bold" if name in picked else "normal",
        )
    ax.set_yticks(rows, [n.replace("_", " ") for n in names])
    ax.set_ylim(len(names) - 0.4, -0.6)
    top = max(bars.max(initial=0.0), 100.0)
    bottom = bars.min(initial=0.0)
    ax.set_xlim(bottom * 2.0 if bottom < 0.0 else 0.0, top * 4.0)
    ticks = evidence_ticks(bottom, top)
    ax.set_xticks(ticks, [f"{t:,.0f}" for t in ticks])
    ax.minorticks_off()
    ax.grid(False, axis="y")
    ax.tick_params(axis="y", length=0)
    ax.set_xlabel("evidence when tried alone [nats], linear below 10")
    for color, label in (
        (_PICKED, "in the corrected model"),
        (_CONFUSED, "cannot be told from it"),
        (_OTHER, "not taken"),
    ):
        if color in colors:
            ax.barh(0, 0, color=color, label=label)
    ax.legend(loc="lower right")


def plot_errors(
    ax: Axes,
    names: Sequence[str],
    values: Mapping[str, Sequence[float]],
    noise: Sequence[float] = (),
) -> None:
    """Draws errors of the models as groups of bars on a log scale.

    Args:
        ax: to draw into.
        names: of the errors, which have one unit.
        values: model to one error a name; NaN leaves a gap.
        noise: of the measurement in that unit, a dotted line a name; NaN for none.
    """
    finite = [v for row in values.values() for v in row if math.isfinite(v) and v > 0]
    levels = {i: v for i, v in enumerate(noise) if math.isfinite(v) and v > 0.0}
    lowest = min([*finite, *levels.values()], default=1.0)
    floor = 10.0 ** math.floor(math.log10(lowest))
    floor *= 0.5
    width = 0.8 / max(len(values), 1)
    size = 8.0 if len(values) <= 3 else 6.0  # Numbers side by side have room.
    for i, (model, row) in enumerate(values.items()):
        places = np.arange(len(names)) + (i - (len(values) - 1) / 2) * width
        heights = np.array([v if math.isfinite(v) and v > 0 else floor for v in row])
        ax.bar(
            places,
            heights - floor,
            0.92 * width,
            bottom=floor,
            color=COLORS[model],
            label=LABELS[model],
        )
        for place, height, value in zip(places, heights, row, strict=True):
            ax.annotate(
                short(value),
                (place, height),
                xytext=(0, 2),
                textcoords="offset points",
                ha="center",
                va="bottom",
                fontsize=size,
                bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.6},
            )
    for i, level in levels.items():
        ax.hlines(level, i - 0.45, i + 0.45, color="k", lw=0.9, ls=":")
    log_scale(ax)
    ax.set_ylim(floor, 4.0 * max(finite, default=1.0))
    ax.set_xticks(np.arange(len(names)), names)
    ax.set_xlim(-0.6, len(names) - 0.4)
    ax.tick_params(axis="x", length=0)
    ax.grid(False, axis="x")


def short(value: float) -> str:
    """Returns two digits, without an exponent while that stays short."""
    if not math.isfinite(value):
        return "–"
    if 100.0 <= value < 1e5:
        return f"{value:.0f}"
    return f"{value:#.2g}".removesuffix(".")


def _or_lowest(value):
    return value if math.isfinite(value) else -math.inf
