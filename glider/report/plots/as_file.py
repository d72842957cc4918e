"""Figures as PNG files, drawn by matplotlib."""

import io
import math
import re
from collections.abc import Sequence
from typing import Any, Literal

import matplotlib
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import NullLocator

from glider.report.plots import figure as spec
from glider.report.plots.style import COLORS, STYLE

# Of a picture in points, and its dots per inch.
_WIDTH = 720.0
_DPI = 110.0
_PIXEL = 72.0 / 92.0  # Height of a page's pixel in points.
_LETTER = 5.2  # Width of a letter in points.
_LINE = 13.0  # Height of a line of text in points.
_SPACE = 10.0  # Space beside panels in points.


def to_png(figure: spec.Figure, dpi: float = _DPI, width: float = _WIDTH) -> bytes:
    """Draws a figure as a PNG file."""
    buffer = io.BytesIO()
    draw(figure, width).savefig(buffer, format="png", dpi=dpi)
    return buffer.getvalue()


def draw(figure: spec.Figure, width: float = _WIDTH) -> Figure:
    """Draws the shown panels of a figure, row by row, below its legend."""
    panels = figure.shown
    columns = min(figure.columns, len(panels))
    rows = [panels[i : i + columns] for i in range(0, len(panels), columns)]
    heights = [_PIXEL * max(panel.height for panel in row) for row in rows]
    longest = max(map(len, figure.keys.values()), default=0)
    entries_per_row = max(1, int(width / (45.0 + 5.2 * longest)))
    legend_rows = math.ceil(len(figure.keys) / entries_per_row)
    height = sum(heights) + _LINE * legend_rows + 5.0
    with matplotlib.rc_context(STYLE):
        picture = Figure(figsize=(width / 72.0, height / 72.0))
        marks = [mark for panel in panels for mark in panel.marks]
        picture.legend(
            [_legend_handle(key, marks) for key in figure.keys],
            [_plain(label) for label in figure.keys.values()],
            loc="upper center",
            ncols=entries_per_row,
            borderaxespad=0.2,
            labelspacing=0.2,
        )
        row_bottom = sum(heights)
        for row, row_height in zip(rows, heights, strict=True):
            row_bottom -= row_height
            shares = [panel.share for panel in row] + [1.0] * (columns - len(row))
            edges = width * np.append(0.0, np.cumsum(shares)) / sum(shares)
            for panel, start, end in zip(row, edges, edges[1:], strict=False):
                left, below, above = _margins(panel)
                box = (
                    (start + left) / width,
                    (row_bottom + below) / height,
                    (end - start - left - _SPACE) / width,
                    (row_height - below - above) / height,
                )
                _draw_panel(picture.add_axes(box), panel)
    return picture


def _margins(panel: spec.Panel) -> tuple[float, float, float]:
    """Space left of, below and above a panel for its texts, in points.

    Matplotlib's layouts, which measure all texts, take as long as the drawing.
    """
    longest = 6
    if panel.y.ticks is not None:
        longest = max(map(len, panel.y.ticks.values()))
    left = _SPACE + _LETTER * longest
    if panel.y.label:
        left += _LINE
    lines = 1
    if panel.x.ticks is not None:
        lines += max(label.count("\n") for label in panel.x.ticks.values())
    below = _SPACE + _LINE * lines
    if panel.x.label:
        below += _LINE
    return left, below, 1.7 * _LINE if panel.title else _SPACE


def _plain(text: str) -> str:
    """Escapes "$", which begins a formula, except in symbols such as "$C_n$"."""
    parts = re.split(r"(\$C_\w\$)", text)
    parts[::2] = [part.replace("$", r"\$") for part in parts[::2]]
    return "".join(parts)


