"""Figures as pictures, drawn by matplotlib without pyplot: no global state, no window.

Axes are placed by sizes of letters instead of a layout engine, which draws all twice.
"""

import io
import math
import re
from collections.abc import Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure as Picture
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import offset_copy

from glider.report.plots import figure as spec
from glider.report.plots.style import COLORS, DASHES, FRAME, GRID, STYLE

WIDTH = 10.0
"""Of a picture [inch]."""

DPI = 110

_PIXELS = 92.0
"""Of a page, to an inch."""

_LETTER, _LINE = 0.072, 0.17
"""Width of a letter and height of a line [inch]."""


def to_png(figure: spec.Figure, dpi: float = DPI) -> bytes:
    """Draws a figure as a PNG file."""
    with matplotlib.rc_context(STYLE):
        picture = draw(figure)
        buffer = io.BytesIO()
        FigureCanvasAgg(picture)
        picture.savefig(buffer, format="png", dpi=dpi, pil_kwargs={"compress_level": 1})
    return buffer.getvalue()


def draw(figure: spec.Figure, width: float = WIDTH) -> Picture:
    """Draws a figure; its style is that of the caller's `rc_context`.

    Args:
        figure: its shown panels are drawn, row by row.
        width: of the picture [inch].
    """
    panels = figure.shown
    columns = min(figure.columns, len(panels))
    rows = [panels[i : i + columns] for i in range(0, len(panels), columns)]
    legend = _legend_rows(figure, width)
    top = _LINE * len(legend) * 1.2 + 0.06
    heights = [max(panel.height for panel in row) / _PIXELS for row in rows]
    picture = Picture(figsize=(width, top + sum(heights)))
    whole = picture.get_figheight()
    edge = whole - top
    for row, height in zip(rows, heights, strict=True):
        shares = [panel.share for panel in row] + [1.0] * (columns - len(row))
        starts = width * np.append(0.0, np.cumsum(shares)) / sum(shares)
        for panel, start, end in zip(row, starts, starts[1:], strict=False):
            left, below, above = _margins(panel)
            box = (
                start + left,
                edge - height + below,
                end - start - left - 0.12,
                height - below - above,
            )
            x, y, wide, high = box
            place = (x / width, y / whole, wide / width, high / whole)
            ax = picture.add_axes(place)
            _draw_panel(ax, panel, box[2])
        edge -= height
    for k, keys in enumerate(legend):
        anchor = (0.5, 1.0 - 1.2 * _LINE * k / whole)
        picture.legend(
            handles=[_entry(figure, key) for key in keys],
            loc="upper center",
            bbox_to_anchor=anchor,
            ncols=len(keys),
            borderpad=0.2,
        )
    return picture


def _margins(panel: spec.Panel) -> tuple[float, float, float]:
    """Space left of, below and above a panel for its texts [inch]."""
    longest = 6 if panel.y.ticks is None else max(map(len, panel.y.ticks.values()))
    left = 0.12 + longest * _LETTER + (_LINE if panel.y.label else 0.0)
    lines = 1
    if panel.x.ticks is not None:
        lines += max(label.count("\n") for label in panel.x.ticks.values())
    below = 0.12 + lines * _LINE + (1.1 * _LINE if panel.x.label else 0.0)
    return left, below, 1.7 * _LINE if panel.title else 0.08


def _legend_rows(figure: spec.Figure, width: float) -> list[list[str]]:
    """Keys of the legend, row by row, as many as fit."""
    rows: list[list[str]] = [[]]
    free = width
    for key, label in figure.keys.items():
        needed = len(label) * _LETTER + 0.7
        if needed > free and rows[-1]:
            rows.append([])
            free = width
        rows[-1].append(key)
        free -= needed
    return [row for row in rows if row]


def _entry(figure: spec.Figure, key: str) -> Any:
    """Handle of a key of the legend, as it is drawn."""
    color, label = COLORS[key], _escape(figure.keys[key])
    marks = [
        m for panel in figure.shown for m in panel.marks if getattr(m, "key", "") == key
    ]
    if any(isinstance(m, spec.Bars) for m in marks):
        return Patch(color=color, label=label)
    if marks and all(isinstance(m, (spec.Ground, spec.Points)) for m in marks):
        alpha = min(getattr(m, "opacity", 0.14) for m in marks)
        if any(isinstance(m, spec.Ground) for m in marks):
            return Patch(color=color, alpha=max(alpha, 0.2), lw=0, label=label)
    widest = max((m.line_width for m in marks if isinstance(m, spec.Line)), default=4.0)
    return matplotlib.lines.Line2D(
        [], [], color=color, lw=widest, ls=_dash(key), label=label
    )


def _dash(key: str) -> Any:
    return (0, DASHES[key]) if key in DASHES else "-"


def _escape(text: str) -> str:
    """Plain text for matplotlib, but for symbols: "$C_n$"."""
    return re.sub(r"\\\$(C_\w)\\\$", r"$\1$", text.replace("$", r"\$"))


