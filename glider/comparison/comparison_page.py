"""A comparison as a page: one file that needs nothing else."""

import math

import numpy as np

from glider.comparison import as_text
from glider.comparison.differences import Comparison
from glider.report.as_page import render_page
from glider.report.error_table import ALONG, FREE, PITCH, bounded, columns_of, error_of
from glider.report.model_figures import WIDE, grouped_bars, lack_marks, term_panel
from glider.report.plots import figure as spec
from glider.report.plots.style import LABELS


def to_html(comparison: Comparison) -> str:
    """The page of a comparison."""
    figures = {
        "changes": changes_figure(comparison),
        "errors": errors_figure(comparison),
        "curves": curves_figure(comparison),
    }
    return render_page(
        "comparison.html",
        {name: figure for name, figure in figures.items() if figure is not None},
        comparison=comparison,
        headline=as_text.headline(comparison),
        rows=as_text.rows(comparison),
        errors=as_text.error_rows(comparison),
        facts=as_text.facts(comparison),
    )


def _keys(comparison: Comparison) -> dict[str, str]:
    a, b = (report.campaign for report in comparison.reports)
    return {"first": f"A: {a}", "second": f"B: {b}"}


def changes_figure(comparison: Comparison) -> spec.Figure | None:
    """Each change over its standard error, beside what chance allows."""
    compared = [
        (d, row)
        for d, row in zip(comparison.differences, as_text.rows(comparison), strict=True)
        if math.isfinite(d.z)
    ][::-1]
    if not compared:
        return None
    keys = {"chosen": "changed by more than chance explains", "other": "agrees"}
    limit = comparison.z_significant
    marks: list[spec.Ground | spec.Points] = [spec.Ground(-limit, limit)]
    z = np.array([d.z for d, _ in compared])
    names = np.array(
        [
            f"{d.label}: {d.z:+.1f} σ<br>{row.first} → {row.second} {row.unit}"
            for d, row in compared
        ]
    )
    is_chosen = np.array([comparison.is_significant(d) for d, _ in compared])
    for key, which in zip(keys, (is_chosen, ~is_chosen), strict=True):
        x, y, hovers = z[which], 1.0 * np.flatnonzero(which), names[which].tolist()
        points = spec.Points(key, x, y, hover="%{hovertext}", names=hovers, size=11.0)
        marks.append(points)
    far = 1.15 * max(limit, *(abs(d.z) for d, _ in compared))
    ticks = {float(place): d.label for place, (d, _) in enumerate(compared)}
    panel = spec.Panel(
        "",
        marks,
        spec.Axis("change over its standard error [σ]", (-far, far)),
        spec.Axis(range=(-0.6, len(compared) - 0.4), ticks=ticks),
        height=90 + 26 * len(compared),
    )
    return spec.Figure(keys=keys, panels=[panel], columns=1, least_width=WIDE)


def errors_figure(comparison: Comparison) -> spec.Figure | None:
    """Errors of each model in both reports as bars."""
    models, keys = columns_of(*comparison.reports), _keys(comparison)
    if not models:
        return None
    panels = []
    for error, title in (
        (FREE, "position, free rollout"),
        (ALONG, "position, along measured pitch"),
        (PITCH, "pitch, free rollout"),
    ):
        both = comparison.reports
        values = np.array([[error_of(r, m, error) for m in models] for r in both])
        unit = as_text.unit_of(comparison, error, *values.flat)
        bars = dict(zip(keys, bounded(values) / unit.size, strict=True))
        panels.append(
            spec.Panel(
                title=f"{title}, RMS [{unit.name}]",
                marks=grouped_bars(bars, keys, unit),
                x=spec.Axis(ticks={float(i): LABELS[m] for i, m in enumerate(models)}),
                y=spec.Axis(is_log=True),
            )
        )
    return spec.Figure(keys=keys, panels=panels)


def curves_figure(comparison: Comparison) -> spec.Figure | None:
    """What the plate of each report lacks, one over the other."""
    marks: dict[str, list[spec.Line | spec.Band]] = {}
    for key, report in zip(_keys(comparison), comparison.reports, strict=True):
        for curve in report.curves:
            marks.setdefault(curve.term, []).extend(lack_marks(key, curve))
    panels = [term_panel(term, of_term, "alpha") for term, of_term in marks.items()]
    return spec.Figure(keys=_keys(comparison), panels=panels) if panels else None
