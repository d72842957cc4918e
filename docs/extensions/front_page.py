"""Sphinx extension: the figure of the front page, before and after a correction."""

from pathlib import Path

import matplotlib
from matplotlib.figure import Figure
from sphinx.application import Sphinx

from glider.report.figure_data import shown_flights
from glider.report.flight_errors import bounded
from glider.report.plots.axes import legend
from glider.report.plots.flights import plot_paths
from glider.report.plots.style import STYLE
from glider.sysid.pipeline import close_the_loop

FLIGHTS = tuple(f"flight_{k:03d}.csv" for k in range(10))
SUSPECTS = ("attached_lift", "wind", "servo_lag", "profile_drag")
"""Effects that are tried here; the tutorial tries the whole library."""

SHOWN = ("nominal", "corrected")


def draw_front() -> Figure:
    """Draws held-out flights beside the models before and after."""
    result = close_the_loop("attached_lift", flights=FLIGHTS, effects=SUSPECTS)
    flights = shown_flights(result)
    figure = Figure(figsize=(9.0, 2.8), layout="constrained", dpi=150)
    axes = figure.subplots(1, len(flights), sharey=True, squeeze=False)[0]
    for ax, flight in zip(axes, flights, strict=True):
        flown = {model: bounded(flight.flown[model]) for model in SHOWN}
        plot_paths(ax, flight.measured, flown, flight.time <= flight.fitted_until)
        ax.set_xlabel("x [m]")
    axes[0].set_ylabel("z [m]")
    legend(figure, axes[0])
    return figure


def write_figure(app: Sphinx) -> None:
    """Writes the figure beside the front page."""
    with matplotlib.rc_context(STYLE):
        draw_front().savefig(Path(app.srcdir) / "loop.png")


def setup(app: Sphinx) -> dict[str, bool]:
    """Adds the figure to a Sphinx build."""
    app.connect("builder-inited", write_figure)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
