"""Sphinx extension: figures of pages, which a build draws from the library's results.

A page NAME shows drawn/NAME.png; the build writes all of them before it reads pages.
"""

import dataclasses
import json
import re
from collections.abc import Callable
from pathlib import Path

import matplotlib
import numpy as np
from figure_file import draw
from matplotlib.figure import Figure as Picture
from sphinx.application import Sphinx

from diagrams.tube import plot_tube
from glider.campaign.reader import load_campaign
from glider.paths import models_path
from glider.physics.effects import LIBRARY
from glider.report.flight_figures import flight_panels, shown_flights
from glider.report.import_figure import save_import_figure
from glider.report.model_figures import free_functions_figure, residual_figure
from glider.report.plots.figure import Figure
from glider.report.plots.style import COLORS, STYLE
from glider.sysid.pipeline import close_the_loop
from glider.sysid.result import Result
from glider.verification.funnel.funnel import load_funnel
from glider.verification.trials import fly_inside

FLIGHTS = tuple(f"flight_{k:03d}.csv" for k in range(10))
SUSPECTS = ("attached_lift", "wind", "servo_lag", "profile_drag")
"""Effects that are tried here; the tutorial tries the whole library."""

VENT = "floor_vent"
VENT_FLIGHTS = tuple(f"flight_{k:03d}.csv" for k in range(12))
VENT_SUSPECTS = ("wind", "profile_drag")
"""A campaign that shows what no formula describes."""

SHOWN = ("measured", "nominal", "corrected")

BLUE, GREY = COLORS["corrected"], COLORS["nominal"]


def make_flights(result: Result) -> Figure:
    """Held-out flights beside the models before and after."""
    panels = [flight_panels(flight)[0] for flight in shown_flights(result)]
    return Figure(
        keys={key: key for key in SHOWN},
        panels=[
            dataclasses.replace(
                panel, marks=[m for m in panel.marks if m.key in (*SHOWN, "fitted")]
            )
            for panel in panels
        ],
    )


def draw_tube() -> Picture:
    """A shipped funnel, with the height that a launch may deviate."""
    figure = Picture(figsize=(9.0, 3.2), layout="constrained")
    plot_tube(figure.subplots(), _funnel("held_head_wind_95_hook"))
    return figure


def draw_levels() -> Picture:
    """V over time of flights from a funnel's first set."""
    funnel = _funnel("drawn_hook")
    times = funnel.nominal.times
    levels = funnel.level(times, fly_inside(funnel, 200, np.random.default_rng(0)))
    figure = Picture(figsize=(9.0, 2.8), layout="constrained")
    ax = figure.subplots()
    ax.plot(times, levels.T, color=BLUE, lw=0.5, alpha=0.4)
    ax.axhline(1.0, color="black", lw=1.2)
    ax.set(xlabel="time [s]", ylabel="V", ylim=(0.0, 1.1))
    ax.text(0.005, 1.02, "boundary of the funnel", va="bottom")
    return figure


def draw_half_widths() -> Picture:
    """How far single states may deviate in funnels, over time."""
    names = ("height [cm]", "pitch [°]", "speed along x [m/s]")
    states = (1, 2, 4)
    units = (100.0, np.degrees(1.0), 1.0)
    figure = Picture(figsize=(9.0, 2.8), layout="constrained")
    axes = figure.subplots(1, len(names))
    for name in ("drawn", "drawn_hook", "held_hook"):
        funnel = _funnel(name)
        times = funnel.nominal.times
        widths = funnel.half_widths(times)
        for ax, state, unit in zip(axes, states, units, strict=True):
            ax.plot(times, unit * widths[:, state], label=f"{name}.npz")
    for ax, title in zip(axes, names, strict=True):
        ax.set(xlabel="time [s]", title=title, ylim=(0.0, None))
    axes[0].legend(frameon=False)
    return figure


def draw_flight_file() -> Picture:
    """The columns of one flight's file."""
    [flight] = load_campaign("attached_lift", flights=FLIGHTS[3:4]).flights
    assert flight.elevator is not None
    assert flight.command is not None
    columns = {
        "x, z [m]": flight.pose[:, :2],
        "pitch, elevator [rad]": np.column_stack([flight.pose[:, 2], flight.elevator]),
        "elevator_rate_command [rad/s]": flight.command,
    }
    figure = Picture(figsize=(9.0, 2.6), layout="constrained")
    for ax, (title, values) in zip(figure.subplots(1, 3), columns.items(), strict=True):
        where = {"drawstyle": "steps-post"} if values.ndim == 1 else {}
        ax.plot(flight.time, values, **where)
        ax.set(xlabel="time [s]", title=title)
        names = title.split(" [")[0].split(", ")
        if len(names) > 1:
            ax.legend(names, frameon=False)
    return figure


