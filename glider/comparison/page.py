"""A comparison as a page: one file that needs nothing else."""

import math

from glider.comparison.differences import Comparison
from glider.comparison.wording import (
    error_rows,
    error_values,
    facts,
    headline,
    models_of,
    rows,
    unit_of,
)
from glider.report.chart import Axis, Chart, Panel, level, numbers, points
from glider.report.charts import render_page
from glider.report.flight_errors import bounded
from glider.report.model_charts import WIDE, lack_traces
from glider.report.plots.style import LABELS, TERMS, VARIABLES


def to_html(comparison: Comparison) -> str:
    """Returns the page."""
    charts = {
        "changes": changes_chart(comparison),
        "errors": errors_chart(comparison),
        "curves": curves_chart(comparison),
    }
    return render_page(
        "comparison.html",
        {name: chart for name, chart in charts.items() if chart is not None},
        comparison=comparison,
        headline=headline(comparison),
        rows=rows(comparison),
        errors=error_rows(comparison),
        facts=[
            (name, first, second)
            for (name, first), (_, second) in zip(
                facts(comparison.first), facts(comparison.second), strict=True
            )
        ],
    )


def _keys(comparison: Comparison) -> dict[str, str]:
    return {
        "first": f"A: {comparison.first.campaign}",
        "second": f"B: {comparison.second.campaign}",
    }


def changes_chart(comparison: Comparison) -> Chart | None:
    """Returns each change over its standard error, beside what chance allows."""
    compared = [d for d in comparison.differences if math.isfinite(d.z)][::-1]
    if not compared:
        return None
    limit = comparison.z_significant
    names = [d.label for d in compared]
    keys = {"chosen": "changed by more than chance allows", "other": "agrees"}
    traces = []
    for key in keys:
        mine = [
            d for d in compared if comparison.is_significant(d) == (key == "chosen")
        ]
        told = [
            f"{row.first} → {row.second} {row.unit}"
            for row, d in zip(rows(comparison), comparison.differences, strict=True)
            for m in mine
            if m is d
        ][::-1]
        traces.append(
            points(
                key,
                numbers(d.z for d in mine),
                [d.label for d in mine],
                "%{y}: %{x:+.1f} σ<br>%{text}",
                text=told,
                marker={"color": f"@{key}", "size": 11},
            )
        )
    far = 1.15 * max(limit, *(abs(d.z) for d in compared))
    band = {
        "type": "rect",
        "yref": "paper",
        "x0": -limit,
        "x1": limit,
        "y0": 0,
        "y1": 1,
        "line": {"width": 0},
        "fillcolor": "@soft/0.14",
        "layer": "below",
    }
    panel = Panel(
        title="",
        traces=traces,
        x=Axis(title="change over its standard error [σ]", range=(-far, far)),
        y=Axis(more={"categoryorder": "array", "categoryarray": names, "dtick": 1}),
        height=90 + 26 * len(names),
        shapes=[band],
    )
    return Chart(keys=keys, panels=[panel], least_width=WIDE)


def errors_chart(comparison: Comparison) -> Chart | None:
    """Returns the errors of each model in both reports as bars."""
    models = models_of(comparison)
    if not models:
        return None
    panels = []
    for error, title in (
        ("rollout.position_rms_m", "position, free rollout"),
        ("rollout_measured_pitch.position_rms_m", "position, along measured pitch"),
        ("rollout.pitch_rms_rad", "pitch, free rollout"),
    ):
        pairs = [error_values(comparison, error, model) for model in models]
        unit = unit_of(comparison, error, *(v for pair in pairs for v in pair))
        traces = [
            {
                "type": "bar",
                "key": key,
                "x": [LABELS[model] for model in models],
                "y": numbers(float(bounded(pair[k])) / unit.size for pair in pairs),
                "marker": {"color": f"@{key}"},
                "hovertemplate": f"{words}, %{{x}}: %{{y:.3r}} {unit.name}"
                "<extra></extra>",
            }
            for k, (key, words) in enumerate(_keys(comparison).items())
        ]
        panels.append(
            Panel(
                title=f"{title}, RMS [{unit.name}]",
                traces=traces,
                x=Axis(more={"type": "category"}),
                y=Axis(is_log=True),
            )
        )
    return Chart(keys=_keys(comparison), panels=panels)


def curves_chart(comparison: Comparison) -> Chart | None:
    """Returns what the plate of each report lacks, one over the other."""
    both = {"first": comparison.first.curves, "second": comparison.second.curves}
    terms = dict.fromkeys(c.term for curves in both.values() for c in curves)
    if not terms:
        return None
    return Chart(
        keys=_keys(comparison),
        panels=[
            Panel(
                title=TERMS.get(term, term.replace("_", " ")),
                traces=[
                    trace
                    for key, curves in both.items()
                    for curve in curves
                    if curve.term == term
                    for trace in lack_traces(key, curve)
                ],
                x=Axis(title=VARIABLES["alpha"][0], link="alpha"),
                shapes=[level(0.0)],
            )
            for term in terms
        ],
    )
