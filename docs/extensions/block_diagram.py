"""The diagram of the page for users of Drake, drawn from the diagram itself.

`python docs/extensions/block_diagram.py` runs that page's first script up to its first
flight, and writes docs/pictures/drake_diagram.svg. Places of the systems are given
here; what is connected, and by which ports, is Drake's answer.
"""

import re
from collections import defaultdict
from pathlib import Path

from glider_drawing import BLUE, GREY, INK, save
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch
from pydrake.systems.framework import Diagram

DOCS = Path(__file__).parents[1]
PICTURE = DOCS / "pictures" / "drake_diagram.svg"

CLASSES = {
    "glider": "GliderPlant",
    "cameras": "SampledNoise",
    "estimator": "ExtendedKalmanFilter",
    "regulator": "tracking_regulator",
    "hold": "ZeroOrderHold",
    "servo": "ElevatorServo",
    "scene": "AddScene",
    "log": "LogVectorOutput",
}
"""Maps the name of a system to what makes it; scene and logs are several."""

PLACES = {
    "regulator": (0.0, 0.0),
    "hold": (3.5, 0.0),
    "servo": (6.5, 0.0),
    "glider": (10.3, 0.0),
    "estimator": (0.0, -2.4),
    "cameras": (10.3, -2.4),
    "log": (5.0, -3.9),
    "scene": (10.3, 1.9),
}
"""Center of each box."""

WIDTH, HEIGHT = 2.1, 0.9

ROUTES = {
    ("regulator", "hold"): [(1.05, 0.0), (2.45, 0.0)],
    ("hold", "servo"): [(4.55, 0.0), (5.45, 0.0)],
    ("servo", "glider"): [(7.55, 0.0), (9.25, 0.0)],
    ("glider", "cameras"): [(10.3, -0.45), (10.3, -1.95)],
    ("cameras", "estimator"): [(9.25, -2.4), (1.05, -2.4)],
    ("estimator", "regulator"): [(0.0, -1.95), (0.0, -0.45)],
    ("servo", "estimator"): [(6.5, -0.45), (6.5, -1.45), (0.7, -1.45), (0.7, -1.95)],
    ("glider", "servo"): [(9.7, 0.45), (9.7, 0.95), (6.5, 0.95), (6.5, 0.45)],
    ("glider", "scene"): [(10.5, 0.45), (10.5, 1.45)],
    ("glider", "log"): [(11.35, -0.2), (11.9, -0.2), (11.9, -3.75), (6.05, -3.75)],
    ("cameras", "log"): [(10.3, -2.85), (10.3, -4.05), (6.05, -4.05)],
    ("regulator", "log"): [(-1.05, 0.0), (-1.5, 0.0), (-1.5, -3.9), (3.95, -3.9)],
}
"""Corners of each connection."""

LABELS = {
    ("regulator", "hold"): (1.75, 0.22),
    ("hold", "servo"): (5.0, 0.22),
    ("servo", "glider"): (8.4, 0.22),
    ("glider", "cameras"): (10.2, -1.2),
    ("cameras", "estimator"): (5.0, -2.2),
    ("estimator", "regulator"): (-0.1, -1.2),
    ("servo", "estimator"): (3.6, -1.25),
    ("glider", "servo"): (8.1, 1.15),
    ("glider", "scene"): (10.6, 0.95),
    ("glider", "log"): (8.1, -3.55),
    ("cameras", "log"): (8.1, -4.27),
    ("regulator", "log"): (1.3, -3.7),
}
"""Place of the words at each connection."""


def script_of_page() -> str:
    """Returns the first script of the page, up to its first flight."""
    page = (DOCS / "drake.md").read_text(encoding="utf-8")
    found = re.search(r"^```python\n(.*?)^rng = ", page, re.DOTALL | re.MULTILINE)
    assert found is not None
    return found[1]


def diagram_of_page() -> Diagram:
    """Builds the diagram of the page."""
    names: dict[str, Diagram] = {}
    exec(compile(script_of_page(), "drake.md", "exec"), names)
    return names["diagram"]


def box_of(name: str) -> str:
    """Returns the box that a system belongs to."""
    if name.startswith("glider_"):
        return "scene"
    return "log" if "VectorLogSink" in name else name


def connections_of(diagram: Diagram) -> dict[tuple[str, str], str]:
    """Maps two boxes to the names and sizes of the outputs that connect them."""
    found: dict[tuple[str, str], set[str]] = defaultdict(set)
    for (reader, _), (system, index) in diagram.connection_map().items():
        port = system.get_output_port(index)
        pair = (box_of(system.get_name()), box_of(reader.get_name()))
        if pair[0] != pair[1]:
            found[pair].add(f"{port.get_name()} ({port.size()})")
    return {pair: "\n".join(sorted(ports)) for pair, ports in found.items()}


def draw(diagram: Diagram) -> Figure:
    """Draws a diagram with the systems of PLACES, and no other."""
    boxes = {box_of(system.get_name()) for system in diagram.GetSystems()}
    connections = connections_of(diagram)
    if boxes != set(PLACES) or set(connections) != set(ROUTES):
        raise LookupError(f"No place for one of {boxes} or {set(connections)}.")
    figure = Figure(figsize=(9.6, 5.0), layout="constrained")
    FigureCanvasSVG(figure)
    ax = figure.add_subplot()
    ax.set_axis_off()
    ax.set_aspect("equal")
    ax.set_xlim(-1.7, 12.1)
    ax.set_ylim(-4.6, 2.45)
    for name in PLACES:
        _draw_box(ax, name)
    for pair, words in connections.items():
        _draw_connection(ax, pair, words)
    return figure


def _draw_box(ax: Axes, name: str) -> None:
    x, z = PLACES[name]
    corner = (x - 0.5 * WIDTH, z - 0.5 * HEIGHT)
    is_drakes = name in ("hold", "log")
    box = FancyBboxPatch(
        corner,
        WIDTH,
        HEIGHT,
        boxstyle="round,pad=0,rounding_size=0.12",
        fc="#F4F4F4" if is_drakes else "#E3F0F9",
        ec=GREY if is_drakes else BLUE,
        lw=1.2,
    )
    ax.add_patch(box)
    middle = {"ha": "center", "va": "center"}
    ax.text(x, z + 0.16, name, weight="bold", size=10.5, color=INK, **middle)
    ax.text(x, z - 0.19, CLASSES[name], size=7.8, color=INK, **middle)


def _draw_connection(ax: Axes, pair: tuple[str, str], words: str) -> None:
    route = ROUTES[pair]
    ax.plot(*zip(*route, strict=True), color=INK, lw=1.1, zorder=0)
    arrow = FancyArrowPatch(
        route[-2],
        route[-1],
        arrowstyle="-|>",
        mutation_scale=11,
        color=INK,
        lw=1.1,
        shrinkA=0,
        shrinkB=0,
    )
    ax.add_patch(arrow)
    x, z = LABELS[pair]
    is_upright = route[0][0] == route[-1][0]
    align = "center"
    if is_upright:
        align = "left" if x > route[0][0] else "right"
    ax.text(x, z, words, size=8.2, color=INK, ha=align, va="center")


if __name__ == "__main__":
    save(draw(diagram_of_page()), PICTURE)
