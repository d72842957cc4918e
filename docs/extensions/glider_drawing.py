"""The glider from the side: axes, angles, lever arms and forces, with their signs.

`python docs/extensions/glider_drawing.py` writes docs/pictures/glider.svg, which README
shows, too.
"""

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyArrowPatch

PICTURE = Path(__file__).parents[1] / "pictures" / "glider.svg"

PITCH = np.radians(-20.0)
ELEVATOR = np.radians(32.0)
DESCENT = np.radians(18.0)
"""Of the velocity below the horizontal [rad]."""

WING_OFFSET, HINGE_OFFSET, ELEVATOR_OFFSET = 0.4, 2.7, 0.5
"""Not to scale: the article's glider has none, 0.27 m and 0.022 m."""

INK, GREY, BLUE, ORANGE, GREEN = "#222222", "#777777", "#0072B2", "#D55E00", "#008060"

NOTES = (
    ("pitch θ", "positive nose DOWN; here θ = −20°", BLUE),
    ("elevator φ", "positive trailing edge UP; here φ = +32°", ORANGE),
    ("angle of attack α", "atan2(−ż, ẋ) − θ, positive nose above v; here 38°", GREEN),
    ("forces f", "along the plate's normal, positive toward its upper side", INK),
    (
        "pitch moment",
        r"$-l_w f_w + (l_h \cos\varphi + l_e)\, f_e$, positive nose DOWN",
        INK,
    ),
)
"""Name, rule of its sign, and color."""


def forward(angle: float) -> np.ndarray:
    """Returns the unit vector (x, z) along a plate at an angle about +y [rad]."""
    return np.array([np.cos(angle), -np.sin(angle)])


def normal(angle: float) -> np.ndarray:
    """Returns a plate's normal (x, z)."""
    return np.array([np.sin(angle), np.cos(angle)])


def draw() -> Figure:
    """Draws the glider, which sinks with its nose up."""
    figure = Figure(figsize=(7.0, 4.75), layout="constrained")
    FigureCanvasSVG(figure)
    ax = figure.add_subplot()
    ax.set_axis_off()
    ax.set_aspect("equal")
    ax.set_xlim(-4.3, 3.9)
    ax.set_ylim(-3.4, 2.0)
    wing = WING_OFFSET * forward(PITCH)
    hinge = -HINGE_OFFSET * forward(PITCH)
    tail = PITCH + ELEVATOR
    elevator = hinge - ELEVATOR_OFFSET * forward(tail)
    _draw_body(ax, wing, hinge, elevator)
    _draw_angles(ax, hinge)
    _draw_forces(ax, wing, elevator)
    _draw_arms(ax, wing, hinge, elevator)
    _draw_axes(ax, np.array([-3.9, 0.55]))
    _write_notes(ax)
    return figure


def _draw_body(ax: Axes, wing, hinge, elevator) -> None:
    nose = 1.35 * forward(PITCH)
    tip = 2.0 * elevator - hinge
    ax.plot(*zip(hinge, nose, strict=True), color=GREY, lw=3, solid_capstyle="round")
    chord = 0.75 * forward(PITCH)
    ends = zip(wing - chord, wing + chord, strict=True)
    ax.plot(*ends, color=BLUE, lw=8, alpha=0.85, solid_capstyle="round")
    ends = zip(hinge, tip, strict=True)
    ax.plot(*ends, color=ORANGE, lw=6, solid_capstyle="round")
    ax.plot(*hinge, "o", color="white", mec=INK, ms=6, zorder=5)
    ax.plot(0.0, 0.0, "o", color="white", mec=INK, ms=9, zorder=5)
    ax.plot(0.0, 0.0, "o", color=INK, ms=3, zorder=6)
    _write(ax, nose + np.array([-0.05, 0.22]), "nose", GREY, ha="center")
    _write(ax, wing + np.array([0.2, 0.38]), "wing", BLUE)
    _write(ax, tip + np.array([-0.05, 0.22]), "elevator", ORANGE, ha="center")


def _draw_angles(ax: Axes, hinge) -> None:
    """Draws pitch, angle of attack and elevator from where they are counted."""
    for start, direction in (
        (np.zeros(2), forward(0.0) * 3.4),
        (1.35 * forward(PITCH), forward(PITCH) * 1.9),
        (hinge, -forward(PITCH) * 1.25),
    ):
        ends = zip(start, start + direction, strict=True)
        ax.plot(*ends, color=GREY, lw=0.9, ls=(0, (5, 4)))
    velocity = 2.9 * forward(DESCENT)
    _arrow(ax, np.zeros(2), velocity, GREEN)
    _write(ax, velocity + np.array([0.08, -0.12]), "velocity v", GREEN)
    _turn(ax, np.zeros(2), 1.75, 0.0, PITCH, BLUE)
    _write(ax, 1.86 * forward(0.5 * PITCH), "θ < 0", BLUE)
    _turn(ax, np.zeros(2), 2.65, DESCENT, PITCH, GREEN)
    _write(ax, 2.77 * forward(0.3 * DESCENT), "α > 0", GREEN)
    _turn(ax, hinge, 1.15, PITCH, PITCH + ELEVATOR, ORANGE, backward=True)
    middle = hinge - 1.25 * forward(PITCH + 0.45 * ELEVATOR)
    _write(ax, middle, "φ > 0", ORANGE, ha="right")


