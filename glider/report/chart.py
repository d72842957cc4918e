"""Interactive figures of a page, as data that `static/page.js` draws with plotly.js.

A trace is a dict as plotly.js takes it, with three additions: "key" says to which entry
of the legend it belongs; a color "@key" is that entry's in the page's light or dark
colors, and "@key/0.2" the same, translucent; and numbers "#name" are a column of the
chart, so that what several panels show is written once.
"""

import dataclasses
import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from glider.report.plots.style import DASHES, WIDTHS

Trace = dict[str, Any]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Axis:
    """An axis of a panel.

    Attributes:
        title: with its unit.
        range: what it shows at first (in powers of ten if logarithmic); all if None.
        is_log: whether it is logarithmic.
        link: axes of a chart with the same link are zoomed together.
        more: what else plotly.js takes.
    """

    title: str = ""
    range: tuple[float, float] | None = None
    is_log: bool = False
    link: str = ""
    more: Mapping[str, Any] = dataclasses.field(default_factory=dict)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Panel:
    """One pair of axes.

    Attributes:
        title: above it, plain text; "$C_n$" is a symbol with a subscript.
        traces: what it shows.
        x: axis across.
        y: axis up.
        height: in pixels.
        shapes: behind the traces, as plotly.js takes them.
        barmode: how bars of several traces stand, as plotly.js calls it.
    """

    title: str
    traces: list[Trace]
    x: Axis = Axis()
    y: Axis = Axis()
    height: int = 270
    shapes: list[dict[str, Any]] = dataclasses.field(default_factory=list)
    barmode: str = "group"


@dataclasses.dataclass(frozen=True, kw_only=True)
class Choice:
    """Panels that are shown when they are asked for, or from the start."""

    label: str
    note: str
    panels: list[Panel]
    is_shown: bool


@dataclasses.dataclass(frozen=True, kw_only=True)
class Chart:
    """A figure: panels side by side with one legend.

    Attributes:
        keys: entry of the legend to its name for people.
        panels: that are always shown.
        choices: of which the reader shows some.
        columns: numbers that traces refer to.
        flights: names that the column of flights numbers; the reader may pick one.
        dashes: entry of the legend to how its lines are dashed.
        least_width: of a panel, in the page's letters [rem].
    """

    keys: Mapping[str, str] = dataclasses.field(default_factory=dict)
    panels: list[Panel] = dataclasses.field(default_factory=list)
    choices: list[Choice] = dataclasses.field(default_factory=list)
    columns: Mapping[str, list[Any]] = dataclasses.field(default_factory=dict)
    flights: tuple[str, ...] = ()
    dashes: Mapping[str, str] = dataclasses.field(default_factory=dict)
    least_width: float = 18.5


def numbers(values: Iterable[float]) -> list[float | None]:
    """Returns numbers of five digits, None for what is not finite."""
    return [float(f"{v:.5g}") if math.isfinite(v) else None for v in values]


def dash_of(model: str) -> str:
    """Returns how a model's line is dashed, as plotly.js and SVG take it."""
    if model not in DASHES:
        return "solid"
    _, parts = DASHES[model]
    return ",".join(f"{part * WIDTHS.get(model, 1.6):.3g}px" for part in parts)


def line(
    key: str, x: Any, y: Any, hover: str, *, width: float | None = None, **more: Any
) -> Trace:
    """Returns a line in the color of its key.

    Args:
        key: entry of the legend.
        x: numbers, or the name of a column.
        y: the same.
        hover: template of what is told of a point.
        width: of the line; by default that of the model of this key.
        more: further attributes of the trace.
    """
    width = WIDTHS.get(key, 1.6) if width is None else width
    style = {"color": f"@{key}", "width": width, "dash": dash_of(key)}
    return {
        "type": "scatter",
        "mode": "lines",
        "key": key,
        "x": x,
        "y": y,
        "line": style,
        "hovertemplate": hover + "<extra></extra>",
        **more,
    }


def band(key: str, x: Any, low: Any, high: Any, opacity: float) -> list[Trace]:
    """Returns the two edges of a band, filled between."""
    edge = {
        "type": "scatter",
        "mode": "lines",
        "key": key,
        "x": x,
        "line": {"width": 0, "color": f"@{key}"},
        "hoverinfo": "skip",
    }
    fill = {"fill": "tonexty", "fillcolor": f"@{key}/{opacity}"}
    return [{**edge, "y": low}, {**edge, "y": high, **fill}]


def points(key: str, x: Any, y: Any, hover: str, **more: Any) -> Trace:
    """Returns points in the color of their key; arguments as of `line`."""
    return {
        "type": "scatter",
        "mode": "markers",
        "key": key,
        "x": x,
        "y": y,
        "marker": {"color": f"@{key}", "size": 7},
        "hovertemplate": hover + "<extra></extra>",
        **more,
    }


def level(value: float, dash: str = "solid") -> dict[str, Any]:
    """Returns a thin line across a panel at a height."""
    return {
        "type": "line",
        "xref": "paper",
        "x0": 0,
        "x1": 1,
        "y0": value,
        "y1": value,
        "line": {"color": "@soft", "width": 1, "dash": dash},
        "layer": "below",
    }


def shade(start: float, end: float) -> dict[str, Any]:
    """Returns a pale ground under a span of x."""
    return {
        "type": "rect",
        "yref": "paper",
        "x0": start,
        "x1": end,
        "y0": 0,
        "y1": 1,
        "line": {"width": 0},
        "fillcolor": "@soft/0.14",
        "layer": "below",
    }


def symlog(value: float, linear: float = 10.0, share: float = 0.6) -> float:
    """Returns where a value lies on an axis that is linear up to `linear`.

    share · v / linear there, and share + log₁₀(|v| / linear) beyond, with v's sign.
    """
    if abs(value) <= linear:
        return share * value / linear
    return math.copysign(share + math.log10(abs(value) / linear), value)


def log_range(low: float, high: float) -> tuple[float, float]:
    """Returns the range of a logarithmic axis from low to high."""
    return float(np.log10(low)), float(np.log10(high))
