"""The way of a log through the program, from its columns to the page of a report.

`python docs/extensions/way_of_a_log.py` writes docs/pictures/way_of_a_log.svg. Each box
has a word of docs/glossary.md and the function that makes what it names.
"""

from pathlib import Path

from block_layouts import Layout
from boxes import Colors, draw_boxes
from glider_drawing import BLUE, GREEN, GREY, save
from matplotlib.figure import Figure

PICTURE = Path(__file__).parents[1] / "pictures" / "way_of_a_log.svg"

COLORS: dict[str, Colors] = {
    "glider/campaign": ("#E3F0F9", BLUE),
    "glider/sysid": ("#E2F3EC", GREEN),
    "glider/report": ("#F4F4F4", GREY),
}
"""Face and edge of a package's boxes."""

PACKAGES = {
    "glider/campaign": ("recording", "track", "cut flights", "campaign"),
    "glider/report": ("report.json", "page"),
}
"""Boxes of the packages; the others are of glider/sysid."""

WORDS = {
    ("recording", "campaign"): "files in the campaign's own columns",
    ("task", "linear flights"): "replay",
    ("model", "linear flights"): "until no other set is better",
}

LAYOUT = Layout(
    boxes={
        "recording": (0.0, 0.0, "read_recording"),
        "track": (2.9, 0.0, "make_track"),
        "cut flights": (5.8, 0.0, "cut"),
        "campaign": (8.7, 0.0, "with_flights"),
        "record": (0.0, -2.4, "prepare"),
        "task": (2.9, -2.4, "make_task"),
        "linear flights": (5.8, -2.4, "linearize"),
        "candidates": (8.7, -2.4, "gather"),
        "model": (11.6, -2.4, "fit_model"),
        "search result": (0.0, -4.9, "trace"),
        "rollout": (2.9, -4.3, "predict"),
        "residual table": (2.9, -5.5, "make_table"),
        "result": (5.8, -4.9, "Analysis.run"),
        "report.json": (8.7, -4.3, "write_report"),
        "page": (8.7, -5.5, "write_report"),
    },
    routes={
        ("recording", "track"): [(1.05, 0.0), (1.85, 0.0)],
        ("track", "cut flights"): [(3.95, 0.0), (4.75, 0.0)],
        ("cut flights", "campaign"): [(6.85, 0.0), (7.65, 0.0)],
        ("recording", "campaign"): [(0.0, 0.45), (0.0, 0.9), (8.7, 0.9), (8.7, 0.45)],
        ("campaign", "record"): [(8.7, -0.45), (8.7, -0.9), (0.0, -0.9), (0.0, -1.95)],
        ("record", "task"): [(1.05, -2.4), (1.85, -2.4)],
        ("task", "linear flights"): [(3.95, -2.4), (4.75, -2.4)],
        ("linear flights", "candidates"): [(6.85, -2.4), (7.65, -2.4)],
        ("candidates", "model"): [(9.75, -2.4), (10.55, -2.4)],
        ("model", "linear flights"): [
            (11.6, -1.95),
            (11.6, -1.5),
            (5.8, -1.5),
            (5.8, -1.95),
        ],
        ("model", "search result"): [
            (11.6, -2.85),
            (11.6, -3.4),
            (0.0, -3.4),
            (0.0, -4.45),
        ],
        ("search result", "rollout"): [
            (1.05, -4.8),
            (1.45, -4.8),
            (1.45, -4.3),
            (1.85, -4.3),
        ],
        ("search result", "residual table"): [
            (1.05, -5.0),
            (1.45, -5.0),
            (1.45, -5.5),
            (1.85, -5.5),
        ],
        ("rollout", "result"): [(3.95, -4.3), (4.35, -4.3), (4.35, -4.8), (4.75, -4.8)],
        ("residual table", "result"): [
            (3.95, -5.5),
            (4.35, -5.5),
            (4.35, -5.0),
            (4.75, -5.0),
        ],
        ("result", "report.json"): [
            (6.85, -4.8),
            (7.25, -4.8),
            (7.25, -4.3),
            (7.65, -4.3),
        ],
        ("result", "page"): [(6.85, -5.0), (7.25, -5.0), (7.25, -5.5), (7.65, -5.5)],
    },
    labels={
        ("recording", "campaign"): (4.35, 1.1, "center"),
        ("task", "linear flights"): (4.35, -2.2, "center"),
        ("model", "linear flights"): (8.7, -1.3, "center"),
    },
    size=(9.6, 5.2),
    x_limits=(-1.2, 12.8),
    y_limits=(-6.05, 1.3),
)


def draw() -> Figure:
    """Draws the way, and the colors of the packages."""
    package_of = dict.fromkeys(LAYOUT.boxes, "glider/sysid")
    for package, names in PACKAGES.items():
        package_of |= dict.fromkeys(names, package)
    colors = {name: COLORS[package] for name, package in package_of.items()}
    arrows = dict.fromkeys(LAYOUT.routes, "") | WORDS
    figure = draw_boxes(LAYOUT, arrows, colors)
    [ax] = figure.axes
    for row, (package, (_, edge)) in enumerate(COLORS.items()):
        height = 0.4 - 0.4 * row
        ax.text(10.55, height, package, size=10, weight="bold", color=edge, va="center")
    return figure


if __name__ == "__main__":
    save(draw(), PICTURE)