def _draw_forces(ax: Axes, wing, elevator) -> None:
    _arrow(ax, wing, wing + 1.5 * normal(PITCH), INK, width=2.2)
    _write(ax, wing + 1.5 * normal(PITCH) + np.array([0.12, 0.02]), "$f_w$", INK)
    up = 0.75 * normal(PITCH + ELEVATOR)
    _arrow(ax, elevator, elevator + up, INK, width=2.2)
    _write(ax, elevator + up + np.array([0.1, 0.05]), "$f_e$", INK)
    weight = np.array([0.0, -1.25])
    _arrow(ax, np.zeros(2), weight, INK, width=2.2)
    _write(ax, weight + np.array([-0.12, 0.1]), "$m g$", INK, ha="right")
    _write(ax, np.array([-0.12, 0.24]), "center of mass", INK, ha="right")


def _draw_arms(ax: Axes, wing, hinge, elevator) -> None:
    """Draws the dimension lines below the glider."""
    below = -normal(PITCH)
    zero = np.zeros(2)
    _measure(ax, zero, wing, 0.85 * below, "$l_w$", "wing_offset", beside=True)
    _measure(ax, hinge, zero, 0.85 * below, "$l_h$", "hinge_offset")
    down = -normal(PITCH + ELEVATOR)
    _measure(ax, elevator, hinge, 0.5 * down, "$l_e$", "elevator_offset")


def _measure(
    ax: Axes, start, end, offset, symbol: str, name: str, *, beside=False
) -> None:
    for point in (start, end):
        ends = zip(point + 0.15 * offset, point + 1.08 * offset, strict=True)
        ax.plot(*ends, color=GREY, lw=0.7)
    arrow = FancyArrowPatch(
        start + offset,
        end + offset,
        arrowstyle="<->",
        mutation_scale=9,
        color=GREY,
        lw=1,
        shrinkA=0,
        shrinkB=0,
    )
    ax.add_patch(arrow)
    place = end + offset + np.array([0.08, -0.16])
    if not beside:
        place = 0.5 * (start + end) + 1.45 * offset - np.array([0.12, 0.0])
    align = "left" if beside else "center"
    _write(ax, place, f"{symbol}  {name}", INK, ha=align, size=9.5)


def _draw_axes(ax: Axes, origin) -> None:
    _arrow(ax, origin, origin + np.array([0.95, 0.0]), INK)
    _arrow(ax, origin, origin + np.array([0.0, 0.95]), INK)
    _write(ax, origin + np.array([1.02, 0.0]), "x forward", INK)
    _write(ax, origin + np.array([0.0, 1.12]), "z up", INK, ha="center")
    ax.add_patch(Circle(origin, 0.13, fc="white", ec=INK, lw=1.2, zorder=4))
    ax.plot(*origin, "x", color=INK, ms=6, zorder=5)
    _write(
        ax,
        origin + np.array([-0.05, -0.33]),
        "y into the page",
        INK,
        ha="left",
        size=9.5,
    )
    # Clockwise, as a right-handed turn about an axis into the page is.
    _turn(ax, origin, 0.62, np.radians(-75.0), np.radians(-12.0), INK)
    _write(ax, origin + np.array([0.58, 0.52]), "positive θ, φ", INK, size=9.5)


def _write_notes(ax: Axes) -> None:
    for row, (name, rule, color) in enumerate(NOTES):
        height = -2.2 - 0.28 * row
        _write(ax, np.array([-4.2, height]), name, color, weight="bold", size=9.5)
        _write(ax, np.array([-2.3, height]), rule, INK, size=9.5)


def _arrow(ax: Axes, start, end, color: str, width: float = 1.6) -> None:
    arrow = FancyArrowPatch(
        start,
        end,
        arrowstyle="-|>",
        mutation_scale=14,
        color=color,
        lw=width,
        shrinkA=0,
        shrinkB=0,
        zorder=4,
    )
    ax.add_patch(arrow)


def _turn(ax: Axes, center, radius, start, end, color, *, backward=False) -> None:
    """Draws an arc about a center from one angle about +y to another, with a head."""
    side = -1.0 if backward else 1.0
    angles = np.linspace(start, end, 40)
    path = np.array([center + side * radius * forward(angle) for angle in angles])
    ax.plot(*path.T, color=color, lw=1.6)
    _arrow(ax, path[-4], path[-1], color)


def _write(ax: Axes, place, text: str, color: str, *, size=10.5, **more) -> None:
    ax.text(*place, text, color=color, va="center", size=size, **more)


def save(figure: Figure, path: Path) -> None:
    """Writes a figure as SVG, the same bytes for the same figure."""
    settings = {"svg.hashsalt": path.stem, "svg.fonttype": "path"}
    with mpl.rc_context(settings):
        figure.savefig(path, metadata={"Date": None})


if __name__ == "__main__":
    save(draw(), PICTURE)
