"""Charts of what models are: errors, evidence, curves, coefficients, residuals."""

import math

import numpy as np

from glider.report.chart import (
    Axis,
    Chart,
    Panel,
    Trace,
    band,
    dash_of,
    level,
    line,
    log_range,
    numbers,
    points,
    symlog,
)
from glider.report.error_table import columns_of, noise_floor
from glider.report.figure_data import (
    COEFFICIENTS,
    ERROR_PANELS,
    RESIDUALS,
    ErrorPanel,
    carried_curves,
    has_coefficients,
    residual_tables,
    residual_variables,
)
from glider.report.flight_errors import bounded
from glider.report.plots.axes import bounds, evidence_ticks, thin
from glider.report.plots.bars import short
from glider.report.plots.curves import BAND
from glider.report.plots.residuals import binned_median, binned_quantiles
from glider.report.plots.style import LABELS, TERMS, VARIABLES
from glider.sysid.result import Curve, ResidualTable, Result

WIDE = 60.0
"""Width of a panel that stands alone in its row [rem]."""

NOISE = {"noise": "noise of the measurement"}
"""Entry of the legend."""


_MOST_UPRIGHT = 8
"""Bars beside one another whose numbers have room to stand upright."""


def errors_chart(result: Result) -> Chart | None:
    """Returns the errors of each model as groups of bars."""
    models = columns_of(result)
    if not models:
        return None
    return Chart(
        least_width=14.0,
        keys={m: LABELS[m] for m in models} | NOISE,
        panels=[_error_panel(result, models, panel) for panel in ERROR_PANELS],
    )


def _error_panel(result: Result, models: list[str], panel: ErrorPanel) -> Panel:
    size, unit = panel.unit.size, panel.unit.name
    names = [name.replace("\n", "<br>") for name in panel.fields.values()]
    floor = [noise_floor(result, f) / size for f in panel.fields]
    traces, heights = [], [v for v in floor if v > 0.0]
    for model in models:
        errors = result.errors[model]
        values = [float(bounded(getattr(errors, f))) / size for f in panel.fields]
        heights += [v for v in values if v > 0.0]
        traces.append(
            {
                "type": "bar",
                "key": model,
                "x": names,
                "y": numbers(values),
                "text": [short(v) for v in values],
                "textposition": "outside",
                "textangle": -90 if len(models) * len(names) > _MOST_UPRIGHT else 0,
                "cliponaxis": False,
                "marker": {"color": f"@{model}"},
                "hovertemplate": f"{LABELS[model]}: %{{y:.3r}} {unit}<extra></extra>",
            }
        )
    traces.append(noise_marks(names, floor, unit))
    low, high = min(heights, default=1.0), max(heights, default=10.0)
    return Panel(
        title=f"{panel.title} [{unit}]",
        traces=traces,
        y=Axis(is_log=True, range=log_range(0.4 * low, 3.0 * high)),
        x=Axis(more={"type": "category"}),
    )


def noise_marks(names: list[str], floor: list[float], unit: str) -> Trace:
    """Returns a dash at the noise of each name."""
    return points(
        "noise",
        names,
        numbers(floor),
        f"noise: %{{y:.3r}} {unit}",
        marker={
            "symbol": "line-ew",
            "size": 44,
            "line": {"width": 2, "color": "@noise"},
        },
    )


def evidence_chart(result: Result) -> Chart | None:
    """Returns what each kind gains alone, the strongest on top."""
    if not result.candidates:
        return None
    chosen = {e.kind for e in result.effects}
    confused = {k for e in result.effects for k in e.indistinguishable_from} - chosen
    values = {k: v for k, v in result.candidates.items() if math.isfinite(v)}
    ranked = sorted(values, key=lambda k: values[k])
    keys = {
        "chosen": "in the corrected model",
        "confused": "cannot be told from it",
        "other": "not taken",
    }
    groups = {
        "chosen": [k for k in ranked if k in chosen],
        "confused": [k for k in ranked if k in confused],
        "other": [k for k in ranked if k not in chosen | confused],
    }
    low, high = min([*values.values(), 0.0]), max([*values.values(), 100.0])
    ticks = evidence_ticks(low, high)
    traces = [
        {
            "type": "bar",
            "orientation": "h",
            "key": key,
            "y": [k.replace("_", " ") for k in kinds],
            "x": [symlog(values[k]) for k in kinds],
            "customdata": numbers(values[k] for k in kinds),
            "text": [_nats(values[k]) for k in kinds],
            "textposition": "outside",
            "cliponaxis": False,
            "marker": {"color": f"@{key}"},
            "hovertemplate": "%{y}: %{customdata:,.1f} nats<extra></extra>",
        }
        for key, kinds in groups.items()
    ]
    names = [k.replace("_", " ") for k in ranked]
    panel = Panel(
        title="",
        traces=traces,
        x=Axis(
            title="evidence when tried alone [nats], linear below 10",
            range=(symlog(low) - (0.4 if low < 0.0 else 0.0), symlog(high) + 0.6),
            more={
                "tickvals": [symlog(t) for t in ticks],
                "ticktext": [f"{t:,.0f}" for t in ticks],
            },
        ),
        y=Axis(more={"categoryorder": "array", "categoryarray": names, "dtick": 1}),
        height=80 + 21 * len(names),
        barmode="overlay",
    )
    shown = {key: words for key, words in keys.items() if groups[key]}
    return Chart(keys=shown, panels=[panel], least_width=WIDE)


