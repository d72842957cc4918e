"""Figures of a report, drawn into axes: arrays and an `ax` in, nothing out.

One palette (Okabe and Ito's, which colour-blind readers can tell apart) and one
name for each model in all figures. No pyplot, so no global state and no window.
Angles are in degrees here, at the edge; everything else stays SI.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator, NullLocator

COLORS = {
    "measured": "#000000",
    "as_drawn": "#8A8A8A",
    "refitted": "#E08A00",
    "corrected": "#0072B2",
}
LABELS = {
    "measured": "measured",
    "as_drawn": "as drawn",
    "refitted": "refitted",
    "corrected": "corrected",
}
DASHES = {"as_drawn": (0, (4, 1.5)), "refitted": (0, (4, 1.2, 1, 1.2))}
"""Lines differ without colour too; those not named here are solid."""

STYLE: Any = {
    "axes.axisbelow": True,
    "axes.edgecolor": "#444444",
    "axes.grid": True,
    "axes.linewidth": 0.8,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlesize": 10,
    "axes.labelsize": 9.5,
    "font.family": "DejaVu Sans",  # Comes with matplotlib.
    "font.size": 9.5,
    "grid.color": "#E4E4E4",
    "grid.linewidth": 0.6,
    "legend.fontsize": 9,
    "legend.frameon": False,
    "text.usetex": False,
    "xtick.color": "#444444",
    "xtick.labelsize": 8.5,
    "ytick.color": "#444444",
    "ytick.labelsize": 8.5,
}
"""For `matplotlib.rc_context`, round the making of a figure."""

VARIABLES = {
    "x": ("x [m]", 1.0),
    "z": ("z [m]", 1.0),
    "t": ("time [s]", 1.0),
    "pitch": ("pitch θ, nose down > 0 [°]", math.degrees(1.0)),
    "V": ("airspeed V [m/s]", 1.0),
    "alpha": ("angle of attack α [°]", math.degrees(1.0)),
    "alphadot": ("rate of α [°/s]", math.degrees(1.0)),
    "pitchdot": ("pitch rate [°/s]", math.degrees(1.0)),
    "elevator": ("elevator, up > 0 [°]", math.degrees(1.0)),
    "elevator_rate": ("elevator rate [°/s]", math.degrees(1.0)),
}
"""Variable to its axis label and the factor from SI."""

_POINTS = 1500
"""A scatter shows no more than this; its medians take all points."""

_WIDTHS = {"as_drawn": 2.4, "refitted": 2.4}
"""Of lines; those not named here are thinner, and show what lies below."""

_PICKED = "#0072B2"
_CONFUSED = "#8CC3E6"
_OTHER = "#B5B5B5"


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
        keep = _thin(x, y)
        ax.plot(x[keep], y[keep], ".", color=COLORS[model], ms=3, alpha=0.3, mew=0)
    for x, y, model in zip(scaled, residuals, models, strict=True):
        centers, medians = binned_median(x, y)
        width = _WIDTHS.get(model, 1.6)
        ax.plot(centers, medians, color="white", lw=width + 1.6)
        ax.plot(centers, medians, color=COLORS[model], lw=width, label=LABELS[model])
    ax.axhline(0.0, color="#444444", lw=0.7)
    limit(ax.set_ylim, np.concatenate([np.ravel(r) for r in residuals]), around=0.0)
    limit(ax.set_xlim, np.concatenate(scaled))
    _few_ticks(ax, 7)
    ax.set_xlabel(label)


def binned_median(
    x: np.ndarray, y: np.ndarray, bins: int = 18, fewest: int = 8
) -> tuple[np.ndarray, np.ndarray]:
    """Returns mean x and median y of equally wide bins that hold enough points."""
    x, y = _finite(x, y)
    if x.size < fewest:
        return np.zeros(0), np.zeros(0)
    low, high = np.quantile(x, [0.005, 0.995])
    index = np.digitize(x, np.linspace(low, high, bins + 1)[1:-1])
    full = [b for b in range(bins) if np.count_nonzero(index == b) >= fewest]
    return (
        np.array([np.mean(x[index == b]) for b in full]),
        np.array([np.median(y[index == b]) for b in full]),
    )


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
    ticks = [10.0**p for p in range(1, math.ceil(math.log10(top)) + 1)]
    below = [-(10.0**p) for p in range(1, 9) if 10.0**p <= -bottom]
    step = math.ceil(len(ticks) / 6)
    ax.set_xticks(
        [*below[-1:], 0.0, *ticks[::step]],
        [f"{t:,.0f}" for t in (*below[-1:], 0.0, *ticks[::step])],
    )
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


def plot_paths(
    ax: Axes,
    measured: np.ndarray,
    flown: Mapping[str, np.ndarray],
    fitted: np.ndarray,
) -> None:
    """Draws one flight's path in the vertical plane.

    Args:
        ax: to draw into.
        measured: (n, 2 or more) x, z [m].
        flown: model to the same; a model that leaves the picture is cut off.
        fitted: (n,) whether the launch state was fitted on that row.
    """
    ax.plot(*measured[fitted, :2].T, color="#D9D9D9", lw=9, solid_capstyle="butt")
    ax.plot(*measured[:, :2].T, color=COLORS["measured"], lw=3.0, label="measured")
    for model, pose in flown.items():
        ax.plot(*pose[:, :2].T, **_line(model))
    limit(ax.set_xlim, measured[:, 0], margin=0.06, quantile=0.0)
    limit(ax.set_ylim, measured[:, 1], margin=0.35, quantile=0.0)
    _few_ticks(ax)


def plot_pitch(
    ax: Axes,
    time: np.ndarray,
    measured: np.ndarray,
    flown: Mapping[str, np.ndarray],
    fitted_until: float,
) -> None:
    """Draws one flight's pitch over time.

    Args:
        ax: to draw into.
        time: (n,) [s].
        measured: (n,) [rad].
        flown: model to the same; a model that leaves the picture is cut off.
        fitted_until: the launch state was fitted up to here [s].
    """
    _shade(ax, time, fitted_until)
    ax.plot(time, np.degrees(measured), color="k", lw=3.0, label="measured")
    for model, pitch in flown.items():
        ax.plot(time, np.degrees(pitch), **_line(model))
    limit(ax.set_ylim, np.degrees(measured), margin=0.35, quantile=0.0)
    ax.set_xlim(time[0], time[-1])
    _few_ticks(ax, 4)


def plot_distance(
    ax: Axes,
    time: np.ndarray,
    distance: Mapping[str, np.ndarray],
    fitted_until: float,
    noise: float,
) -> None:
    """Draws the distance of each model from the flight over time.

    Args:
        ax: to draw into.
        time: (n,) [s].
        distance: model to (n,) [m].
        fitted_until: the launch state was fitted up to here [s].
        noise: standard deviation of a measured coordinate [m].
    """
    _shade(ax, time, fitted_until)
    for model, d in distance.items():
        ax.plot(time, np.where(d > 0.0, d, np.nan), **_line(model))
    if math.isfinite(noise) and noise > 0.0:
        ax.axhline(noise, color="k", lw=0.9, ls=":")
    _log_scale(ax)
    d = np.concatenate([np.ravel(d) for d in distance.values()] or [np.zeros(0)])
    d = d[np.isfinite(d) & (d > 0.0)]
    if d.size:
        low, high = np.quantile(d, 0.02), min(d.max(), 100.0)
        if math.isfinite(noise) and noise > 0.0:
            low = min(max(low, 0.2 * noise), 0.5 * noise)
        ax.set_ylim(0.7 * low, 2.0 * max(high, low))
    ax.set_xlim(time[0], time[-1])
    ax.xaxis.set_major_locator(_ticks(4))


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
    keep = _thin(degrees, measured)
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
    _few_ticks(ax, 6)


def plot_errors(
    ax: Axes,
    names: Sequence[str],
    values: Mapping[str, Sequence[float]],
    noise: float = math.nan,
) -> None:
    """Draws errors of the models as groups of bars on a log scale.

    Args:
        ax: to draw into.
        names: of the errors, which have one unit.
        values: model to one error a name; NaN leaves a gap.
        noise: of the measurement in that unit, a dotted line; NaN for none.
    """
    finite = [v for row in values.values() for v in row if math.isfinite(v) and v > 0]
    floor = 10.0 ** math.floor(math.log10(min([*finite, *_positive(noise)], default=1)))
    floor *= 0.5
    width = 0.8 / max(len(values), 1)
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
                _short(value),
                (place, height),
                xytext=(0, 2),
                textcoords="offset points",
                ha="center",
                va="bottom",
                fontsize=8,
                bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.6},
            )
    if _positive(noise):
        ax.axhline(noise, color="k", lw=0.9, ls=":")
    _log_scale(ax)
    ax.set_ylim(floor, 4.0 * max(finite, default=1.0))
    ax.set_xticks(np.arange(len(names)), names)
    ax.set_xlim(-0.6, len(names) - 0.4)
    ax.tick_params(axis="x", length=0)
    ax.grid(False, axis="x")


def limit(
    set_limits: Callable[[float, float], object],
    values: np.ndarray,
    margin: float = 0.08,
    quantile: float = 0.004,
    around: float | None = None,
) -> None:
    """Sets an axis to where the points are; a few wild ones do not squash it.

    Args:
        set_limits: `ax.set_xlim` or `ax.set_ylim`.
        values: of the points.
        margin: added at both ends, relative to the range.
        quantile: of points that may lie outside at each end.
        around: a value that must lie inside.
    """
    values = values[np.isfinite(values)]
    if values.size == 0:
        return
    low, high = np.quantile(values, [quantile, 1.0 - quantile])
    if around is not None:
        low, high = min(low, around), max(high, around)
    pad = margin * (high - low) or 0.05 * abs(high) or 1.0
    set_limits(low - pad, high + pad)


def _line(model):
    return {
        "color": COLORS[model],
        "label": LABELS[model],
        "lw": _WIDTHS.get(model, 1.6),
        "ls": DASHES.get(model, "-"),
    }


def _shade(ax, time, until):
    ax.axvspan(time[0], until, color="#EDEDED", lw=0, zorder=0)


def _few_ticks(ax, count=5):
    ax.xaxis.set_major_locator(_ticks(count))
    ax.yaxis.set_major_locator(_ticks(5))


def _ticks(count):
    return MaxNLocator(count, steps=[1, 2, 5, 10])


def _log_scale(ax):
    ax.set_yscale("log")
    ax.yaxis.set_minor_locator(NullLocator())
    ax.yaxis.set_major_formatter(lambda value, _: f"{value:g}")


def _finite(x, y):
    keep = np.isfinite(x) & np.isfinite(y)
    return x[keep], y[keep]


def _thin(x, y):
    """Returns indices of at most _POINTS finite points, the same ones each time."""
    keep = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    if keep.size > _POINTS:
        keep = np.sort(np.random.default_rng(0).choice(keep, _POINTS, replace=False))
    return keep


def _short(value):
    """Returns two digits, without an exponent while that stays short."""
    if not math.isfinite(value):
        return "–"
    if 100.0 <= value < 1e5:
        return f"{value:.0f}"
    return f"{value:#.2g}".removesuffix(".")


def _or_lowest(value):
    return value if math.isfinite(value) else -math.inf


def _positive(value):
    return [value] if math.isfinite(value) and value > 0.0 else []
