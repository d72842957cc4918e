"""Sphinx extension: the figure of the front page, before and after a correction."""

import dataclasses
from pathlib import Path

from figure_file import to_png
from sphinx.application import Sphinx

from glider.report.flight_figures import flight_panels, shown_flights
from glider.report.plots.figure import Figure
from glider.report.plots.style import LABELS
from glider.sysid.pipeline import close_the_loop

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


def write_figure(app: Sphinx) -> None:
    """Writes the figure beside the front page."""
    figure = make_front()
    (Path(app.srcdir) / "loop.png").write_bytes(to_png(figure, dpi=150, columns=4))


def setup(app: Sphinx) -> dict[str, bool]:
    """Adds the figure to a Sphinx build."""
    app.connect("builder-inited", write_figure)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
