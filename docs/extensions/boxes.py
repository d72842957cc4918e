"""Boxes, and arrows between them, as the block diagrams of the docs have them."""

from collections.abc import Mapping

from block_layouts import Layout, Pair
from glider_drawing import INK
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch

WIDTH, HEIGHT = 2.1, 0.9
"""Size of a box."""

Colors = tuple[str, str]  # Of a box: its face and its edge.


def draw_boxes(
    layout: Layout, arrows: Mapping[Pair, str], colors: Mapping[str, Colors]
) -> Figure:
    """Draws a layout.

    Args:
        layout: has a place for the words of each arrow that has any.
        arrows: words by the two boxes of an arrow.
        colors: by box.
    """
    figure = Figure(figsize=layout.size, layout="constrained")
    FigureCanvasSVG(figure)
    ax = figure.add_subplot()
    ax.set_axis_off()
    ax.set_aspect("equal")
    ax.set_xlim(*layout.x_limits)
    ax.set_ylim(*layout.y_limits)
    for name, (x, y, made_by) in layout.boxes.items():
        _draw_box(ax, x, y, name, made_by, colors[name])
    for pair, words in arrows.items():
        _draw_arrow(ax, layout.routes[pair])
        if words:
            x, y, align = layout.labels[pair]
            ax.text(x, y, words, size=8.2, color=INK, ha=align, va="center")
    return figure


def _draw_box(
    ax: Axes, x: float, y: float, name: str, made_by: str, colors: Colors
) -> None:
    face, edge = colors
    box = FancyBboxPatch(
        (x - 0.5 * WIDTH, y - 0.5 * HEIGHT),
        WIDTH,
        HEIGHT,
        boxstyle="round,pad=0,rounding_size=0.12",
        fc=face,
        ec=edge,
        lw=1.2,
    )
    ax.add_patch(box)
    middle = {"ha": "center", "va": "center"}
    ax.text(x, y + 0.16, name, weight="bold", size=10, color=INK, **middle)
    ax.text(x, y - 0.19, made_by, size=7.8, color=INK, **middle)


def _draw_arrow(ax: Axes, route) -> None:
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
