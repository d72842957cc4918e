"""Figures of a session: coefficients against the number of throws, and errors."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from diagrams.programs.lab.state import CORRECTED, NOMINAL, State, Throw, Trace
from glider.report.as_page import page_data
from glider.report.numbers import format_estimate
from glider.report.plots.figure import Axis, Band, Figure, Level, Line, Panel, Points
from glider.report.wording import name_of
from glider.sysid.report import Estimate

_WIDE = 1.96
"""Half the width of a band, in standard errors: 95 %."""

_THROWS = "number of throws"


def session_figures(state: State) -> dict[str, Any]:
    """Figures "effects" and "errors" as a page draws them; {} for none yet."""
    figures = {
        "effects": _effects_figure([t for t in state.traces if not t.refusal]),
        "errors": _errors_figure(state.throws),
    }
    return page_data({name: figure for name, figure in figures.items() if figure})


def _effects_figure(traces: Sequence[Trace]) -> Figure | None:
    """Each coefficient, as the traces had it; a gap where its effect was not found."""
    found: dict[tuple[str, str], dict[int, Estimate]] = {}
    for k, trace in enumerate(traces):
        for effect in trace.effects:
            for name, estimate in effect.coefficients.items():
                found.setdefault((effect.kind, name), {})[k] = estimate
    if not found:
        return None
    counts = np.array([float(len(trace.flights)) for trace in traces])
    latest = len(traces) - 1
    # What is there now comes first.
    order = sorted(found, key=lambda key: latest not in found[key])
    panels = [_coefficient_panel(*key, found[key], counts) for key in order]
    return Figure(
        keys={"corrected": "estimate; the band is 1.96 standard errors"}, panels=panels
    )


def _coefficient_panel(
    kind: str, name: str, estimates: dict[int, Estimate], counts: np.ndarray
) -> Panel:
    values, stds = np.full((2, len(counts)), np.nan)
    for k, estimate in estimates.items():
        values[k] = estimate.value
        stds[k] = estimate.std
    last = estimates.get(len(counts) - 1)
    now = format_estimate(last) if last else "no longer found"
    line = Line(
        "corrected",
        counts,
        values,
        hover="after %{x} throws: %{y:.4r}",
        has_dots=True,
        is_solid=True,
    )
    half = _WIDE * np.nan_to_num(stds)
    bands = [
        Band("corrected", counts[run], (values - half)[run], (values + half)[run])
        for run in _runs(np.isfinite(values))
    ]
    return Panel(
        f"{name_of(kind)}, {name_of(name)}: {now}",
        [Level(), *bands, line],
        Axis(_THROWS, (0.0, float(counts.max()) + 1.0)),
        height=220,
    )


def _runs(given: np.ndarray) -> list[np.ndarray]:
    """Indices of each unbroken run of True."""
    every = np.flatnonzero(given)
    return np.split(every, np.flatnonzero(np.diff(every) > 1) + 1)


def _errors_figure(throws: Sequence[Throw]) -> Figure | None:
    """Errors of the predictions throw by throw, and misses where they are known."""
    if not any(throw.errors for throw in throws):
        return None
    names = [throw.name.removesuffix(".csv") for throw in throws]
    numbers = np.arange(1.0, len(throws) + 1.0)
    span = Axis("throw", (0.0, len(throws) + 1.0))

    def points(key: str, values: list[float]) -> Points:
        millimetres = 1e3 * np.array(values)
        words = "%{hovertext}: %{y:.3r} mm"
        return Points(key, numbers, millimetres, hover=words, names=names, size=9.0)

    def of(model: str, is_fitted: bool | None = None) -> list[float]:
        shown = [is_fitted in (None, throw.is_fitted) for throw in throws]
        pairs = zip(throws, shown, strict=True)
        return [t.errors.get(model, np.nan) if s else np.nan for t, s in pairs]

    keys = {NOMINAL: "nominal"}
    errors = [points(NOMINAL, of(NOMINAL))]
    for key, is_fitted, words in (
        ("confused", True, "corrected, fitted to this throw too"),
        (CORRECTED, False, "corrected, known before the throw"),
    ):
        if np.isfinite(values := of(CORRECTED, is_fitted)).any():
            errors.append(points(key, values))
            keys[key] = words
    panels = [
        Panel(
            "error of the predicted position, RMS [mm]",
            errors,
            span,
            _log_axis(errors),
            height=240,
        )
    ]
    missed = {
        key: [np.nan if t.miss is None or t.perched != took else t.miss for t in throws]
        for key, took in (("named", True), ("worse", False))
    }
    if np.isfinite([*missed.values()]).any():
        marks = [points(key, values) for key, values in missed.items()]
        title = "distance from hook to wire [mm]"
        panels.append(Panel(title, marks, span, _log_axis(marks), height=240))
        keys |= {"named": "perched", "worse": "no perch"}
    return Figure(keys=keys, panels=panels, least_width=24.0)


def _log_axis(marks: Sequence[Points]) -> Axis:
    """A logarithmic axis that is so long that at least one of its ticks is labelled."""
    values = np.concatenate([own.y for own in marks])
    shown = values[values > 0.0]  # None that is NaN.
    if not len(shown):
        return Axis(is_log=True)
    return Axis(range=(0.5 * shown.min(), 2.0 * shown.max()), is_log=True)
