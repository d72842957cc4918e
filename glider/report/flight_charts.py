"""Charts of flights: held-out ones beside the models, folds, own values."""

import math

import numpy as np

from glider.report.chart import (
    Axis,
    Chart,
    Choice,
    Panel,
    Trace,
    dash_of,
    level,
    line,
    log_range,
    numbers,
    points,
    shade,
)
from glider.report.error_table import COLUMNS, unit_beside_noise
from glider.report.figure_data import fold_panels, shown_flights, spread_panels
from glider.report.flight_errors import bounded, distance, position_rms, rank_flights
from glider.report.plots.axes import bounds
from glider.report.plots.style import LABELS
from glider.sysid.result import HeldOutFlight, Result

MOST_FLIGHTS = 120
"""Held-out flights that a page holds: the best and the worst, and between."""

_ROWS = 120
"""Rows that are drawn of a flight at most."""


def flights_in_page(result: Result) -> list[HeldOutFlight]:
    """Returns the flights to choose from, from the worst corrected to the best."""
    ranked = rank_flights(result)[::-1]
    count = min(MOST_FLIGHTS, len(ranked))
    ranks = np.linspace(0, len(ranked) - 1, count).round().astype(int)
    shown = {flight.name for flight in shown_flights(result)}
    kept = {ranked[i].name for i in ranks} | shown
    return [flight for flight in ranked if flight.name in kept]


def held_out_chart(result: Result) -> Chart | None:
    """Returns held-out flights, measured and flown by each model, to choose from."""
    flights = flights_in_page(result)
    if not flights:
        return None
    shown = {flight.name for flight in shown_flights(result)}
    errors = [position_rms(flight, "corrected") for flight in flights]
    unit = unit_beside_noise(result, *errors)
    flown = [m for m in COLUMNS if any(m in flight.flown for flight in flights)]
    return Chart(
        keys={m: LABELS[m] for m in ("measured", *flown)}
        | {"fitted": "launch state fitted"},
        dashes={m: dash_of(m) for m in flown},
        columns={
            flight.name: numbers(flight.time[_rows_of(flight)]) for flight in flights
        },
        choices=[
            Choice(
                label=flight.name.removesuffix(".csv"),
                note=unit.text(error),
                panels=_panels_of(flight, result.noise_position_m),
                is_shown=flight.name in shown,
            )
            for flight, error in zip(flights, errors, strict=True)
        ],
    )


def _rows_of(flight: HeldOutFlight) -> np.ndarray:
    """Returns the rows of a flight that are drawn."""
    count = len(flight.time)
    return np.unique(np.linspace(0, count - 1, min(_ROWS, count)).astype(int))


def _panels_of(flight: HeldOutFlight, noise: float) -> list[Panel]:
    rows = _rows_of(flight)
    time, measured = flight.time[rows], flight.measured[rows]
    flown = {m: bounded(flight.flown[m])[rows] for m in COLUMNS if m in flight.flown}
    clock, fitted = f"#{flight.name}", time <= flight.fitted_until
    degrees = np.degrees(measured[:, 2])
    apart = {m: distance(pose, measured) for m, pose in flown.items()}
    name = flight.name.removesuffix(".csv")

    def told(model: str, what: str) -> str:
        return f"{name}, {LABELS[model]}<br>%{{customdata:.3f}} s: {what}"

    path, pitch = "x %{x:.3f} m, z %{y:.3f} m", "pitch %{y:.2f}°"
    ground = points(
        "fitted",
        numbers(measured[fitted, 0]),
        numbers(measured[fitted, 1]),
        "",
        marker={"color": "@fitted/0.35", "size": 12},
        hoverinfo="skip",
    )
    paths: list[Trace] = [
        ground,
        line(
            "measured",
            numbers(measured[:, 0]),
            numbers(measured[:, 1]),
            told("measured", path),
            width=3,
            customdata=clock,
        ),
    ]
    pitches = [
        line(
            "measured",
            clock,
            numbers(degrees),
            told("measured", pitch),
            width=3,
            customdata=clock,
        )
    ]
    apart_traces: list[Trace] = []
    for model, pose in flown.items():
        for traces, x, y, what in (
            (paths, numbers(pose[:, 0]), pose[:, 1], path),
            (pitches, clock, np.degrees(pose[:, 2]), pitch),
            (
                apart_traces,
                clock,
                np.where(apart[model] > 0.0, apart[model], math.nan),
                "%{y:.3r} m away",
            ),
        ):
            traces.append(
                line(model, x, numbers(y), told(model, what), customdata=clock)
            )
    clocks = Axis(
        title="time [s]",
        range=(float(time[0]), float(time[-1])),
        link=f"time {flight.name}",
    )
    known = math.isfinite(noise) and noise > 0.0
    return [
        Panel(
            title=name,
            traces=paths,
            x=Axis(title="x [m]", range=bounds(measured[:, 0], 0.06, 0.0)),
            y=Axis(title="z [m]", range=bounds(measured[:, 1], 0.35, 0.0)),
            height=250,
        ),
        Panel(
            title="pitch, nose down > 0 [°]",
            traces=pitches,
            x=clocks,
            y=Axis(range=bounds(degrees, 0.35, 0.0)),
            height=250,
            shapes=[shade(float(time[0]), flight.fitted_until)],
        ),
        Panel(
            title="distance from the flight [m]",
            traces=apart_traces,
            x=clocks,
            y=Axis(is_log=True, range=_distance_range(apart, noise if known else 0.0)),
            height=250,
            shapes=[
                shade(float(time[0]), flight.fitted_until),
                *([level(noise, "dot")] if known else []),
            ],
        ),
    ]