def _nats(value: float) -> str:
    return f"{value:,.0f}" if abs(value) >= 10.0 else f"{value:.1f}"


def curves_chart(result: Result) -> Chart | None:
    """Returns what the plate lacks in each term, over the angle of attack."""
    if not result.curves:
        return None
    keys = {"lack": "the plate lacks", "named": "named", "rest": "has no name"}
    dashes = {"named": "6px,3px", "rest": "2px,2px"}
    panels = []
    for curve in result.curves:
        alpha = numbers(np.degrees(curve.alpha))
        style = {"width": 2, "color": "@named", "dash": dashes["named"]}
        rest = {"width": 2, "color": "@rest", "dash": dashes["rest"]}
        panels.append(
            Panel(
                title=TERMS.get(curve.term, curve.term.replace("_", " ")),
                traces=[
                    *lack_traces("lack", curve),
                    line("named", alpha, numbers(curve.named), _AT, line=style),
                    line(
                        "rest", alpha, numbers(curve.lack - curve.named), _AT, line=rest
                    ),
                ],
                x=Axis(title=VARIABLES["alpha"][0], link="alpha"),
                shapes=[level(0.0)],
            )
        )
    return Chart(keys=keys, dashes=dashes, panels=panels)


_AT = "α %{x:.1f}°: %{y:.3r}"


def lack_traces(key: str, curve: Curve) -> list[Trace]:
    """Returns what a plate lacks with its band."""
    alpha = numbers(np.degrees(curve.alpha))
    return [
        *band(
            key,
            alpha,
            numbers(curve.lack - BAND * curve.std),
            numbers(curve.lack + BAND * curve.std),
            0.18,
        ),
        line(
            key,
            alpha,
            numbers(curve.lack),
            _AT + " ± %{customdata:.2r}",
            width=2.4,
            customdata=numbers(curve.std),
        ),
    ]


def carried_chart(result: Result) -> Chart | None:
    """Returns what the model carries without a name."""
    curves = carried_curves(result)
    if not curves:
        return None
    panels = []
    for curve in curves:
        label, factor = VARIABLES[curve.variable]
        panels.append(
            Panel(
                title=TERMS[curve.term],
                traces=[
                    line(
                        "rest",
                        numbers(curve.place * factor),
                        numbers(curve.value),
                        "%{x:.3r}: %{y:.3r}",
                        width=2,
                    )
                ],
                x=Axis(title=label, link=curve.variable),
                shapes=[level(0.0)],
            )
        )
    return Chart(keys={"rest": "carried without a name"}, panels=panels)


def coefficients_chart(result: Result) -> Chart | None:
    """Returns force and moment coefficients, flight by flight, before and after."""
    if not has_coefficients(result):
        return None
    tables, columns = residual_tables(result), {}
    panels = []
    for model, table in tables.items():
        lines = _flight_lines(table)
        columns[f"{model} alpha"] = numbers(lines["alpha"])
        columns[f"{model} flight"] = lines["flight"].astype(int).tolist()
        for name, letter in COEFFICIENTS.items():
            columns[f"{model} {name}"] = numbers(bounded(lines[name]))
            both = [
                t[name] for o in tables.values() for t in (o.coefficients, o.modelled)
            ]
            unit = " [m]" if name == "c_moment" else ""
            panels.append(
                Panel(
                    title=f"${letter}${unit}, {LABELS[model]}",
                    traces=_coefficient_traces(table, name, model),
                    x=Axis(title=VARIABLES["alpha"][0], link="alpha"),
                    y=Axis(range=bounds(np.concatenate(both)), link=name),
                    height=250,
                )
            )
    shown = dict.fromkeys(("measured", *tables))
    return Chart(
        keys={m: LABELS[m] for m in shown},
        panels=panels,
        columns=columns,
        flights=result.residual_after.names,
        dashes={m: dash_of(m) for m in shown},
    )


