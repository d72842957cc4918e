"""Figures of models: free functions, coefficients, residuals."""

from collections.abc import Mapping

import numpy as np

from glider.physics.effects.free_functions import FreeFunction
from glider.report import error_table
from glider.report.error_table import bounded
from glider.report.numbers import Unit
from glider.report.plots import binning
from glider.report.plots import figure as spec
from glider.report.plots.style import TERMS, VARIABLES
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
    """The free functions of a corrected model, over the first of their variables."""
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
    """A panel for each term; other variables are at their medians in flight."""
    names = part.variables
    label, factor = VARIABLES[names[0]]
    values = np.column_stack([flown[name] for name in names])
    place = np.linspace(values[:, 0].min(), values[:, 0].max(), 121)
    at = np.tile(np.median(values, axis=0), (len(place), 1))
    at[:, 0] = place
    words = ""
    for name, value in zip(names[1:], at[0, 1:], strict=True):
        other, size = VARIABLES[name]
        words += f", at {other} {value * size:.3g}"

    panels = []
    for term, weights in part.weights.items():
        if np.any(weights):
            line = spec.Line(
                "rest", place * factor, part.basis(at) @ weights, is_solid=True
            )
            x_axis = spec.Axis(label, link=names[0])
            marks: list[spec.Mark] = [spec.Level(), line]
            panels.append(spec.Panel(TERMS[term] + words, marks, x_axis))

    return panels


def _residual_tables(result: Result) -> dict[str, ResidualTable]:
    """Residuals of the model before and of the corrected one."""
    return {
        error_table.baseline(result): result.residual_before,
        "corrected": result.residual_after,
    }


def _marks(
    key: str, table: ResidualTable, x: np.ndarray, y: np.ndarray, said: str
) -> tuple[spec.Points, spec.Line]:
    """The points of a table's rows (N,), of which some are drawn, and their median."""
    # The same rows in all panels: a flight is picked in all of them.
    total = np.sum(table.residual, axis=1)
    rows = binning.thin(total, table.flight)
    cloud = spec.Points(
        key,
        x[rows],
        bounded(y[rows]),
        hover=f"%{{text}}<br>{said}, {key}",
        size=3.5,
        opacity=0.45,
        flight=table.flight[rows],
        time=table.variables["t"][rows],
    )

    place, [median] = binning.binned_quantiles(x, y)
    hover = f"median, {key}<br>{said}"
    return cloud, spec.Line(key, place, median, hover=hover, width=2.4, is_solid=True)


def coefficients_figure(result: Result) -> spec.Figure:
    """Force and moment coefficients of all rows, before and after."""
    tables = _residual_tables(result)
    label, factor = VARIABLES["alpha"]
    panels = []
    for model, table in tables.items():
        degrees = table.variables["alpha"] * factor
        for name, symbol in _COEFFICIENTS.items():
            shown = [t.coefficients[name] for t in tables.values()]
            shown += [t.modelled[name] for t in tables.values()]
            span = binning.bounds(np.concatenate(shown))
            measured = _marks("measured", table, degrees, table.coefficients[name], _AT)
            modelled = _marks(model, table, degrees, table.modelled[name], _AT)
            panel = spec.Panel(
                f"{symbol}, {model}",
                [*measured, modelled[1]],
                spec.Axis(label, link="alpha"),
                spec.Axis(range=span, link=name),
                height=250,
            )

            panels.append(panel)

    return spec.Figure(
        keys={m: m for m in ("measured", *tables)},
        panels=panels,
        flights=result.residual_after.names,
    )


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
        keys={m: m for m in tables}, panels=panels, flights=result.residual_after.names
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
        cloud, median = _marks(model, table, x, y, said)
        clouds.append(cloud)
        medians.append(median)

    across = binning.bounds(np.concatenate(every_x))
    along = binning.bounds(np.concatenate(every_y))
    return spec.Panel(
        f"{name} [{unit.name}]",
        [spec.Level(), *clouds, *medians],
        spec.Axis(label, across, link=variable),
        spec.Axis(range=along, link=name),
        height=240,
    )
