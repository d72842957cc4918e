"""Figures as PNG files: every mark is seen, and no text covers another."""

import dataclasses
import io
from itertools import combinations

import numpy as np
import pytest
from matplotlib.cbook import is_math_text
from matplotlib.colors import to_rgb
from matplotlib.image import imread
from matplotlib.text import Text

from glider.report.folder import FIGURES
from glider.report.plots.as_file import draw, to_png
from glider.report.plots.figure import (
    Axis,
    Band,
    Figure,
    Ground,
    Level,
    Line,
    Panel,
    Points,
)
from glider.report.plots.style import COLORS
from tests.report.results import VARIANTS, make_result

X = np.array([0.0, 1.0, 2.0])


def picture_of(*marks, dpi=50, **axes):
    figure = Figure(panels=[Panel(title="a", marks=marks, **axes)], columns=1)
    return pixels_of(figure, dpi)


def pixels_of(figure, dpi=110):
    """Red, green and blue of each pixel, (rows, columns, 3) in 0 .. 1."""
    return imread(io.BytesIO(to_png(figure, dpi)))[:, :, :3]


def seen(picture, key):
    """Share of a picture that has about the colour of a key."""
    color = np.array(to_rgb(COLORS[key]))
    return np.mean(np.all(np.abs(picture - color) < 0.05, axis=2))


@pytest.mark.parametrize(
    "mark",
    [
        Line(key="corrected", x=X, y=X, width=4.0),
        Points(key="corrected", x=X, y=X, size=20.0),
    ],
    ids=("line", "points"),
)
def test_a_mark_is_seen_in_its_color(mark):
    picture = picture_of(mark)
    assert seen(picture, "corrected") > 1e-3
    assert seen(picture, "refitted") == 0.0


@pytest.mark.parametrize(
    "mark",
    [
        Band(key="corrected", x=X, low=X - 1.0, high=X + 1.0),
        Ground(start=0.5, end=1.5, key="corrected"),
        Ground(start=0.5, end=1.5, along="y", key="corrected"),
        Level(value=1.0),
    ],
    ids=("band", "ground", "ground across", "level"),
)
def test_what_lies_behind_is_seen(mark):
    axes = {"x": Axis(range=(0.0, 2.0)), "y": Axis(range=(-1.0, 3.0))}
    difference = np.abs(picture_of(mark, **axes) - picture_of(**axes)).max(axis=2)
    assert np.mean(difference > 0.02) > 1e-3


def drawn_texts(picture):
    """Texts of a picture that are seen, without ticks beyond the axes' limits."""
    picture.draw_without_rendering()
    beyond = set()
    for axes in picture.axes:
        for axis in (axes.xaxis, axes.yaxis):
            low, high = sorted(axis.get_view_interval())
            ticks = [
                t for t in axis.get_major_ticks() if not low <= t.get_loc() <= high
            ]
            beyond |= {label for tick in ticks for label in (tick.label1, tick.label2)}
    texts = [text for text in picture.findobj(Text) if text not in beyond]
    return [text for text in texts if text.get_text() and text.get_visible()]


@pytest.mark.parametrize("name", ["flight_$x$.csv", r"a\b$ 1 $", "<b>&amp;"])
def test_names_of_files_are_no_formulas(name):
    """They are drawn letter by letter, in the legend and above a panel."""
    figure = Figure(keys={"measured": name}, panels=[Panel(title=name, marks=[])])
    texts = [text.get_text() for text in drawn_texts(draw(figure))]
    shown = [text.replace(r"\$", "$") for text in texts if not is_math_text(text)]
    assert shown.count(name) == 2
    dots = dataclasses.replace(figure, panels=[Panel(title="." * 9, marks=[])])
    assert to_png(figure, dpi=30) != to_png(dots, dpi=30)


def test_a_symbol_has_a_subscript():
    def width_of(title):
        picture = Figure(panels=[Panel(title=title, marks=[])])
        pixels = pixels_of(picture)
        return np.ptp(np.argwhere(pixels[:30] < 0.5)[:, 1])

    assert width_of("C") < width_of("$C_n$") < width_of("$C_n")


def test_the_legend_is_dashed_where_lines_are():
    def share(is_solid):
        line = Line(key="rest", x=X, y=np.full(3, np.nan), is_solid=is_solid)
        figure = Figure(keys={"rest": ""}, panels=[Panel(title="", marks=[line])])
        return seen(pixels_of(figure), "rest")

    assert 0.0 < share(is_solid=False) < 0.9 * share(is_solid=True)


@pytest.mark.parametrize("name", FIGURES)
@pytest.mark.parametrize(
    "result",
    [
        dataclasses.replace(make_result(), model=VARIANTS["unexplained"].model),
        dataclasses.replace(VARIANTS["diverged"], model=VARIANTS["unexplained"].model),
    ],
    ids=("all", "few"),
)
def test_legend_titles_and_labels_are_inside_and_apart(name, result):
    picture = draw(FIGURES[name](result))
    texts = drawn_texts(picture)
    [legend] = picture.legends
    entries = legend.get_texts()
    assert len(entries) == len(FIGURES[name](result).keys)
    lowest = min(entry.get_window_extent().y0 for entry in entries)
    for text in texts:
        box = text.get_window_extent()
        assert box.x0 >= -1.0, text
        assert box.y0 >= -1.0, text
        assert box.x1 <= picture.bbox.width + 1.0, text
        assert box.y1 <= picture.bbox.height + 1.0, text
        if text not in entries:
            assert box.y1 <= lowest + 1.0, text


@pytest.mark.parametrize("name", FIGURES)
def test_texts_do_not_overlap(name):
    result = dataclasses.replace(make_result(), model=VARIANTS["unexplained"].model)
    texts = drawn_texts(draw(FIGURES[name](result)))
    for one, other in combinations(texts, 2):
        a = one.get_window_extent()
        b = other.get_window_extent()
        assert not a.overlaps(b), f"{one} covers {other}"