def _flight_lines(table: ResidualTable) -> dict[str, np.ndarray]:
    """Returns medians over the angle of attack, flight by flight with gaps between."""
    degrees = np.degrees(table.variables["alpha"])
    lines: dict[str, list[np.ndarray]] = {n: [] for n in ("alpha", "flight")}
    for number in np.unique(table.flight):
        rows, gap = table.flight == number, [math.nan]
        for name in COEFFICIENTS:
            place, middle = binned_quantiles(
                degrees[rows], table.coefficients[name][rows], (0.5,), 12, 2
            )
            lines.setdefault(name, []).append(np.append(middle[0], gap))
        lines["alpha"].append(np.append(place, gap))
        lines["flight"].append(np.full(len(place) + 1, number))
    return {name: np.concatenate(parts) for name, parts in lines.items()}


def _coefficient_traces(table: ResidualTable, name: str, model: str) -> list[Trace]:
    degrees, measured = np.degrees(table.variables["alpha"]), table.coefficients[name]
    place, band_of = binned_quantiles(degrees, measured, (1 / 6, 0.5, 5 / 6))
    low, median, high = (numbers(row) for row in band_of)
    over, modelled = binned_median(degrees, table.modelled[name])
    return [
        line(
            "measured",
            f"#{model} alpha",
            f"#{model} {name}",
            f"%{{text}}<br>{_AT}",
            width=0.6,
            opacity=0.4,
            of={"flight": f"#{model} flight"},
        ),
        *band("measured", numbers(place), low, high, 0.16),
        line("measured", numbers(place), median, f"measured, median<br>{_AT}", width=3),
        line(
            model,
            numbers(over),
            numbers(modelled),
            f"{LABELS[model]}, median<br>{_AT}",
            width=2,
        ),
    ]


def residual_chart(result: Result) -> Chart | None:
    """Returns residuals against the variables that matter, before and after."""
    variables = residual_variables(result)
    if not variables:
        return None
    tables, columns = residual_tables(result), {}
    for model, table in tables.items():
        # Of all rows as many as the figures draw; the medians take all.
        rows = thin(np.sum(table.residual, axis=1), table.flight)
        for name in (*variables, "t"):
            values = table.variables.get(name, np.full(table.flight.shape, math.nan))
            scale = VARIABLES.get(name, ("", 1.0))[1]
            columns[f"{model} {name}"] = numbers(values[rows] * scale)
        columns[f"{model} flight"] = table.flight[rows].astype(int).tolist()
        for column, name in enumerate(RESIDUALS):
            columns[f"{model} {name}"] = numbers(bounded(table.residual[rows, column]))
    return Chart(
        keys={m: LABELS[m] for m in tables},
        panels=[
            _residual_panel(tables, variable, column)
            for column in range(len(RESIDUALS))
            for variable in variables
        ],
        columns=columns,
        flights=result.residual_after.names,
    )


def _residual_panel(
    tables: dict[str, ResidualTable], variable: str, column: int
) -> Panel:
    name, unit = list(RESIDUALS.items())[column]
    label, factor = VARIABLES.get(variable, (variable.replace("_", " "), 1.0))
    clouds, medians = [], []
    for model, table in tables.items():
        hover = f"%{{text}}<br>%{{x:.3r}}: %{{y:.3r}} {unit.name}, {LABELS[model]}"
        clouds.append(
            points(
                model,
                f"#{model} {variable}",
                f"#{model} {name}",
                hover,
                marker={"color": f"@{model}", "size": 3.5, "opacity": 0.45},
                of={"flight": f"#{model} flight", "time": f"#{model} t"},
            )
        )
        place, middle = binned_median(
            table.variables[variable] * factor, table.residual[:, column]
        )
        medians.append(
            line(
                model,
                numbers(place),
                numbers(middle),
                f"median, {LABELS[model]}<br>%{{x:.3r}}: %{{y:.3r}} {unit.name}",
                width=2.4,
            )
        )
    everything = np.concatenate([t.residual[:, column] for t in tables.values()])
    over = np.concatenate([t.variables[variable] for t in tables.values()]) * factor
    return Panel(
        title=f"{name} [{unit.name}]",
        traces=[*clouds, *medians],
        x=Axis(title=label, range=bounds(over), link=variable),
        y=Axis(range=bounds(everything, around=0.0), link=name),
        shapes=[level(0.0)],
        height=240,
    )
