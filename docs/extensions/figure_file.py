"""Figures of reports as PNG files, drawn by matplotlib."""

import io
import math
import re
from collections.abc import Sequence
from typing import Any, Literal

import matplotlib
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


def to_png(figure: spec.Figure, dpi: float = _DPI, columns: int = 3) -> bytes:
    """Draws a figure as a PNG file."""
    buffer = io.BytesIO()
    picture = draw(figure, columns)
    picture.savefig(buffer, format="png", dpi=dpi)
    return buffer.getvalue()


def draw(figure: spec.Figure, columns: int = 3) -> Figure:
    """Draws the panels of a figure, row by row, below its legend."""
    panels = figure.panels
    width = _WIDTH
    rows = math.ceil(len(panels) / columns)
    row_height = _PIXEL * max(panel.height for panel in panels)

    longest = max(map(len, figure.keys.values()), default=0)
    entry = 45.0 + _LETTER * longest
    entries = max(1, int(width / entry))  # In a row.
    lines = math.ceil(len(figure.keys) / entries)
    height = rows * row_height + _LINE * lines

    marks: list[spec.Mark] = []
    for panel in panels:
        marks += panel.marks

    handles = [_legend_handle(key, marks) for key in figure.keys]
    labels = [_plain(label) for label in figure.keys.values()]
    size = width / 72.0, height / 72.0
    with matplotlib.rc_context(STYLE):
        picture = Figure(figsize=size, layout="constrained")
        every = picture.subplots(rows, columns, squeeze=False).ravel()
        for axes, panel in zip(every, panels, strict=False):
            _draw_panel(axes, panel)
        for axes in every[len(panels) :]:
            axes.remove()
        picture.legend(handles, labels, loc="outside upper center", ncols=entries)
    return picture


def _plain(text: str) -> str:
    """Escapes "$", which begins a formula, except in symbols such as "$C_n$"."""
    parts = re.split(r"(\$C_\w\$)", text)
    parts[::2] = [part.replace("$", r"\$") for part in parts[::2]]
    return "".join(parts)


def _legend_handle(key: str, marks: Sequence[spec.Mark]) -> Artist:
    """The line or area that stands for a key."""
    color = COLORS[key]
    own = [mark for mark in marks if getattr(mark, "key", "") == key]
    lines = [mark for mark in own if isinstance(mark, spec.Line)]
    is_ground = any(isinstance(mark, spec.Ground) for mark in own)
    if is_ground and not lines:
        return Patch(color=color, alpha=0.2, lw=0.0)
    width = max((line.line_width for line in lines), default=4.0)
    dashes = next((line.dashes for line in lines if line.dashes), ())
    style = _line_style(dashes)
    return Line2D([], [], color=color, lw=width, ls=style)


def _line_style(dashes: tuple[float, ...]) -> Any:
    """Dashes as matplotlib has them."""
    return (0.0, dashes) if dashes else "solid"


def _draw_panel(axes: Axes, panel: spec.Panel) -> None:
    """Draws a panel: its title, its axes and its marks."""
    title = _plain(panel.title)
    axes.set_title(title)
    axes.margins(0.02, 0.15)
    _set_axis(axes, "x", panel.x)
    _set_axis(axes, "y", panel.y)
    for mark in panel.marks:
        key = getattr(mark, "key", "soft")
        _draw_mark(mark, axes, COLORS[key])


def _set_axis(axes: Axes, name: Literal["x", "y"], axis: spec.Axis) -> None:
    """Sets the scale, limits and label of an axis."""
    label = _plain(axis.label)
    settings: dict[str, Any] = {f"{name}label": label}
    if axis.is_log:
        settings[f"{name}scale"] = "log"
    if axis.range is not None:
        settings[f"{name}lim"] = axis.range
    axes.set(**settings)
    if axis.is_log:
        side = getattr(axes, f"{name}axis")
        no_ticks = NullLocator()
        side.set_minor_locator(no_ticks)
        side.set_major_formatter("{x:g}")


def _draw_mark(mark: spec.Mark, axes: Axes, color: str) -> None:
    """Draws a mark in the color of its key."""
    match mark:
        case spec.Level():
            style = "dotted" if mark.is_dotted else "solid"
            axes.axhline(mark.value, color=color, lw=0.8, ls=style)
        case spec.Ground():
            axes.axvspan(mark.start, mark.end, color=color, alpha=0.14, lw=0.0)
        case spec.Band():
            axes.fill_between(
                mark.x, mark.low, mark.high, color=color, alpha=0.17, lw=0.0
            )
        case spec.Line():
            style = _line_style(mark.dashes)
            width = 0.85 * mark.line_width
            dot = "o" if mark.has_dots else ""
            axes.plot(
                mark.x,
                mark.y,
                color=color,
                lw=width,
                ls=style,
                marker=dot,
                ms=6.0,
                mew=0.0,
            )
        case spec.Points():
            size = 0.55 * mark.size
            axes.plot(
                mark.x,
                mark.y,
                color=color,
                alpha=mark.opacity,
                lw=0.0,
                marker="o",
                ms=size,
                mew=0.0,
            )
