"""Figures of models: free functions, coefficients, residuals."""

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
    label, factor = VARIABLES[variable]
    values = np.column_stack([flown[name] for name in part.variables])
    low = values.min(axis=0)
    high = values.max(axis=0)
    place = np.linspace(low[0], high[0], 121)
    slices = np.linspace(low[1:], high[1:], 3 if others else 1)
    words = ""
    for name in others:
        other_label, other_factor = VARIABLES[name]
        shown = ", ".join(f"{value:.3g}" for value in slices[:, 0] * other_factor)
        words = f", thin to thick: {other_label} {shown}"
    panels = []
    for term, weights in part.weights.items():
        lines = []
        for i, other in enumerate(slices):
            at = np.column_stack([place, np.tile(other, (len(place), 1))])
            value = part.basis(at) @ weights
            width = 1.0 + i if others else None
            lines.append(
                spec.Line("rest", place * factor, value, width=width, is_solid=True)
            )
        if any(np.any(line.y) for line in lines):
            axis = spec.Axis(label, link=variable)
            panels.append(spec.Panel(TERMS[term] + words, [spec.Level(), *lines], axis))
    return panels


def _residual_tables(result: Result) -> dict[str, ResidualTable]:
    """Residuals of the model before and of the corrected one."""
    return {
        error_table.baseline(result): result.residual_before,
        "corrected": result.residual_after,
    }


def coefficients_figure(result: Result) -> spec.Figure:
    """Force and moment coefficients, before and after."""
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
) -> list[spec.Points | spec.Line]:
    """A coefficient over the angle of attack: as measured, and the model's."""
    degrees = np.degrees(table.variables["alpha"])
    measured = table.coefficients[name]
    modelled = table.modelled[name]
    return [
        _cloud(table, "measured", degrees, measured, f"{_AT}, measured"),
        _median("measured", degrees, measured, _AT),
        _median(model, degrees, modelled, _AT),
    ]


def _cloud(
    table: ResidualTable, key: str, x: np.ndarray, y: np.ndarray, said: str
) -> spec.Points:
    """Rows of a table as points that name their flight and time."""
    # The same rows in all panels: a page holds each column once.
    rows = binning.thin(np.sum(table.residual, axis=1), table.flight)
    return spec.Points(
        key,
        x[rows],
        bounded(y[rows]),
        hover=f"%{{text}}<br>{said}",
        size=3.5,
        opacity=0.45,
        flight=table.flight[rows],
        time=table.variables["t"][rows],
    )


def _median(key: str, x: np.ndarray, y: np.ndarray, said: str) -> spec.Line:
    """The medians of points, by bins."""
    place, median = binning.binned_medians(x, y)
    hover = f"median, {LABELS[key]}<br>{said}"
    return spec.Line(key, place, median, hover=hover, width=2.4, is_solid=True)


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
        words = f"{said}, {LABELS[model]}"
        clouds.append(_cloud(table, model, x, y, words))
        medians.append(_median(model, x, y, said))

    across = binning.bounds(np.concatenate(every_x))
    along = binning.bounds(np.concatenate(every_y), around=0.0)
    return spec.Panel(
        f"{name} [{unit.name}]",
        [spec.Level(), *clouds, *medians],
        spec.Axis(label, across, link=variable),
        spec.Axis(range=along, link=name),
        height=240,
    )