def _distance_range(
    apart: dict[str, np.ndarray], noise: float
) -> tuple[float, float] | None:
    every = np.concatenate([np.zeros(0), *apart.values()])
    every = every[np.isfinite(every) & (every > 0.0)]
    if not every.size:
        return None
    low, high = float(np.quantile(every, 0.02)), min(float(every.max()), 100.0)
    if noise > 0.0:
        low = min(max(low, 0.2 * noise), 0.5 * noise)
    return log_range(0.7 * low, 2.0 * max(high, low))


def folds_chart(result: Result) -> Chart | None:
    """Returns the errors of each fold as pairs, one line a fold."""
    if not result.folds:
        return None
    ends = [LABELS["refitted"], LABELS["corrected"]]
    panels = []
    for panel in fold_panels(result):
        traces = []
        for fold, old, new in zip(
            result.folds, panel.refitted, panel.corrected, strict=True
        ):
            key = "better" if new < old else "worse"
            held_out = ", ".join(n.removesuffix(".csv") for n in fold.held_out[:6])
            more = len(fold.held_out) - 6
            held_out += f" and {more} more" if more > 0 else ""
            traces.append(
                line(
                    key,
                    ends,
                    numbers([old, new]),
                    f"%{{x}}: %{{y:.3r}} {panel.unit.name}<br>{held_out}",
                    mode="lines+markers",
                    marker={"color": ["@refitted", "@corrected"], "size": 8},
                )
            )
        both = np.concatenate([panel.refitted, panel.corrected])
        both = both[np.isfinite(both) & (both > 0.0)]
        far = bool(both.size) and both.max() > 5.0 * both.min()
        span = None
        if both.size:
            span = (0.0, 1.12 * float(both.max()))
            span = log_range(0.6 * both.min(), 1.6 * both.max()) if far else span
        panels.append(
            Panel(
                title=f"{panel.title}, RMS [{panel.unit.name}]",
                traces=traces,
                x=Axis(more={"type": "category", "range": [-0.35, 1.35]}),
                y=Axis(is_log=far, range=span),
            )
        )
    keys = {"better": "the correction helps", "worse": "it does not"}
    drawn = {trace["key"] for panel in panels for trace in panel.traces}
    return Chart(keys={k: v for k, v in keys.items() if k in drawn}, panels=panels)


def spreads_chart(result: Result) -> Chart | None:
    """Returns each flight's own value of what differs from flight to flight."""
    panels = []
    for panel in spread_panels(result):
        unit = "" if panel.unit.name == "-" else panel.unit.name
        places = list(range(1, len(panel.values) + 1))
        names = [name.removesuffix(".csv") for name in panel.values]
        ground = {
            **shade(0, 1),
            "xref": "paper",
            "yref": "y",
            "y0": -panel.std,
            "y1": panel.std,
            "fillcolor": "@own/0.14",
        }
        panels.append(
            Panel(
                title=f"{panel.title} [{unit}]" if unit else panel.title,
                traces=[
                    points(
                        "own",
                        places,
                        numbers(panel.values.values()),
                        f"%{{text}}: %{{y:.3r}} {unit}",
                        text=names,
                    )
                ],
                x=Axis(title="flight, in the order of the campaign"),
                shapes=[level(0.0), *([ground] if math.isfinite(panel.std) else [])],
            )
        )
    if not panels:
        return None
    keys = {"own": "a flight's own value; the band is one standard deviation"}
    return Chart(keys=keys, panels=panels, least_width=24.0)
