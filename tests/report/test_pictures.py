"""Figures as PNG files: every mark is seen, and no text covers another."""

import dataclasses
import io
import re
from itertools import combinations

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from PIL import Image

from glider.report.error_table import columns_of
from glider.report.folder import FIGURES
from glider.report.plots.as_file import draw, font, to_png
from glider.report.plots.figure import (
    Axis,
    Band,
    Bars,
    Figure,
    Ground,
    Level,
    Line,
    Panel,
    Points,
)
from glider.report.plots.style import COLORS
from tests.report.results import VARIANTS, make_errors, make_result
from tests.report.test_findings import ALL_MODELS

X = np.array([0.0, 1.0, 2.0])


def picture_of(*marks, dpi=50, **axes):
    figure = Figure(panels=[Panel(title="a", marks=marks, **axes)], columns=1)
    return np.asarray(Image.open(io.BytesIO(to_png(figure, dpi)))) / 255.0


def seen(picture, key):
    """Share of a picture that has about the colour of a key."""
    color = np.array(to_rgb(COLORS[key]))
    return np.mean(np.all(np.abs(picture - color) < 0.05, axis=2))


@pytest.mark.parametrize(
    "mark",
    [
        Line(key="corrected", x=X, y=X, width=4.0),
        Points(key="corrected", x=X, y=X, size=20.0),
        Bars(key="corrected", places=X, values=X, texts=("", "", ""), hover=""),
        Bars(
            key="corrected",
            places=X,
            values=X,
            texts=("", "", ""),
            hover="",
            is_across=True,
        ),
    ],
    ids=("line", "points", "bars", "bars across"),
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


def boxes_of(picture):
    """Boxes (x0, y0, x1, y1) of a picture's texts, in points from the upper left."""
    boxes = []
    for text in picture.texts:
        shown = re.sub(r"\$C_(\w)\$", r"C\1", text.text)
        size = text.size * picture.scale
        anchor = "mm" if text.is_upright else text.anchor
        box = np.array(font(size).getbbox(shown, anchor=anchor)) / picture.scale
        if text.is_upright:
            box = box[[1, 0, 3, 2]] + [-box[1], 0.0, -box[1], 0.0]
        place = np.array([text.x, picture.height - text.y])
        boxes.append((text, box + np.tile(place, 2)))
    return [(text, box) for text, box in boxes if text.text]


@pytest.mark.parametrize("name", ["flight_$x$.csv", r"a\b$ 1 $", "<b>&amp;"])
def test_names_of_files_are_no_formulas(name):
    """They are drawn letter by letter, in the legend and above a panel."""
    figure = Figure(keys={"own": name}, panels=[Panel(title=name, marks=[])])
    assert [t.text for t in draw(figure).texts].count(name) == 2
    dots = dataclasses.replace(figure, panels=[Panel(title="." * 9, marks=[])])
    assert to_png(figure, dpi=30) != to_png(dots, dpi=30)


def test_a_symbol_has_a_subscript():
    def width_of(title):
        picture = Figure(panels=[Panel(title=title, marks=[])])
        pixels = np.asarray(Image.open(io.BytesIO(to_png(picture))))
        return np.ptp(np.argwhere(pixels[:30] < 128)[:, 1])

    assert width_of("C") < width_of("$C_n$") < width_of("Cn") < width_of("$C_n")


def test_the_legend_is_dashed_where_lines_are():
    def share(is_solid):
        line = Line(key="rest", x=X, y=np.full(3, np.nan), is_solid=is_solid)
        figure = Figure(keys={"rest": ""}, panels=[Panel(title="", marks=[line])])
        return seen(np.asarray(Image.open(io.BytesIO(to_png(figure)))) / 255, "rest")

    assert 0.0 < share(is_solid=False) < 0.9 * share(is_solid=True)


@pytest.mark.parametrize("name", FIGURES)
@pytest.mark.parametrize(
    "result",
    [
        dataclasses.replace(ALL_MODELS, model=VARIANTS["unexplained"].model),
        dataclasses.replace(VARIANTS["diverged"], model=VARIANTS["unexplained"].model),
    ],
    ids=("all", "few"),
)
def test_legend_titles_and_labels_are_inside_and_apart(name, result):
    picture = draw(FIGURES[name](result))
    keys = set(FIGURES[name](result).keys.values())
    boxes = boxes_of(picture)
    legend = [box for text, box in boxes if text.text in keys and text.size == 9.0]
    assert len(legend) == len(keys)
    for text, (x0, y0, x1, y1) in boxes:
        assert x0 >= -1.0
        assert x1 <= picture.width + 1.0
        assert y1 <= picture.height + 1.0
        if not any(np.array_equal((x0, y0, x1, y1), box) for box in legend):
            assert y0 >= max(box[3] for box in legend) - 1.0, text.text


@pytest.mark.parametrize("result", [make_result(), ALL_MODELS], ids=("three", "four"))
def test_texts_do_not_overlap(result):
    errors = dict.fromkeys(columns_of(result), make_errors(0.5432))
    picture = draw(FIGURES["errors"](make_result(errors=errors)))
    for (one, a), (other, b) in combinations(boxes_of(picture), 2):
        apart = a[2] <= b[0] or b[2] <= a[0] or a[3] <= b[1] or b[3] <= a[1]
        assert apart, f"{one.text} covers {other.text}"
