"""Figures as a page draws them: data for plotly.js, which `static/page.js` completes.

A colour "@key" is that of an entry of the legend in the page's light or dark palette,
"@key/0.2" the same, translucent; "#3" is the page's column of numbers 3, so that what
several panels show is written once.
"""

import functools
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
from markupsafe import Markup

from glider.files.schema import json_text
from glider.report.plots import figure as spec
from glider.report.plots.style import DASHES, INKS

STATIC = Path(__file__).parent / "static"

_SHORT = 8
"""Numbers up to which a column is written where it stands."""


def render_page(
    template: str, figures: Mapping[str, spec.Figure], **values: Any
) -> str:
    """Renders a page with its figures: one file that needs nothing else.

    Args:
        template: of this package, one that extends base.html.
        figures: that its macro `figure` shows, by name.
        values: what else the template needs.
    """
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("glider.report"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(template).render(
        figures=figures,
        data=_script(page_data(figures)),
        colors=INKS,
        style=_static("page.css"),
        script=_static("page.js"),
        plotly=_static("plotly-basic.min.js"),
        **values,
    )


def page_data(figures: Mapping[str, spec.Figure]) -> dict[str, Any]:
    """Data of a page's figures, with the columns that they share."""
    columns = _Columns()
    found = {name: _figure(figure, columns) for name, figure in figures.items()}
    return {"figures": found, "columns": columns.values}


def _script(data: Any) -> Markup:
    """JSON that cannot end the script that it stands in."""
    text = json_text(data, indent=-1)
    for character in "<>&":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return Markup(text)


@functools.cache
def _static(name: str) -> Markup:
    """Text of a file that a page carries within it."""
    text = (STATIC / name).read_text(encoding="utf-8")
    if "</script" in text or "</style" in text:
        raise ValueError(f"{name} cannot stand inside of a page")
    return Markup(text)


class _Columns:
    """Numbers of a page, each column once."""

    def __init__(self) -> None:
        self.values: list[np.ndarray] = []
        self._places: dict[tuple[str, bytes], str] = {}

    def add(self, values: np.ndarray) -> np.ndarray | str:
        """A column's reference; the column itself where it is short."""
        values = np.asarray(values)
        values = values if values.dtype.kind in "iu" else rounded(values)
        if len(values) <= _SHORT:
            return values
        key = values.dtype.kind, values.tobytes()
        if key not in self._places:
            self._places[key] = f"#{len(self.values)}"
            self.values.append(values)
        return self._places[key]


def rounded(values: np.ndarray) -> np.ndarray:
    """Numbers of five digits; infinite ones become NaN."""
    values = np.where(np.isfinite(values), np.asarray(values, dtype=float), np.nan)
    with np.errstate(divide="ignore", invalid="ignore"):
        digits = 4 - np.floor(np.log10(np.abs(values)))
    digits = np.clip(np.nan_to_num(digits), -300, 22)
    up, down = 10.0 ** np.maximum(digits, 0), 10.0 ** np.maximum(-digits, 0)
    return np.round(values * up / down) * down / up


def _figure(figure: spec.Figure, columns: _Columns) -> dict[str, Any]:
    marks = [mark for panel in figure.every for mark in panel.marks]
    dashed = {m.key for m in marks if isinstance(m, spec.Line) and not m.is_solid}
    return {
        "keys": [
            {
                "key": key,
                "label": label,
                "dash": _dash(key, 2.0) if key in dashed else "",
            }
            for key, label in figure.keys.items()
        ],
        "panels": [_panel(panel, columns) for panel in figure.panels],
        "choices": [
            {
                "label": choice.label,
                "note": choice.note,
                "is_shown": choice.is_shown,
                "panels": [_panel(panel, columns) for panel in choice.panels],
            }
            for choice in figure.choices
        ],
        "flights": figure.flights,
        "least_width": figure.least_width,
    }


def _panel(panel: spec.Panel, columns: _Columns) -> dict[str, Any]:
    return {
        "title": panel.title,
        "height": panel.height,
        "x": _axis(panel.x),
        "y": _axis(panel.y),
        "links": [panel.x.link, panel.y.link],
        "shapes": [
            _shape(m) for m in panel.marks if isinstance(m, (spec.Level, spec.Ground))
        ],
        "traces": [t for mark in panel.marks for t in _traces(mark, columns)],
    }


def _axis(axis: spec.Axis) -> dict[str, Any]:
    """What an axis has beside what all have."""
    found: dict[str, Any] = {}
    if axis.label:
        found["title"] = {"text": axis.label}
    if axis.range is not None:
        found["range"] = rounded(np.array(axis.range))
    if axis.is_log:
        # 0.001, not 1m; steps of two where the range is short.
        found |= {"type": "log", "tickformat": ",~r", "dtick": 1}
        if axis.range is not None:
            powers = np.log10(axis.range)
            found["range"] = rounded(powers)
            found["dtick"] = "D2" if np.ptp(powers) < 1.3 else 1
    if axis.ticks is not None:
        found["tickvals"] = list(axis.ticks)
        found["ticktext"] = [t.replace("\n", "<br>") for t in axis.ticks.values()]
        found["showgrid"] = axis.has_grid
    return found


def _shape(mark: spec.Level | spec.Ground) -> dict[str, Any]:
    if isinstance(mark, spec.Level):
        dash = {"dash": "dot"} if mark.is_dotted else {}
        return {
            **{"type": "line", "xref": "paper", "x0": 0, "x1": 1, "layer": "below"},
            **{"y0": mark.value, "y1": mark.value},
            "line": {"color": "@soft", "width": 1, **dash},
        }
    across = "y" if mark.along == "x" else "x"
    return {
        **{"type": "rect", "layer": "below", "line": {"width": 0}},
        **{f"{across}ref": "paper", f"{across}0": 0, f"{across}1": 1},
        **{f"{mark.along}0": mark.start, f"{mark.along}1": mark.end},
        "fillcolor": f"@{mark.key}/0.14",
    }


def _traces(mark: spec.Mark, columns: _Columns) -> list[dict[str, Any]]:
    if isinstance(mark, spec.Band):
        edge = {
            **{"type": "scatter", "mode": "lines", "key": mark.key},
            **{"x": columns.add(mark.x), "hoverinfo": "skip"},
            "line": {"width": 0, "color": f"@{mark.key}"},
        }
        fill = {"fill": "tonexty", "fillcolor": f"@{mark.key}/0.17"}
        low, high = columns.add(mark.low), columns.add(mark.high)
        return [{**edge, "y": low}, {**edge, "y": high, **fill}]
    if isinstance(mark, spec.Bars):
        x, y = ("y", "x") if mark.is_across else ("x", "y")
        # Numbers of many narrow bars have space only when upright.
        is_upright = not mark.is_across and len(mark.texts) > 11 * mark.width
        return [
            {
                **{"type": "bar", "key": mark.key, "width": mark.width},
                **{"orientation": "h" if mark.is_across else "v", "cliponaxis": False},
                **{x: columns.add(mark.places), y: columns.add(mark.values)},
                **{"text": mark.texts, "hovertext": mark.names},
                **{"textposition": "outside", "textangle": -90 if is_upright else 0},
                "marker": {"color": f"@{mark.key}"},
                "hovertemplate": mark.hover + "<extra></extra>",
            }
        ]
    if isinstance(mark, (spec.Level, spec.Ground)):
        return []
    color = f"@{mark.key}"
    trace: dict[str, Any] = {
        **{"type": "scatter", "key": mark.key, "opacity": mark.opacity},
        **{"x": columns.add(mark.x), "y": columns.add(mark.y)},
        "hoverinfo": "all" if mark.hover else "skip",
    }
    if mark.hover:
        trace["hovertemplate"] = mark.hover + "<extra></extra>"
    if mark.flight is not None:
        trace["flight"] = columns.add(mark.flight.astype(int))
    if isinstance(mark, spec.Points):
        trace["mode"] = "markers+text" if any(mark.labels) else "markers"
        trace |= {"marker": {"color": color, "size": mark.size}}
        trace |= {"hovertext": mark.names} if mark.names else {}
        if any(mark.labels):
            trace |= {"text": mark.labels, "textposition": "top center"}
        if mark.time is not None:
            trace["time"] = columns.add(mark.time)
        return [trace]
    width = mark.line_width
    dash = "solid" if mark.is_solid else _dash(mark.key, width, "px")
    trace["mode"] = "lines+markers" if mark.has_dots else "lines"
    trace["line"] = {"color": color, "width": width, "dash": dash}
    trace |= {"marker": {"color": color, "size": 8}} if mark.has_dots else {}
    if mark.extra is not None:
        trace["customdata"] = columns.add(mark.extra)
    return [trace]


def _dash(key: str, width: float, unit: str = "") -> str:
    """Dashes of a line as plotly.js (with px) and SVG take them; "" or "solid"."""
    if key not in DASHES:
        return "solid" if unit else ""
    return ",".join(f"{part * width:.3g}{unit}" for part in DASHES[key])
