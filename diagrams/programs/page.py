"""A page with a recording of Meshcat: a legend and a clock above it, controls below.

    write_text(path, page_of(meshcat, tracks, "A flight"))

The page is one file that needs no server and no network. It reads clock, speed and
pitch from the readouts that `AddScene` makes.
"""

import logging
from collections.abc import Sequence

import jinja2
from pydrake.geometry import Meshcat, MeshcatParams

from diagrams.overlays import ARROW_SCALE
from diagrams.playback import Track
from diagrams.urdf import COLORS

_HOST = "127.0.0.1"
"""Address that scenes are served on: programs of other computers cannot open it."""


def open_meshcat() -> Meshcat:
    """Opens a Meshcat that only programs of this computer reach.

    Drake's log would name its page, which has neither legend nor clock.
    """
    log = logging.getLogger("drake")
    level = log.level
    log.setLevel(logging.WARNING)
    try:
        return Meshcat(MeshcatParams(host=_HOST))
    finally:
        log.setLevel(level)


def page_of(
    meshcat: Meshcat, tracks: Sequence[Track], title: str, rate: float = 1.0
) -> str:
    """Returns what Meshcat shows, the recording included, as the HTML of a page.

    Args:
        meshcat: with a recording, such as `play` leaves.
        tracks: that were played, for the legend.
        title: of the page.
        rate: seconds of flight in one second of playback, at first.
    """
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("diagrams.programs"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
    )
    has_forces = any(track.forces is not None for track in tracks)
    colors = [COLORS["wing"] if t.color is None else t.color for t in tracks]
    legend = environment.get_template("flight.html").render(
        title=title,
        tracks=tracks,
        colors=[[round(255 * c) for c in color[:3]] for color in colors],
        rate=rate,
        arrow_scale=ARROW_SCALE if has_forces else None,
    )
    head, end, tail = meshcat.StaticHtml().rpartition("</body>")
    return f"{head}{legend}{end}{tail}"
