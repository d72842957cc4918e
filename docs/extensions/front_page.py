"""Sphinx extension: figures that a build draws, a correction and a funnel."""

import dataclasses
from pathlib import Path

from figure_file import to_png
from matplotlib.figure import Figure as Picture
from sphinx.application import Sphinx

from diagrams.tube import plot_tube
from glider.paths import models_path
from glider.report.flight_figures import flight_panels, shown_flights
from glider.report.plots.figure import Figure
from glider.report.plots.style import LABELS
from glider.sysid.pipeline import close_the_loop
from glider.verification.funnel.funnel import load_funnel

FLIGHTS = tuple(f"flight_{k:03d}.csv" for k in range(10))
SUSPECTS = ("attached_lift", "wind", "servo_lag", "profile_drag")
"""Effects that are tried here; the tutorial tries the whole library."""

SHOWN = ("measured", "nominal", "corrected")


def make_front() -> Figure:
    """Held-out flights beside the models before and after."""
    result = close_the_loop("attached_lift", flights=FLIGHTS, effects=SUSPECTS)
    panels = [flight_panels(flight)[0] for flight in shown_flights(result)]
    return Figure(
        keys={key: LABELS[key] for key in SHOWN},
        panels=[
            dataclasses.replace(
                panel, marks=[m for m in panel.marks if m.key in (*SHOWN, "fitted")]
            )
            for panel in panels
        ],
    )


def draw_funnel() -> Picture:
    """A shipped funnel, with the height that a launch may deviate."""
    funnel = load_funnel(models_path("funnels", "held_head_wind_95_hook.npz"))
    figure = Picture(figsize=(9.0, 3.2), layout="constrained")
    plot_tube(figure.subplots(), funnel)
    return figure


def write_figures(app: Sphinx) -> None:
    """Writes the figures beside the pages that show them."""
    folder = Path(app.srcdir)
    (folder / "loop.png").write_bytes(to_png(make_front(), dpi=150, columns=4))
    draw_funnel().savefig(folder / "funnel.png", dpi=150)


def setup(app: Sphinx) -> dict[str, bool]:
    """Adds the figures to a Sphinx build."""
    app.connect("builder-inited", write_figures)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
