"""Figures of flights: held-out ones beside the models, folds, per-flight values."""

import math
from operator import attrgetter

import numpy as np

from glider.report import error_table
from glider.report.error_table import bounded, distance, position_rms, rank_flights
from glider.report.numbers import DEGREE, Unit
from glider.report.plots import figure as spec
from glider.report.plots.binning import bounds
from glider.report.plots.style import LABELS
from glider.report.wording import name_of
from glider.sysid.report import Spread
from glider.sysid.result import HeldOutFlight, Result

MOST_SHOWN = 4  # Held-out flights that are shown without being asked for.

MOST_FLIGHTS = 120
"""Held-out flights that a page holds: the best and the worst, and between."""

_ROWS = 120  # Rows that are drawn of a flight at most.
_MOST_NAMES = 3  # Flights that are named beside their value: those farthest off.


def shown_flights(result: Result, count: int = MOST_SHOWN) -> list[HeldOutFlight]:
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
    time, measured = flight.time[rows], flight.measured[rows]
    models = [m for m in error_table.COLUMNS if m in flight.flown]
    flown = {m: bounded(flight.flown[m])[rows] for m in models}
    apart = {m: distance(pose, measured) for m, pose in flown.items()}
    name, fitted = _stem(flight.name), time <= flight.fitted_until

    def line(model: str, x: np.ndarray, y: np.ndarray, what: str) -> spec.Line:
        hover = f"{name}, {LABELS[model]}<br>%{{customdata:.3f}} s: {what}"
        return spec.Line(model, x, y, hover=hover, extra=time)

    degrees = np.array([1.0, 1.0, math.degrees(1.0)])
    poses = {m: pose * degrees for m, pose in {"measured": measured, **flown}.items()}
    place, angle = "x %{x:.3f} m, z %{y:.3f} m", "pitch %{y:.2f}°"
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
    begin, end = float(time[0]), float(time[-1])
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
    low, high = np.nanmin(measured), np.nanmax(measured)
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
    low, high = float(np.quantile(every, 0.02)), min(float(every.max()), 100.0)
    if noise > 0.0:
        low = min(max(low, 0.2 * noise), 0.5 * noise)
    return 0.7 * low, 2.0 * max(high, low)


_ENDS = np.array([0.0, 1.0])

_FOLD_PANELS = {
    "position, free rollout": error_table.FREE,
    "position, along the measured pitch": error_table.ALONG,
    "pitch, free rollout": error_table.PITCH,
}


def folds_figure(result: Result) -> spec.Figure | None:
    """Errors of each fold as pairs, refitted and corrected, one line a fold."""
    if not result.folds:
        return None
    panels = [_fold_panel(result, *panel) for panel in _FOLD_PANELS.items()]
    keys = {"better": "the correction helps", "worse": "it does not"}
    drawn = {getattr(mark, "key", "") for panel in panels for mark in panel.marks}
    keys = {key: label for key, label in keys.items() if key in drawn}
    return spec.Figure(keys=keys, panels=panels)


def _fold_panel(result: Result, title: str, field: str) -> spec.Panel:
    get = attrgetter(field)
    errors = [(get(fold.refitted), get(fold.corrected)) for fold in result.folds]
    pairs, unit = bounded(np.array(errors, dtype=float)), DEGREE
    if field != error_table.PITCH:
        unit = error_table.unit_beside_floor(result, *pairs.flat)
    pairs, marks = pairs / unit.size, []
    for fold, pair in zip(result.folds, pairs, strict=True):
        names = ", ".join(map(_stem, fold.held_out[:6]))
        if (more := len(fold.held_out) - 6) > 0:
            names += f" and {more} more"
        hover = f"%{{y:.3r}} {unit.name}<br>{names}"
        key = "better" if pair[1] < pair[0] else "worse"
        marks.append(spec.Line(key, _ENDS, pair, hover=hover, has_dots=True))
    shown = pairs[np.isfinite(pairs) & (pairs > 0.0)]
    span, is_far = None, False
    if shown.size:
        low, high = float(shown.min()), float(shown.max())
        is_far = high > 5.0 * low
        span = (0.6 * low, 1.6 * high) if is_far else (0.0, 1.12 * high)
    ticks = {0.0: LABELS["refitted"], 1.0: LABELS["corrected"]}
    return spec.Panel(
        f"{title}, RMS [{unit.name}]",
        marks,
        spec.Axis(range=(-0.35, 1.35), ticks=ticks),
        spec.Axis(range=span, is_log=is_far),
    )


def spreads_figure(result: Result) -> spec.Figure | None:
    """Per-flight values of what varies from flight to flight."""
    spreads = {name_of(n): s for n, s in result.spreads.items() if s.values}
    panels = [_spread_panel(name, spread) for name, spread in spreads.items()]
    if not panels:
        return None
    keys = {"own": "value of one flight; the band is one standard deviation"}
    return spec.Figure(keys=keys, panels=panels, columns=1, least_width=24.0)


def _spread_panel(title: str, spread: Spread) -> spec.Panel:
    unit = DEGREE if spread.unit == "rad" else Unit(name=spread.unit.replace("-", ""))
    own = np.array(list(spread.values.values()), dtype=float) / unit.size
    size = np.where(np.isfinite(own), np.abs(own), -1.0)
    named = [i for i in np.argsort(-size)[:_MOST_NAMES] if size[i] >= 0.0]
    names = [_stem(name) for name in spread.values]
    points = spec.Points(
        "own",
        np.arange(1.0, len(own) + 1.0),
        own,
        hover=f"%{{hovertext}}: %{{y:.3r}} {unit.name}",
        names=names,
        labels=[name if i in named else "" for i, name in enumerate(names)],
    )
    half = np.nan_to_num(spread.std / unit.size, posinf=0.0)
    return spec.Panel(
        f"{title} [{unit.name}]" if unit.name else title,
        [spec.Level(), spec.Ground(-half, half, along="y", key="own"), points],
        spec.Axis("flight, in the order of the campaign", (0.0, len(own) + 1.0)),
    )


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
