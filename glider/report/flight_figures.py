"""Figures of flights: held-out ones beside the models, innovations."""

import math

import numpy as np

from glider.report import error_table
from glider.report.error_table import bounded, distance, position_rms, rank_flights
from glider.report.plots import figure as spec
from glider.report.plots.binning import bounds
from glider.report.plots.style import LABELS
from glider.sysid.result import HeldOutFlight, Result

_MOST_SHOWN = 4  # Held-out flights that are shown without being asked for.

MOST_FLIGHTS = 120
"""Held-out flights that a page holds: the best and the worst, and between."""

_ROWS = 120  # Rows that are drawn of a flight at most.


def shown_flights(result: Result, count: int = _MOST_SHOWN) -> list[HeldOutFlight]:
    """Held-out flights from the best corrected to the worst, evenly by rank."""
    ranked = rank_flights(result)
    count = min(count, len(ranked))
    ranks = np.linspace(0, len(ranked) - 1, count).round().astype(int)
    return [ranked[i] for i in ranks]


def flights_in_page(result: Result) -> list[HeldOutFlight]:
    """Flights to choose from, from the worst corrected to the best."""
    every = (*shown_flights(result, MOST_FLIGHTS), *shown_flights(result))
    kept = {flight.name for flight in every}
    return [flight for flight in rank_flights(result)[::-1] if flight.name in kept]


def held_out_figure(result: Result) -> spec.Figure | None:
    """Held-out flights, measured and flown by each model, to choose from."""
    flights = flights_in_page(result)
    if not flights:
        return None
    shown = {flight.name for flight in shown_flights(result)}
    errors = [position_rms(flight, "corrected") for flight in flights]
    unit = error_table.unit_beside_floor(result, *errors)
    flown = [m for m in error_table.COLUMNS if any(m in f.flown for f in flights)]
    return spec.Figure(
        keys={m: LABELS[m] for m in ("measured", *flown)}
        | {"fitted": "launch state fitted"},
        choices=[
            spec.Choice(
                label=_stem(flight.name),
                note=unit.text(error),
                panels=flight_panels(flight, result.noise.position_m),
                is_shown=flight.name in shown,
            )
            for flight, error in zip(flights, errors, strict=True)
        ],
    )


def flight_panels(flight: HeldOutFlight, noise: float = math.nan) -> list[spec.Panel]:
    """Path, pitch and distance of a flight, with the noise of a coordinate [m]."""
    count = len(flight.time)
    rows = np.unique(np.linspace(0, count - 1, min(_ROWS, count)).astype(int))
    time = flight.time[rows]
    measured = flight.measured[rows]
    models = [m for m in error_table.COLUMNS if m in flight.flown]
    flown = {m: bounded(flight.flown[m])[rows] for m in models}
    apart = {m: distance(pose, measured) for m, pose in flown.items()}
    name = _stem(flight.name)
    fitted = time <= flight.fitted_until

    def line(model: str, x: np.ndarray, y: np.ndarray, what: str) -> spec.Line:
        hover = f"{name}, {LABELS[model]}<br>%{{customdata:.3f}} s: {what}"
        return spec.Line(model, x, y, hover=hover, extra=time)

    degrees = np.array([1.0, 1.0, math.degrees(1.0)])
    poses = {m: pose * degrees for m, pose in {"measured": measured, **flown}.items()}
    place = "x %{x:.3f} m, z %{y:.3f} m"
    angle = "pitch %{y:.2f}°"
    paths = [line(m, p[:, 0], p[:, 1], place) for m, p in poses.items()]
    pitches = [line(m, time, p[:, 2], angle) for m, p in poses.items()]
    distances = [
        line(m, time, np.where(d > 0.0, d, math.nan), "%{y:.3r} m away")
        for m, d in apart.items()
    ]
    x, z, _ = measured.T
    columns = zip(*(pose.T for pose in poses.values()), strict=True)
    x_range, z_range, pitch_range = (_range_of(*own) for own in columns)
    launch = x[fitted], z[fitted]
    begin = float(time[0])
    end = float(time[-1])
    start = spec.Ground(begin, flight.fitted_until, key="fitted")
    clock = spec.Axis("time [s]", (begin, end), link=f"time {flight.name}")
    noise = noise if math.isfinite(noise) else 0.0
    level = [spec.Level(noise, is_dotted=True)] if noise > 0.0 else []
    return [
        spec.Panel(
            name,
            [spec.Points("fitted", *launch, hover="", size=12.0, opacity=0.3), *paths],
            spec.Axis("x [m]", x_range),
            spec.Axis("z [m]", z_range),
            height=250,
        ),
        spec.Panel(
            "pitch, nose down > 0 [°]",
            [start, *pitches],
            clock,
            spec.Axis(range=pitch_range),
            height=250,
        ),
        spec.Panel(
            "distance from the flight [m]",
            [start, *level, *distances],
            clock,
            spec.Axis(range=_distance_range(apart, noise), is_log=True),
            height=250,
        ),
    ]


def _range_of(measured: np.ndarray, *flown: np.ndarray) -> tuple[float, float] | None:
    """Limits that show a measured column and what the models make of it.

    A model that leaves it by more than 1.5 times its own range is cut there.
    """
    low = np.nanmin(measured)
    high = np.nanmax(measured)
    beyond = 1.5 * (high - low)
    near = [np.clip(own, low - beyond, high + beyond) for own in flown]
    return bounds(np.concatenate([measured, *near]), quantile=0.0)


def _stem(name: str) -> str:
    return name.removesuffix(".csv")


def _distance_range(
    apart: dict[str, np.ndarray], noise: float
) -> tuple[float, float] | None:
    every = np.concatenate([np.zeros(0), *apart.values()])
    every = every[np.isfinite(every) & (every > 0.0)]
    if not every.size:
        return None
    low = float(np.quantile(every, 0.02))
    high = min(float(every.max()), 100.0)
    if noise > 0.0:
        low = min(max(low, 0.2 * noise), 0.5 * noise)
    return 0.7 * low, 2.0 * max(high, low)


def innovations_figure(result: Result) -> spec.Figure | None:
    """Correlations of the innovations with themselves and with the elevator."""
    found = result.innovations
    if found is None:
        return None
    keys = {m: LABELS[m] for m in found.autocorrelation}
    # At no lag a channel is one with itself.
    parts = [("autocorrelation of {}", found.autocorrelation, 1)]
    if found.with_elevator:
        parts.append(("{} and earlier elevator", found.with_elevator, 0))
    panels = []
    for title, correlations, first in parts:
        for channel in error_table.CHANNELS:
            rows = {m: own[channel][first:] for m, own in correlations.items()}
            most = np.nanmax(np.abs([found.band, *np.concatenate([*rows.values()])]))
            lines = [
                spec.Line(m, found.lag_s[first:], row, has_dots=True, is_solid=True)
                for m, row in rows.items()
            ]
            band = spec.Ground(-found.band, found.band, along="y")
            panel = spec.Panel(
                title.format(channel),
                [spec.Level(), band, *lines],
                spec.Axis("lag [s]", link="lag"),
                spec.Axis(range=(-1.15 * most, 1.15 * most)),
                height=230,
            )
            panels.append(panel)
    keys["soft"] = "95 % of white noise"
    return spec.Figure(keys=keys, panels=panels)
