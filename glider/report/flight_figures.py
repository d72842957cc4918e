"""Figures of held-out flights beside the models."""

import math

import numpy as np

from glider.report.error_table import bounded, distance, position_rms, rank_flights
from glider.report.numbers import format_length
from glider.report.plots import figure as spec
from glider.report.plots.binning import bounds
from glider.sysid.result import MODELS, HeldOutFlight, Result

_MOST_SHOWN = 4  # Held-out flights that are shown without being asked for.

_MOST_FLIGHTS = 60
"""Held-out flights that a page holds: the best and the worst, and between."""

_ROWS = 120  # Rows that are drawn of a flight at most.


def shown_flights(result: Result, count: int = _MOST_SHOWN) -> list[HeldOutFlight]:
    """Held-out flights from the best corrected to the worst, evenly by rank."""
    return _evenly(rank_flights(result), count)


def flights_in_page(result: Result) -> list[HeldOutFlight]:
    """Flights to choose from, from the worst corrected to the best."""
    return _evenly(rank_flights(result)[::-1], _MOST_FLIGHTS)


def _evenly(flights: list[HeldOutFlight], count: int) -> list[HeldOutFlight]:
    """At most so many of the flights, the first and the last among them."""
    ranks = np.linspace(0, len(flights) - 1, min(count, len(flights)))
    return [flights[i] for i in ranks.round().astype(int)]


def held_out_figure(result: Result) -> spec.Figure | None:
    """Held-out flights, measured and flown by each model, to choose from."""
    flights = flights_in_page(result)
    if not flights:
        return None
    shown = {flight.name for flight in _evenly(flights, _MOST_SHOWN)}
    choices = []
    for flight in flights:
        choice = spec.Choice(
            label=_stem(flight.name),
            note=format_length(position_rms(flight, "corrected")),
            panels=flight_panels(flight, result.noise.position_m),
            is_shown=flight.name in shown,
        )

        choices.append(choice)

    flown = [m for m in MODELS if any(m in f.flown for f in flights)]
    keys = {m: m for m in ("measured", *flown)}
    keys["fitted"] = "launch state fitted"
    return spec.Figure(keys=keys, choices=choices)


def flight_panels(flight: HeldOutFlight, noise: float = math.nan) -> list[spec.Panel]:
    """Path, pitch and distance of a flight, with the noise of a coordinate [m]."""
    name = _stem(flight.name)
    count = len(flight.time)
    places = np.linspace(0, count - 1, min(_ROWS, count))
    rows = np.unique(places.astype(int))
    time = flight.time[rows]
    measured = flight.measured[rows]
    poses = {"measured": measured}
    for model in MODELS:
        if model in flight.flown:
            poses[model] = bounded(flight.flown[model])[rows]

    noise *= 1e3  # [mm], as distances.
    least = 0.1 * noise if noise > 0.0 else 0.0  # Of distances that are drawn.
    paths = []
    pitches = []
    distances = []
    for model, pose in poses.items():
        x, z, pitch = pose.T
        degrees = np.degrees(pitch)
        said = f"{name}, {model}<br>%{{customdata:.3f}} s: "
        place = said + "x %{x:.3f} m, z %{y:.3f} m"
        angle = said + "pitch %{y:.2f}°"
        paths.append(spec.Line(model, x, z, hover=place, extra=time))
        pitches.append(spec.Line(model, time, degrees, hover=angle, extra=time))
        if model != "measured":
            apart = 1e3 * distance(pose, measured)
            apart = np.where(apart > least, apart, math.nan)
            away = said + "%{y:.3r} mm away"
            distances.append(spec.Line(model, time, apart, hover=away, extra=time))

    fitted = time <= flight.fitted_until
    launch = spec.Points(
        "fitted",
        measured[fitted, 0],
        measured[fitted, 1],
        hover="",
        size=12.0,
        opacity=0.3,
    )

    begin = float(time[0])
    end = float(time[-1])
    start = spec.Ground(begin, flight.fitted_until, key="fitted")
    clock = spec.Axis("time [s]", (begin, end), link=f"time {flight.name}")
    level = []

    if noise > 0.0:
        level.append(spec.Level(noise, is_dotted=True))

    x_axis = spec.Axis("x [m]", _range_of([line.x for line in paths]))
    z_axis = spec.Axis("z [m]", _range_of([line.y for line in paths]))
    angles = spec.Axis(range=_range_of([line.y for line in pitches]))
    return [
        spec.Panel(name, [launch, *paths], x_axis, z_axis, height=250),
        spec.Panel(
            "pitch, nose down > 0 [°]", [start, *pitches], clock, angles, height=250
        ),
        spec.Panel(
            "distance from the flight [mm]",
            [start, *level, *distances],
            clock,
            spec.Axis(is_log=True),
            height=250,
        ),
    ]


def _stem(name: str) -> str:
    return name.removesuffix(".csv")


def _range_of(columns: list[np.ndarray]) -> tuple[float, float] | None:
    """Limits that show a measured column, the first, and what the models make of it.

    A model that leaves it by more than 1.5 times its own range is cut there.
    """
    measured = columns[0]
    low = np.nanmin(measured)
    high = np.nanmax(measured)
    beyond = 1.5 * (high - low)
    every = np.concatenate(columns)
    near = np.clip(every, low - beyond, high + beyond)

    return bounds(near, quantile=0.0)
