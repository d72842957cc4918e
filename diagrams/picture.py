"""A diagram as a picture, drawn by Matplotlib: Graphviz need not be installed."""

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch
from pydrake.systems.framework import Diagram

WIDTH, HEIGHT = 1.7, 0.55
"""Size of a box."""

COLUMN, ROW = 2.6, 1.1
"""Distances from column to column and from row to row."""

Edge = tuple[str, str, str]
"""Names of the source, of the target and of the output port."""


def names_of(diagram: Diagram) -> list[str]:
    """Returns the names of the systems, logs last."""
    names = [system.get_name() for system in diagram.GetSystems()]
    return sorted(names, key=lambda name: name.endswith("_log"))


def edges_of(diagram: Diagram) -> list[Edge]:
    """Returns the connections in a fixed order."""
    order = names_of(diagram)
    edges = {
        (source.get_name(), target.get_name(), source.get_output_port(port).get_name())
        for (target, _), (source, port) in diagram.connection_map().items()
    }
    return sorted(edges, key=lambda e: (order.index(e[0]), order.index(e[1]), e[2]))


def columns_of(names: list[str], edges: list[Edge], root: str) -> dict[str, int]:
    """Returns the column of each system: as far right as its longest way in.

    What closes a loop counts for nothing: first the edges that leave the root and
    lead back to it, then any other that a search meets again on its way.

    Args:
        names: of the systems.
        edges: between them.
        root: system where the loop is cut open.
    """
    after: dict[str, list[str]] = {name: [] for name in names}
    for source, target, _ in edges:
        after[source].append(target)

    def reaches(start: str, goal: str, seen: set[str]) -> bool:
        seen.add(start)
        return start == goal or any(
            reaches(name, goal, seen) for name in after[start] if name not in seen
        )

    if root in after:
        after[root] = [name for name in after[root] if not reaches(name, root, set())]
    has_input = {name for targets in after.values() for name in targets}
    forward: dict[str, list[str]] = {name: [] for name in names}
    way: list[str] = []
    done: set[str] = set()

    def search(name: str) -> None:
        way.append(name)
        for target in after[name]:
            if target in way:
                continue
            forward[name].append(target)
            if target not in done:
                search(target)
        way.pop()
        done.add(name)

    for name in sorted(names, key=lambda name: name in has_input):
        if name not in done:
            search(name)
    column = dict.fromkeys(names, 0)
    for _ in names:
        for source, targets in forward.items():
            for target in targets:
                column[target] = max(column[target], column[source] + 1)
    return column


def draw_diagram(diagram: Diagram, ax: Axes, root: str = "glider") -> None:
    """Draws the systems of a diagram as boxes and its connections as arrows.

    Signals go from left to right; those that close a loop go back below.

    Args:
        diagram: what to draw.
        ax: where; it loses its axes.
        root: system whose outputs close the loop.
    """
    names = names_of(diagram)
    edges = edges_of(diagram)
    column = columns_of(names, edges, root)
    place: dict[str, tuple[float, float]] = {}
    filled: dict[int, int] = {}
    for name in names:
        row = filled.get(column[name], 0)
        filled[column[name]] = row + 1
        place[name] = (COLUMN * column[name], -ROW * row)
    lowest = min(z for _, z in place.values())

    back = 0
    labelled: set[tuple[str, str]] = set()
    for source, target, port in edges:
        x0, z0 = place[source]
        x1, z1 = place[target]
        start, end = (x0 + WIDTH / 2, z0), (x1 - WIDTH / 2, z1)
        columns = column[target] - column[source]
        if columns > 0:
            ways = [start, end]
            if z0 == z1 and columns > 1:  # Over the boxes between.
                lift = HEIGHT / 2 + 0.3
                ways = [start, (start[0] + 0.25, z0 + lift)]
                ways += [(end[0] - 0.25, z1 + lift), end]
            if (source, port) not in labelled:
                middle = len(ways) // 2
                _label(ax, ways[middle - 1], ways[middle], port)
                labelled.add((source, port))
        else:
            back += 1
            low = lowest - HEIGHT / 2 - 0.3 * back
            side = 0.1 + 0.12 * back
            ways = [start, (start[0] + side, z0), (start[0] + side, low)]
            ways += [(end[0] - side, low), (end[0] - side, z1), end]
            _label(ax, ways[2], ways[3], port)
        _arrow(ax, ways)
    for name, (x, z) in place.items():
        is_log = name.endswith("_log")
        box = FancyBboxPatch(
            (x - WIDTH / 2, z - HEIGHT / 2),
            WIDTH,
            HEIGHT,
            boxstyle="round,pad=0,rounding_size=0.08",
            facecolor="#f2f2f2" if is_log else "#dce9f7",
            edgecolor="#555555",
            zorder=3,
        )
        ax.add_patch(box)
        ax.text(x, z, name, ha="center", va="center", fontsize=9, zorder=4)
    ax.set_xlim(-WIDTH, max(x for x, _ in place.values()) + WIDTH)
    ax.set_ylim(lowest - HEIGHT - 0.3 * back, HEIGHT + 0.5)
    ax.set_aspect("equal")
    ax.set_axis_off()


def make_picture(diagram: Diagram, root: str = "glider") -> Figure:
    """Returns a figure of a diagram, as large as it needs."""
    figure = Figure(layout="constrained")
    ax = figure.add_subplot()
    draw_diagram(diagram, ax, root)
    width, height = (abs(b - a) for a, b in (ax.get_xlim(), ax.get_ylim()))
    figure.set_size_inches(0.75 * width, 0.75 * height)
    return figure


def _arrow(ax: Axes, ways: list[tuple[float, float]]) -> None:
    xs, zs = zip(*ways, strict=True)
    ax.plot(xs[:-1], zs[:-1], color="#333333", linewidth=1.0, zorder=1)
    ax.annotate(
        "",
        xy=ways[-1],
        xytext=ways[-2],
        arrowprops={
            "arrowstyle": "-|>",
            "color": "#333333",
            "shrinkA": 0,
            "shrinkB": 0,
        },
        zorder=1,
    )


def _label(
    ax: Axes, start: tuple[float, float], end: tuple[float, float], port: str
) -> None:
    x, z = 0.5 * (start[0] + end[0]), 0.5 * (start[1] + end[1])
    ax.text(
        x,
        z + 0.03,
        port,
        ha="center",
        va="bottom",
        fontsize=6.5,
        color="#777777",
        zorder=2,
    )
