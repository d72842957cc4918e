"""Block diagrams of the docs, drawn from Drake diagrams themselves.

`python docs/extensions/block_diagram.py` writes them into docs/pictures. The places of
the boxes and the corners of the lines are in `block_layouts`; which systems there are,
what is connected, and by which ports, is Drake's answer.
"""

import re
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path

from block_layouts import LAYOUTS, Layout
from boxes import Colors, draw_boxes
from glider_drawing import BLUE, GREY, save
from matplotlib.figure import Figure
from pydrake.systems.framework import (
    Diagram,
    InputPort,
    InputPortIndex,
    OutputPort,
    OutputPortIndex,
)

from diagrams import closed_loop, estimated_loop
from diagrams.programs.station.controllers import make_guidance
from diagrams.programs.station.scenario import Scenario
from glider import (
    ExtendedKalmanFilter,
    GliderModel,
    perching_filter,
    plan,
    tracking_regulator,
)

DOCS = Path(__file__).parents[1]

OUTSIDE = "station"
"""Box that the ports of a diagram connect to, where a layout has it."""


def picture_of(name: str) -> Path:
    """Returns the file of a picture."""
    return DOCS / "pictures" / f"{name}.svg"


def script_of_page() -> str:
    """Returns the first script of the page on diagrams, up to its first flight."""
    page = (DOCS / "drake.md").read_text(encoding="utf-8")
    found = re.search(r"^```python\n(.*?)^rng = ", page, re.DOTALL | re.MULTILINE)
    assert found is not None
    return found[1]


def diagram_of_page() -> Diagram:
    """Builds the diagram of the page."""
    names: dict[str, Diagram] = {}
    exec(compile(script_of_page(), "drake.md", "exec"), names)
    return names["diagram"]


def sampled_loop() -> Diagram:
    """Builds the loop of a logged flight: cameras, and commands that are held."""
    model = GliderModel()
    regulator = tracking_regulator(model, plan(model))
    return closed_loop(model, regulator, command_rate=50.0, motion_capture=120.0)


def filtered_loop() -> Diagram:
    """Builds the loop that is closed on the estimate of a filter."""
    model = GliderModel()
    planned = plan(model)
    regulator = tracking_regulator(model, planned)
    estimator = ExtendedKalmanFilter(*perching_filter(model, planned.states[0]))
    return estimated_loop(model, regulator, estimator, command_rate=50.0)


def station_autopilot() -> Diagram:
    """Builds what the station of a lab flies."""
    return make_guidance(Scenario()).autopilot


DIAGRAMS: dict[str, Callable[[], Diagram]] = {
    "drake_diagram": diagram_of_page,
    "autopilot": station_autopilot,
    "closed_loop": sampled_loop,
    "estimated_loop": filtered_loop,
}
"""Maps the name of a picture to what builds its diagram."""


def box_of(name: str) -> str:
    """Returns the box that a system belongs to."""
    if name.startswith("glider_"):
        return "scene"
    if "VectorLogSink" in name or name.endswith("_log"):
        return "log"
    return "motion_capture" if name in ("elevator_angle", "markers") else name


def connections_of(diagram: Diagram) -> dict[tuple[str, str], str]:
    """Maps two boxes to the names and sizes of the ports that connect them.

    The diagram's own ports are of the box OUTSIDE.
    """
    found: dict[tuple[str, str], set[str]] = defaultdict(set)
    for (reader, _), (system, index) in diagram.connection_map().items():
        port = system.get_output_port(index)
        pair = (box_of(system.get_name()), box_of(reader.get_name()))
        if pair[0] != pair[1]:
            found[pair].add(_words_of(port))
    for i in range(diagram.num_input_ports()):
        port = diagram.get_input_port(i)
        for system, _ in diagram.GetInputPortLocators(InputPortIndex(i)):
            found[OUTSIDE, box_of(system.get_name())].add(_words_of(port))
    for i in range(diagram.num_output_ports()):
        port = diagram.get_output_port(i)
        system, _ = diagram.get_output_port_locator(OutputPortIndex(i))
        found[box_of(system.get_name()), OUTSIDE].add(_words_of(port))
    return {pair: "\n".join(sorted(ports)) for pair, ports in found.items()}


def _words_of(port: InputPort | OutputPort) -> str:
    return f"{port.get_name()} ({port.size()})"


def draw(diagram: Diagram, layout: Layout) -> Figure:
    """Draws a diagram; LookupError where the layout is that of another."""
    boxes = {box_of(system.get_name()) for system in diagram.GetSystems()}
    connections = connections_of(diagram)
    if OUTSIDE in layout.boxes:
        boxes.add(OUTSIDE)
    else:
        connections = {p: w for p, w in connections.items() if OUTSIDE not in p}
    if boxes != set(layout.boxes) or set(connections) != set(layout.routes):
        raise LookupError(f"The layout is not that of {boxes}, {set(connections)}.")
    colors = {name: _colors_of(made_by) for name, (*_, made_by) in layout.boxes.items()}
    return draw_boxes(layout, connections, colors)


def _colors_of(made_by: str) -> Colors:
    is_of_drake = made_by in ("ZeroOrderHold", "LogVectorOutput")
    return ("#F4F4F4", GREY) if is_of_drake else ("#E3F0F9", BLUE)


if __name__ == "__main__":
    for name, build in DIAGRAMS.items():
        save(draw(build(), LAYOUTS[name]), picture_of(name))
