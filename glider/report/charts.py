"""The interactive figures of a report; those of `figures.py`, to work with."""

import dataclasses
import functools
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import jinja2

from glider.report.chart import Chart
from glider.report.flight_charts import folds_chart, held_out_chart, spreads_chart
from glider.report.json_report import plain
from glider.report.model_charts import (
    carried_chart,
    coefficients_chart,
    curves_chart,
    errors_chart,
    evidence_chart,
    residual_chart,
)
from glider.report.plots.style import BLUE, COLORS, DARK, GREEN, GREY, ORANGE, RED
from glider.sysid.result import Result

CHARTS: dict[str, Callable[[Result], Chart | None]] = {
    "errors": errors_chart,
    "curves": curves_chart,
    "carried": carried_chart,
    "coefficients": coefficients_chart,
    "evidence": evidence_chart,
    "folds": folds_chart,
    "held_out": held_out_chart,
    "spreads": spreads_chart,
    "residual": residual_chart,
}
"""Function that makes each chart, by the name of the figure that shows the same."""

_PALE_BLUE = "#8CC3E6"

LIGHT_KEYS = {
    **COLORS,
    "noise": "#1B1F24",
    "soft": "#5B6570",
    "fitted": GREY,
    "lack": BLUE,
    "named": GREEN,
    "rest": RED,
    "better": BLUE,
    "worse": RED,
    "own": BLUE,
    "chosen": BLUE,
    "confused": _PALE_BLUE,
    "other": "#B5B5B5",
    "first": ORANGE,
    "second": BLUE,
}
"""Entry of a legend to its color on a light ground."""

DARK_KEYS = {
    **DARK,
    "noise": "#E6E9ED",
    "soft": "#A7B0BA",
    "fitted": "#7C858F",
    "lack": DARK["corrected"],
    "named": "#2FC79B",
    "rest": "#FF8A50",
    "better": DARK["corrected"],
    "worse": "#FF8A50",
    "own": DARK["corrected"],
    "chosen": DARK["corrected"],
    "confused": "#2F6E96",
    "other": "#5F6873",
    "first": DARK["refitted"],
    "second": DARK["corrected"],
}
"""The same on a dark one."""

STATIC = Path(__file__).parent / "static"


def make_charts(result: Result) -> dict[str, Chart]:
    """Returns name to chart; what there is nothing to show of is left out."""
    charts = {name: make(result) for name, make in CHARTS.items()}
    return {name: chart for name, chart in charts.items() if chart is not None}


def render_page(template: str, charts: Mapping[str, Chart], **values: Any) -> str:
    """Returns a page with its charts: one file that needs nothing else.

    Args:
        template: of this package, one that extends base.html.
        charts: that its macro `figure` shows, by name.
        values: what else the template needs.
    """
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("glider.report"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.policies["json.dumps_kwargs"] = {"sort_keys": False}  # Of legends.
    return environment.get_template(template).render(
        charts=charts,
        charts_json=plain({n: dataclasses.asdict(c) for n, c in charts.items()}),
        light=LIGHT_KEYS,
        dark=DARK_KEYS,
        style=_static("page.css"),
        script=_static("page.js"),
        plotly=_static("plotly-basic.min.js"),
        **values,
    )


@functools.cache
def _static(name: str) -> str:
    """Returns the text of a file that a page carries within it."""
    text = (STATIC / name).read_text(encoding="utf-8")
    if "</script" in text or "</style" in text:
        raise ValueError(f"{name} cannot stand inside of a page")
    return text