def _draw_panel(ax: Axes, panel: spec.Panel, width: float) -> None:
    """Draws a panel; axes by hand, for matplotlib's own take longer than all marks."""
    ax.set_axis_off()
    for name, axis in (("x", panel.x), ("y", panel.y)):
        if axis.is_log:
            getattr(ax, f"set_{name}scale")("log")
        if axis.range is not None:
            getattr(ax, f"set_{name}lim")(*axis.range)
    ax.margins(x=0.02, y=0.15)
    has_cloud = any(isinstance(m, spec.Points) and m.size < 5 for m in panel.marks)
    for mark in panel.marks:
        _draw_mark(ax, mark, has_cloud)
    xlim, ylim = ax.get_xlim(), ax.get_ylim()
    places, labels = _ticks(panel.x, xlim, max(3, min(7, int(width / 0.5))))
    heights, texts = _ticks(panel.y, ylim, 5)
    grid = [[(x, y) for y in ylim] for x in places if panel.x.has_grid]
    grid += [[(x, y) for x in xlim] for y in heights if panel.y.has_grid]
    ax.add_collection(
        LineCollection(grid, colors=GRID, lw=0.6, zorder=0), autolim=False
    )
    edges = [[(xlim[0], ylim[1]), (xlim[0], ylim[0]), (xlim[1], ylim[0])]]
    frame = LineCollection(edges, colors=FRAME, lw=0.8, clip_on=False)
    ax.add_collection(frame, autolim=False)

    figure: Any = ax.get_figure()
    below = offset_copy(ax.get_xaxis_transform(), figure, 0, -4, "points")
    beside = offset_copy(ax.get_yaxis_transform(), figure, -4, 0, "points")
    small: Any = {"size": 8.5, "color": FRAME}
    for x, label in zip(places, labels, strict=True):
        ax.text(x, 0.0, label, ha="center", va="top", transform=below, **small)
    for y, text in zip(heights, texts, strict=True):
        ax.text(0.0, y, text, ha="right", va="center", transform=beside, **small)
    over = offset_copy(ax.transAxes, figure, 0, 4, "points")
    ax.text(0.5, 1.0, _escape(panel.title), ha="center", transform=over, size=10)
    left, bottom, _ = _margins(panel)
    low = offset_copy(ax.transAxes, figure, 0, 0.06 - bottom)
    ax.text(0.5, 0.0, _escape(panel.x.label), ha="center", va="bottom", transform=low)
    side = offset_copy(ax.transAxes, figure, 0.1 - left, 0)
    label = _escape(panel.y.label)
    ax.text(0.0, 0.5, label, ha="left", va="center", rotation=90, transform=side)


def _ticks(
    axis: spec.Axis, limits: tuple[float, float], most: int
) -> tuple[list[float], list[str]]:
    """Places and labels of the ticks of an axis."""
    low, high = limits
    if axis.ticks is not None:
        inside = [place for place in axis.ticks if low <= place <= high]
        return inside, [_escape(axis.ticks[place]) for place in inside]
    if axis.is_log:
        powers = range(math.ceil(math.log10(low)), math.floor(math.log10(high)) + 1)
        places = [10.0**power for power in powers]
        return places, [f"{place:g}" for place in places]
    found = MaxNLocator(most, steps=[1, 2, 5, 10]).tick_values(low, high)
    digits = max(0, -math.floor(math.log10(found[1] - found[0]) + 1e-9))
    places = [float(v) for v in found if low <= v <= high]
    return places, [f"{v + 0.0:.{digits}f}".replace("-", "−") for v in places]


def _draw_mark(ax: Axes, mark: spec.Mark, is_over_points: bool) -> None:
    match mark:
        case spec.Level():
            style = ":" if mark.is_dotted else "-"
            ax.axhline(mark.value, color=COLORS["soft"], lw=0.8, ls=style)
        case spec.Ground():
            span = ax.axvspan if mark.along == "x" else ax.axhspan
            color = COLORS[mark.key]
            span(mark.start, mark.end, color=color, alpha=0.14, lw=0, zorder=0)
        case spec.Band():
            color = COLORS[mark.key]
            ax.fill_between(mark.x, mark.low, mark.high, color=color, alpha=0.17, lw=0)
        case spec.Bars():
            _draw_bars(ax, mark)
        case spec.Line():
            _draw_line(ax, mark, is_over_points)
        case spec.Points():
            ax.plot(
                *(mark.x, mark.y, "o"),
                color=COLORS[mark.key],
                ms=0.55 * mark.size,
                alpha=mark.opacity,
                mew=0,
            )
            for x, y, label in zip(mark.x, mark.y, mark.labels, strict=False):
                _annotate(ax, label, (x, y), (0, 5), ha="center")


def _draw_line(ax: Axes, mark: spec.Line, is_over_points: bool) -> None:
    width = 0.85 * mark.line_width
    effects = []
    if is_over_points:
        outline = patheffects.Stroke(linewidth=width + 1.6, foreground="white")
        effects = [outline, patheffects.Normal()]
    ax.plot(
        mark.x,
        mark.y,
        color=COLORS[mark.key],
        lw=width,
        ls="-" if mark.is_solid else _dash(mark.key),
        alpha=mark.opacity,
        marker="o" if mark.has_dots else None,
        ms=6.0,
        path_effects=effects,
    )


def _draw_bars(ax: Axes, mark: spec.Bars) -> None:
    values = np.nan_to_num(mark.values, posinf=0.0, neginf=0.0)
    bars = ax.barh if mark.is_across else ax.bar
    bars(mark.places, values, mark.width, color=COLORS[mark.key])
    size = 8.5 if mark.is_across else 6.0
    for place, value, text in zip(mark.places, values, mark.texts, strict=True):
        if mark.is_across:
            _annotate(ax, text, (max(value, 0.0), place), (4, 0), size, va="center")
        else:
            at = (place, value if value > 0.0 else ax.get_ylim()[0])
            _annotate(ax, text, at, (0, 2), size, ha="center")


def _annotate(
    ax: Axes,
    text: str,
    place: Sequence[float],
    offset: tuple[float, float],
    size: float = 8.0,
    **alignment: Any,
) -> None:
    if text and all(map(math.isfinite, place)):
        (x, y), figure = place, ax.get_figure()
        assert isinstance(figure, Picture)
        beside = offset_copy(ax.transData, figure, *offset, "points")
        ax.text(x, y, _escape(text), transform=beside, size=size, **alignment)
