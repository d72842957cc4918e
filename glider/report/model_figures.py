"""Figures of what models are: errors, evidence, curves, coefficients, residuals."""

import dataclasses
import itertools
import math
from collections.abc import Mapping

import numpy as np

from glider.physics.effects.free_functions import FreeFunction
from glider.report import error_table
from glider.report.error_table import bounded
from glider.report.numbers import DEGREE, MILLIMETRE, Unit
from glider.report.plots import binning
from glider.report.plots import figure as spec
from glider.report.plots.style import LABELS, TERMS, VARIABLES
from glider.sysid.report import PERFECT, Curve
from glider.sysid.result import ResidualTable, Result

BAND = 2.0  # Standard errors on either side of a curve.

RESIDUALS = {
    "along the wing": Unit(name="m/s²"),
    "normal to it": Unit(name="m/s²"),
    "in pitch": Unit(name="rad/s²"),
}
"""Columns of a residual, with their units."""

_COEFFICIENTS = {"c_lift": "$C_L$", "c_drag": "$C_D$", "c_moment": "$C_M$ [m]"}
"""Coefficient to its symbol; that of the moment is without a chord."""

_ERROR_PANELS = (
    (
        "acceleration",
        Unit(name="m/s²"),
        {"equation.tangential": "along wing", "equation.normal": "normal"},
    ),
    ("acceleration", Unit(name="rad/s²"), {"equation.pitch": "in pitch"}),
    (
        "position",
        MILLIMETRE,
        {
            error_table.FREE: "RMS",
            error_table.END: "at the end",
            error_table.ALONG: "measured\npitch, RMS",
        },
    ),
    ("pitch", DEGREE, {error_table.PITCH: "RMS"}),
)
"""Title and unit of errors side by side, their fields and names."""

_AT = "α %{x:.1f}°: %{y:.3r}"


def errors_figure(result: Result) -> spec.Figure | None:
    """Errors of each model as groups of bars."""
    models = error_table.columns_of(result)
    if not models:
        return None
    return spec.Figure(
        keys={m: LABELS[m] for m in models} | {"floor": "a perfect model"},
        panels=[_error_panel(result, models, *panel) for panel in _ERROR_PANELS],
        columns=2,
        least_width=24.0,
    )


def _error_panel(
    result: Result, models: list[str], title: str, unit: Unit, fields: dict[str, str]
) -> spec.Panel:
    places = np.arange(len(fields), dtype=float)
    values = {
        m: bounded(np.array([error_table.error_of(result, m, f) for f in fields]))
        / unit.size
        for m in (*models, PERFECT)
    }
    floor = values.pop(PERFECT)
    every = np.concatenate([floor, *values.values()])
    every = every[np.isfinite(every) & (every > 0.0)]
    low, high = (every.min(), every.max()) if every.size else (1.0, 10.0)
    dashes = np.ravel(places[:, None] + [-0.45, 0.0, 0.45, math.nan])
    hover = f"a perfect model: %{{y:.3r}} {unit.name}"
    dashed = spec.Line("floor", dashes, np.repeat(floor, 4), hover=hover)
    names = {float(i): name for i, name in enumerate(fields.values())}
    return spec.Panel(
        f"{title} [{unit.name}]",
        [*_grouped_bars(values, LABELS, unit), dashed],
        x=spec.Axis(range=(-0.6, len(fields) - 0.4), ticks=names),
        y=spec.Axis(is_log=True, range=(0.4 * low, 4.0 * high)),
        share=len(fields) + 0.6,
    )


def _grouped_bars(
    values: dict[str, np.ndarray], labels: dict[str, str], unit: Unit
) -> list[spec.Bars]:
    """Bars of several keys side by side, one group at each whole number."""
    width = 0.8 / max(len(values), 1)
    return [
        spec.Bars(
            key=key,
            places=np.arange(len(row)) + (i - (len(values) - 1) / 2) * width,
            values=row,
            texts=[_short(v) for v in row],
            hover=f"{labels[key]}: %{{y:.3r}} {unit.name}",
            width=0.92 * width,
        )
        for i, (key, row) in enumerate(values.items())
    ]


def _short(value: float) -> str:
    """Two digits, without an exponent while that stays short."""
    if not math.isfinite(value):
        return "–"
    if 100.0 <= value < 1e5:
        return f"{value:.0f}"
    return f"{value:#.2g}".removesuffix(".")


