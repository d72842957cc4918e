"""Figures of models: free functions, coefficients, residuals."""

import dataclasses
import math
from collections.abc import Mapping

import numpy as np

from glider.physics.effects.free_functions import FreeFunction
from glider.report import error_table
from glider.report.error_table import bounded
from glider.report.numbers import Unit
from glider.report.plots import binning
from glider.report.plots import figure as spec
from glider.report.plots.style import LABELS, TERMS, VARIABLES
from glider.sysid.result import ResidualTable, Result

RESIDUALS = {
    "along the wing": Unit(name="m/s²"),
    "normal to it": Unit(name="m/s²"),
    "in pitch": Unit(name="rad/s²"),
}
"""Columns of a residual, with their units."""

_COEFFICIENTS = {"c_lift": "$C_L$", "c_drag": "$C_D$", "c_moment": "$C_M$ [m]"}
"""Coefficient to its symbol; that of the moment is without a chord."""

_MOST_VARIABLES = 3
"""Variables that residuals are drawn against, of the strongest effects first."""

_AT = "α %{x:.1f}°: %{y:.3r}"


def free_functions_figure(result: Result) -> spec.Figure | None:
    """The free functions of a corrected model.

    Over one variable; of two, over the first, at three values of the second.
    """
    functions = result.model.free_functions
    parts = [p for p in functions if len(p.variables) in (1, 2) and p.centers]
    flown = result.residual_after.variables
    panels = [panel for part in parts for panel in _function_panels(part, flown)]
    if not panels:
        return None
    keys = {"rest": "free function of the corrected model"}
    return spec.Figure(keys=keys, panels=panels)


def _function_panels(
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
        spec.Panel(
            TERMS[term],
            [spec.Level(), *own],
            spec.Axis(VARIABLES[variable][0], link=variable),
        )
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
        for name, symbol in _COEFFICIENTS.items():
            shown = [t.coefficients[name] for t in tables.values()]
            shown += [t.modelled[name] for t in tables.values()]
            span = binning.bounds(np.concatenate(shown))

            panel = spec.Panel(
                f"{symbol}, {LABELS[model]}",
                _coefficient_marks(table, name, model),
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


def _coefficient_marks(
    table: ResidualTable, name: str, model: str
) -> list[spec.Line | spec.Band]:
    """A coefficient over the angle of attack: each flight, all of them, the model."""
    degrees = np.degrees(table.variables["alpha"])
    measured = table.coefficients[name]
    modelled = table.modelled[name]
    alpha = []
    middle = []
    flight = []

    for number in np.unique(table.flight):
        rows = table.flight == number
        place, [median] = binning.binned_quantiles(
            degrees[rows], measured[rows], bins=12, fewest=2
        )
        # NaN leaves a gap between flights.
        alpha.append(np.append(place, math.nan))
        middle.append(np.append(median, math.nan))
        flight.append(np.full(len(place) + 1, number))
    each = spec.Line(
        "measured",
        np.concatenate(alpha),
        bounded(np.concatenate(middle)),
        hover=f"%{{text}}<br>{_AT}",
        width=0.6,
        is_solid=True,
        opacity=0.4,
        flight=np.concatenate(flight),
    )

    sixths = (1 / 6, 0.5, 5 / 6)
    place, [low, median, high] = binning.binned_quantiles(degrees, measured, sixths)
    hover = f"measured, median<br>{_AT}"
    band = spec.Band("measured", place, low, high)
    middle_line = spec.Line("measured", place, median, hover=hover)

    place, [median] = binning.binned_quantiles(degrees, modelled)
    hover = f"{LABELS[model]}, median<br>{_AT}"
    model_line = spec.Line(model, place, median, hover=hover, width=2.0)
    return [each, band, middle_line, model_line]


def residual_figure(result: Result) -> spec.Figure | None:
    """Residuals against up to three variables, before and after."""
    tables = _residual_tables(result)
    wanted = [name for e in result.effects for name in e.depends_on]
    if len(set(wanted)) < 2:
        wanted += ["alpha", "V"]
    variables = []
    for name in dict.fromkeys(wanted):
        if all(_varies(table, name) for table in tables.values()):
            variables.append(name)
    variables = variables[:_MOST_VARIABLES]
    if not variables:
        return None

    panels = []
    for column in range(len(RESIDUALS)):
        for name in variables:
            panels.append(residual_panel(tables, name, column))

    return spec.Figure(
        keys={m: LABELS[m] for m in tables},
        panels=panels,
        flights=result.residual_after.names,
    )


def _varies(table: ResidualTable, name: str) -> bool:
    """Whether a variable has more than one value."""
    values = table.variables.get(name, np.zeros(0))
    finite = values[np.isfinite(values)]
    return len(np.unique(finite)) > 1


def residual_panel(
    tables: dict[str, ResidualTable], variable: str, column: int
) -> spec.Panel:
    """Residuals of models against a variable, with their binned medians."""
    name, unit = list(RESIDUALS.items())[column]
    label, factor = VARIABLES[variable]
    said = f"%{{x:.3r}}: %{{y:.3r}} {unit.name}"
    clouds = []
    medians = []
    every_x = []
    every_y = []

    for model, table in tables.items():
        x = table.variables[variable] * factor
        y = table.residual[:, column]
        every_x.append(x)
        every_y.append(y)

        # The same rows in all panels: a page holds each column once.
        total = np.sum(table.residual, axis=1)
        rows = binning.thin(total, table.flight)
        cloud = spec.Points(
            model,
            x[rows],
            bounded(y[rows]),
            hover=f"%{{text}}<br>{said}, {LABELS[model]}",
            size=3.5,
            opacity=0.45,
            flight=table.flight[rows],
            time=table.variables["t"][rows],
        )
        clouds.append(cloud)

        place, [median] = binning.binned_quantiles(x, y)
        line = spec.Line(
            model,
            place,
            median,
            hover=f"median, {LABELS[model]}<br>{said}",
            width=2.4,
            is_solid=True,
        )
        medians.append(line)

    across = binning.bounds(np.concatenate(every_x))
    along = binning.bounds(np.concatenate(every_y), around=0.0)
    return spec.Panel(
        f"{name} [{unit.name}]",
        [spec.Level(), *clouds, *medians],
        spec.Axis(label, across, link=variable),
        spec.Axis(range=along, link=name),
        height=240,
    )