def _legend_handle(key: str, marks: Sequence[spec.Mark]) -> Artist:
    """The line or area that stands for a key."""
    own = [mark for mark in marks if getattr(mark, "key", "") == key]
    lines = [mark for mark in own if isinstance(mark, spec.Line)]
    if lines or not own:
        width = max((line.line_width for line in lines), default=4.0)
        dashes = next((line.dashes for line in lines if line.dashes), ())
        return Line2D([], [], color=COLORS[key], lw=width, ls=_line_style(dashes))
    opacity = min(getattr(mark, "opacity", 1.0) for mark in own)
    if any(isinstance(mark, spec.Ground) for mark in own):
        opacity = 0.2
    return Patch(color=COLORS[key], alpha=opacity, lw=0.0)


def _line_style(dashes: tuple[float, ...]) -> Any:
    return (0.0, dashes) if dashes else "solid"


def _draw_panel(axes: Axes, panel: spec.Panel) -> None:
    axes.set_title(_plain(panel.title), y=1.0)  # A given height is faster.
    axes.margins(0.02, 0.15)
    _set_axis(axes, "x", panel.x)
    _set_axis(axes, "y", panel.y)
    clouds = [mark for mark in panel.marks if isinstance(mark, spec.Points)]
    has_cloud = any(cloud.size < 5.0 for cloud in clouds)
    for mark in panel.marks:
        color = COLORS[getattr(mark, "key", "soft")]
        if has_cloud and isinstance(mark, spec.Line):
            axes.plot(mark.x, mark.y, color="white", lw=0.85 * mark.line_width + 1.6)
        _draw_mark(mark, axes, color)


def _set_axis(axes: Axes, name: Literal["x", "y"], axis: spec.Axis) -> None:
    """Sets the scale, ticks, grid, limits and label of an axis."""
    settings: dict[str, Any] = {f"{name}label": _plain(axis.label)}
    if axis.is_log:
        settings[f"{name}scale"] = "log"
    if axis.ticks is not None:
        settings[f"{name}ticks"] = list(axis.ticks)
        settings[f"{name}ticklabels"] = [_plain(text) for text in axis.ticks.values()]
    if axis.range is not None:
        settings[f"{name}lim"] = axis.range
    axes.set(**settings)
    axes.grid(axis.has_grid, axis=name)
    if axis.is_log:
        side = getattr(axes, f"{name}axis")
        side.set_minor_locator(NullLocator())
        side.set_major_formatter("{x:g}")


def _draw_mark(mark: spec.Mark, axes: Axes, color: str) -> None:
    match mark:
        case spec.Level():
            dashes = (1.0, 1.65) if mark.is_dotted else ()
            axes.axhline(mark.value, color=color, lw=0.8, ls=_line_style(dashes))
        case spec.Ground():
            span = axes.axvspan if mark.along == "x" else axes.axhspan
            span(mark.start, mark.end, color=color, alpha=0.14, lw=0.0)
        case spec.Band():
            axes.fill_between(
                mark.x, mark.low, mark.high, color=color, alpha=0.17, lw=0.0
            )
        case spec.Bars():
            _draw_bars(mark, axes, color)
        case spec.Line():
            axes.plot(
                mark.x,
                mark.y,
                color=color,
                alpha=mark.opacity,
                lw=0.85 * mark.line_width,
                ls=_line_style(mark.dashes),
                marker="o" if mark.has_dots else "",
                ms=6.0,
                mew=0.0,
            )
        case spec.Points():
            size = 0.55 * mark.size
            axes.plot(
                mark.x, mark.y, "o", color=color, alpha=mark.opacity, ms=size, mew=0.0
            )


def _draw_bars(mark: spec.Bars, axes: Axes, color: str) -> None:
    """Draws bars from the lower limit of their axis, with their texts."""
    low, _ = axes.get_ylim()
    values = np.where(np.isfinite(mark.values), mark.values, low)
    bars = axes.bar(mark.places, np.maximum(values, low), mark.width, color=color)
    axes.bar_label(bars, mark.texts, padding=2.0, size=7.0)