def curves_figure(result: Result) -> spec.Figure | None:
    """Terms that the plate lacks, over the angle of attack."""
    if not result.curves:
        return None
    keys = {
        "lack": f"the plate lacks, ± {BAND:g} standard errors",
        "named": "identified",
        "rest": "unidentified",
    }
    panels = []
    for curve in result.curves:
        alpha = np.degrees(curve.alpha)
        rest = curve.lack - curve.named
        marks = [
            *_lack_marks("lack", curve),
            spec.Line("named", alpha, curve.named, hover=_AT),
            spec.Line("rest", alpha, rest, hover=_AT),
        ]
        panels.append(_term_panel(curve.term, marks, "alpha"))
    return spec.Figure(keys=keys, panels=panels, columns=min(2, len(panels)))


def _term_panel(
    term: str, marks: list[spec.Line | spec.Band], variable: str
) -> spec.Panel:
    """Panel of a term of forces over a variable."""
    return spec.Panel(
        title=TERMS[term],
        marks=[spec.Level(), *marks],
        x=spec.Axis(label=VARIABLES[variable][0], link=variable),
    )


def _lack_marks(key: str, curve: Curve) -> list[spec.Line | spec.Band]:
    """Curve of what a plate lacks with its band."""
    alpha = np.degrees(curve.alpha)
    half = BAND * curve.std
    return [
        spec.Band(key, alpha, curve.lack - half, curve.lack + half),
        spec.Line(
            key, alpha, curve.lack, hover=_AT + " ± %{customdata:.2r}", extra=curve.std
        ),
    ]


def carried_figure(result: Result) -> spec.Figure | None:
    """The free functions of a corrected model.

    Over one variable; of two, over the first, at three values of the second.
    """
    functions = result.model.free_functions
    parts = [p for p in functions if len(p.variables) in (1, 2) and p.centers]
    flown = result.residual_after.variables
    panels = [panel for part in parts for panel in _carried_panels(part, flown)]
    if not panels:
        return None
    keys = {"rest": "unidentified, carried by the model"}
    return spec.Figure(keys=keys, panels=panels, columns=min(2, len(panels)))


def _carried_panels(
    part: FreeFunction, flown: Mapping[str, np.ndarray]
) -> list[spec.Panel]:
    variable, *others = part.variables
    values = np.column_stack([flown[name] for name in part.variables])
    low = values.min(axis=0)
    high = values.max(axis=0)
    place = np.linspace(low[0], high[0], 121)
    slices = np.linspace(low[1:], high[1:], 3 if others else 1)
    lines: dict[str, list[spec.Line]] = {}
    for i, other in enumerate(slices):
        at = np.column_stack([place, np.tile(other, (len(place), 1))])
        basis = part.basis(at)
        width = 1.0 + i if others else None
        for term, weights in part.weights.items():
            value = basis @ weights
            scaled = place * VARIABLES[variable][1]
            line = spec.Line("rest", scaled, value, width=width, is_solid=True)
            lines.setdefault(term, []).append(line)
    panels = [
        _term_panel(term, [*own], variable)
        for term, own in lines.items()
        if any(np.any(line.y != 0.0) for line in own)
    ]
    for name in others:
        label, factor = VARIABLES[name][:2]
        shown = ", ".join(f"{value:.3g}" for value in slices[:, 0] * factor)
        words = f", thin to thick: {label} {shown}"
        panels = [dataclasses.replace(p, title=p.title + words) for p in panels]
    return panels


def _residual_tables(result: Result) -> dict[str, ResidualTable]:
    """Residuals of the model before and of the corrected one."""
    return {
        error_table.baseline(result): result.residual_before,
        "corrected": result.residual_after,
    }


def coefficients_figure(result: Result) -> spec.Figure:
    """Force and moment coefficients, flight by flight, before and after."""
    tables = _residual_tables(result)
    panels = []
    for model, table in tables.items():
        lines = _flight_lines(table)
        for name, symbol in _COEFFICIENTS.items():
            both = [(t.coefficients[name], t.modelled[name]) for t in tables.values()]
            span = binning.bounds(np.concatenate(sum(both, ())))
            panel = spec.Panel(
                f"{symbol}, {LABELS[model]}",
                _coefficient_marks(table, lines, name, model),
                spec.Axis(VARIABLES["alpha"][0], link="alpha"),
                spec.Axis(range=span, link=name),
                height=250,
            )
            panels.append(panel)
    return spec.Figure(
        keys={m: LABELS[m] for m in ("measured", *tables)},
        panels=panels,
        flights=result.residual_after.names,
    )