def draw_errors(folder: Path) -> Picture:
    """Errors of the sample campaigns before and after, as their table has them."""
    table = json.loads((folder / "tables" / "samples.json").read_text(encoding="utf-8"))
    cells = [row["cells"] for row in table["rows"].values()]
    names = [row[0].strip("`") for row in cells]
    figure = Picture(figsize=(9.0, 2.8), layout="constrained")
    ax = figure.subplots()
    places = np.arange(len(names))
    for shift, (label, color) in enumerate((("nominal", GREY), ("corrected", BLUE))):
        column = table["columns"].index(label)
        errors = [float(row[column].split()[0]) for row in cells]
        ax.barh(places + 0.38 * shift, errors, 0.36, color=color, label=label)
    ax.set_xscale("log")
    ax.set_yticks(places + 0.19, names)
    ax.invert_yaxis()
    ax.set(xlabel="RMS position error of held-out flights [mm]")
    ax.legend(frameon=False)
    return figure


def draw_limits(folder: Path) -> Picture:
    """Smallest sizes that flights show, relative to typical sizes, from their table."""
    pattern = r"^\| `(\w+)` \| (\w+) \| ([\d.e-]+)[^|]*\| ([\d.e-]+)[^|]*\| ([\d.e-]+)"
    text = (folder / "power.md").read_text(encoding="utf-8")
    scales = {(k.kind, c.name): c.scale for k in LIBRARY for c in k.coefficients}
    names, shares = [], []
    for kind, coefficient, *sizes in re.findall(pattern, text, re.MULTILINE):
        scale = scales[kind, coefficient]
        names.append(f"{kind}.{coefficient}")
        shares.append([100.0 * float(size) / scale for size in sizes])
    order = np.argsort([row[1] for row in shares])
    figure = Picture(figsize=(9.0, 8.0), layout="constrained")
    ax = figure.subplots()
    for column, flights in enumerate((6, 12, 40)):
        values = [shares[k][column] for k in order]
        ax.plot(values, np.arange(len(order)), "o", ms=4.5, label=f"{flights} flights")
    ax.set_xscale("log")
    ax.set_yticks(np.arange(len(order)), [names[k] for k in order])
    ax.set(xlabel="smallest size shown, relative to the typical size [%]")
    ax.set_ylim(-1, len(order))
    ax.legend(frameon=False)
    return figure


def draw_timings(folder: Path) -> Picture:
    """Times of the library relative to others', from their table."""
    text = (folder / "benchmarks.md").read_text(encoding="utf-8")
    table = text.split("\n\n## ")[0]
    rows = re.findall(r"^\| ([^|]+) \| ([^|]+) \|.*\| ([\d.]+) \|", table, re.MULTILINE)
    figure = Picture(figsize=(9.0, 2.8), layout="constrained")
    ax = figure.subplots()
    places = np.arange(len(rows))
    ax.barh(places, [float(ratio) for *_, ratio in rows], 0.6, color=BLUE)
    ax.axvline(1.0, color="black", lw=1.2)
    ax.set_xscale("log")
    beside = [f"{task.split(',')[0]}\nbeside {other}" for task, other, _ in rows]
    ax.set_yticks(places, [label.split(" (")[0] for label in beside], size=7)
    ax.invert_yaxis()
    ax.set(xlabel="our time relative to theirs")
    return figure


def _funnel(name: str):
    return load_funnel(models_path("funnels", f"{name}.npz"))


def write_figures(app: Sphinx) -> None:
    """Writes all figures."""
    pages = Path(app.srcdir)
    folder = pages / "drawn"
    folder.mkdir(exist_ok=True)
    result = close_the_loop("attached_lift", flights=FLIGHTS, effects=SUSPECTS)
    residual = residual_figure(result)
    vent = close_the_loop(VENT, flights=VENT_FLIGHTS, effects=VENT_SUSPECTS)
    free = free_functions_figure(vent)
    assert residual is not None
    assert free is not None
    drawn: dict[str, Callable[[], Picture]] = {
        "index": lambda: draw(make_flights(result), columns=3),
        "how_it_works": lambda: draw(residual),
        "free_function": lambda: draw(free, columns=1),
        "funnels": draw_tube,
        "certificate": draw_levels,
        "half_widths": draw_half_widths,
        "file_formats": draw_flight_file,
        "results": lambda: draw_errors(pages),
        "power": lambda: draw_limits(pages),
        "benchmarks": lambda: draw_timings(pages),
    }
    with matplotlib.rc_context(STYLE):
        for name, make in drawn.items():
            make().savefig(folder / f"{name}.png", dpi=150)
    campaign = load_campaign("attached_lift", flights=FLIGHTS[:4])
    save_import_figure(campaign, folder / "import.png")


def setup(app: Sphinx) -> dict[str, bool]:
    """Adds the figures to a Sphinx build."""
    app.connect("builder-inited", write_figures)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
