"""The figure of a session: coefficients against the number of throws."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from diagrams.programs.lab.state import State, Trace
from glider.report.as_page import page_data
from glider.report.numbers import format_estimate
from glider.report.plots.figure import Axis, Band, Figure, Level, Line, Panel
from glider.report.wording import name_of
from glider.sysid.result import Estimate

_WIDE = 1.96
"""Half the width of a band, in standard errors: 95 %."""


def session_figures(state: State) -> dict[str, Any]:
    """The figure "effects" as a page draws it; {} for none yet."""
    answers = [trace for trace in state.traces if not trace.refusal]
    figure = _effects_figure(answers)
    return page_data({"effects": figure} if figure else {})


def _effects_figure(traces: Sequence[Trace]) -> Figure | None:
    """Each coefficient, as the traces had it; a gap where its effect was not found."""
    found: dict[tuple[str, str], dict[int, Estimate]] = {}
    for k, trace in enumerate(traces):
        for effect in trace.effects:
            for name, estimate in effect.coefficients.items():
                estimates = found.setdefault((effect.kind, name), {})
                estimates[k] = estimate
    if not found:
        return None
    counts = np.array([float(len(trace.flights)) for trace in traces])
    latest = len(traces) - 1
    # What is there now comes first.
    order = sorted(found, key=lambda key: latest not in found[key])
    panels = []
    for kind, name in order:
        estimates = found[kind, name]
        panels.append(_coefficient_panel(kind, name, estimates, counts))
    keys = {"corrected": "estimate; the band is 1.96 standard errors"}
    return Figure(keys=keys, panels=panels)


def _coefficient_panel(
    kind: str, name: str, estimates: dict[int, Estimate], counts: np.ndarray
) -> Panel:
    found = np.array(sorted(estimates))
    values = np.full(len(counts), np.nan)
    values[found] = [estimates[k].value for k in found]
    stds = np.array([estimates[k].std for k in found])
    now = "no longer found"
    last = estimates.get(len(counts) - 1)
    if last:
        now = format_estimate(last)
    line = Line(
        "corrected",
        counts,
        values,
        hover="after %{x} throws: %{y:.4r}",
        has_dots=True,
        is_solid=True,
    )
    low = values[found] - _WIDE * stds
    high = values[found] + _WIDE * stds
    band = Band("corrected", counts[found], low, high)
    title = f"{name_of(kind)}, {name_of(name)}: {now}"
    end = float(counts.max()) + 1.0
    axis = Axis("number of throws", (0.0, end))
    return Panel(title, [Level(), band, line], axis, height=220)