def _flight_lines(table: ResidualTable) -> dict[str, np.ndarray]:
    """Medians over the angle of attack, flight by flight with gaps between."""
    degrees = np.degrees(table.variables["alpha"])
    lines: dict[str, list[np.ndarray]] = {n: [] for n in ("alpha", "flight")}
    for number in np.unique(table.flight):
        rows = table.flight == number
        gap = [math.nan]
        for name in _COEFFICIENTS:
            place, middle = binning.binned_quantiles(
                degrees[rows], table.coefficients[name][rows], bins=12, fewest=2
            )
            lines.setdefault(name, []).append(np.append(middle[0], gap))
        lines["alpha"].append(np.append(place, gap))
        lines["flight"].append(np.full(len(place) + 1, number))
    return {name: np.concatenate(parts) for name, parts in lines.items()}


def _coefficient_marks(
    table: ResidualTable, lines: dict[str, np.ndarray], name: str, model: str
) -> list[spec.Line | spec.Band]:
    degrees = np.degrees(table.variables["alpha"])
    measured = table.coefficients[name]
    place, rows = binning.binned_quantiles(degrees, measured, (1 / 6, 0.5, 5 / 6))
    over, modelled = binning.binned_quantiles(degrees, table.modelled[name])
    hover = f"{LABELS[model]}, median<br>{_AT}"
    return [
        spec.Line(
            "measured",
            lines["alpha"],
            bounded(lines[name]),
            hover=f"%{{text}}<br>{_AT}",
            width=0.6,
            is_solid=True,
            opacity=0.4,
            flight=lines["flight"],
        ),
        spec.Band("measured", place, rows[0], rows[2]),
        spec.Line("measured", place, rows[1], hover=f"measured, median<br>{_AT}"),
        spec.Line(model, over, modelled[0], hover=hover, width=2.0),
    ]


def residual_figure(result: Result) -> spec.Figure | None:
    """Residuals against the variables that matter, before and after."""
    variables = _residual_variables(result)
    if not variables:
        return None
    tables = _residual_tables(result)
    pairs = itertools.product(range(len(RESIDUALS)), variables)
    return spec.Figure(
        keys={m: LABELS[m] for m in tables},
        panels=[residual_panel(tables, name, column) for column, name in pairs],
        columns=len(variables),
        flights=result.residual_after.names,
    )


def _residual_variables(result: Result) -> list[str]:
    """Up to three variables, those of the strongest effects first."""
    wanted = [name for e in result.effects for name in e.depends_on]
    if len(set(wanted)) < 2:
        wanted += ["alpha", "V"]
    tables = _residual_tables(result).values()
    there = [n for n in dict.fromkeys(wanted) if all(_varies(t, n) for t in tables)]
    return there[: max(2, min(3, len(there)))]


def _varies(table: ResidualTable, name: str) -> bool:
    values = table.variables.get(name, np.zeros(0))
    values = values[np.isfinite(values)]
    return values.size > 0 and float(np.ptp(values)) > 0.0


def residual_panel(
    tables: dict[str, ResidualTable], variable: str, column: int
) -> spec.Panel:
    """Residuals of models against a variable, with their binned medians."""
    name, unit = list(RESIDUALS.items())[column]
    label, factor = VARIABLES[variable]
    clouds = []
    medians = []
    for model, table in tables.items():
        x = table.variables[variable] * factor
        y = table.residual[:, column]
        # The same rows in all panels: a page holds each column once.
        rows = binning.thin(np.sum(table.residual, axis=1), table.flight)
        time = table.variables["t"]
        said = f"%{{x:.3r}}: %{{y:.3r}} {unit.name}"
        clouds.append(
            spec.Points(
                model,
                x[rows],
                bounded(y[rows]),
                hover=f"%{{text}}<br>{said}, {LABELS[model]}",
                size=3.5,
                opacity=0.45,
                flight=table.flight[rows],
                time=time[rows],
            )
        )
        place, median = binning.binned_quantiles(x, y)
        hover = f"median, {LABELS[model]}<br>{said}"
        medians.append(
            spec.Line(model, place, median[0], hover=hover, width=2.4, is_solid=True)
        )
    everything = np.concatenate([t.residual[:, column] for t in tables.values()])
    over = np.concatenate([t.variables[variable] for t in tables.values()]) * factor
    return spec.Panel(
        f"{name} [{unit.name}]",
        [spec.Level(), *clouds, *medians],
        spec.Axis(label, binning.bounds(over), link=variable),
        spec.Axis(range=binning.bounds(everything, around=0.0), link=name),
        height=240,
    )
