"""Figures as PNG files: every mark is seen, and no text covers another."""

import dataclasses
import io
from itertools import combinations

import matplotlib
import matplotlib.image
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from glider.report.error_table import columns_of
from glider.report.figures_of_result import FIGURES
from glider.report.plots.as_file import draw, to_png
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
from glider.report.plots.style import COLORS, STYLE
from tests.report.results import VARIANTS, make_errors, make_result
from tests.report.test_findings import ALL_MODELS

X = np.array([0.0, 1.0, 2.0])


def picture_of(*marks, dpi=50, **axes):
    figure = Figure(panels=[Panel(title="a", marks=marks, **axes)], columns=1)
    return matplotlib.image.imread(io.BytesIO(to_png(figure, dpi)))[:, :, :3]


def seen(picture, key):
    """Share of a picture that has about the colour of a key."""
    color = np.array(matplotlib.colors.to_rgb(COLORS[key]))
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


def test_names_of_files_are_no_formulas():
    """Matplotlib takes what stands between dollars for one."""
    names = ("flight_$x$ $C_q$.csv", "$C_L$, nominal", r"a\b$ 1 $")
    for name in names:
        figure = Figure(keys={"own": name}, panels=[Panel(title=name, marks=[])])
        picture = draw(figure)
        (title,) = [t for t in picture.axes[0].texts if "$" in t.get_text()]
        assert title.get_text().replace(r"\$", "$") == name
        to_png(figure, dpi=30)


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
    with matplotlib.rc_context(STYLE):
        picture = draw(FIGURES[name](result))
        FigureCanvasAgg(picture).draw()
        boxes = [legend.get_window_extent() for legend in picture.legends]
        for ax in picture.axes:
            around = ax.get_tightbbox()
            boxes.append(around)
            assert around.y1 <= min(box.y0 for box in boxes[: len(picture.legends)]) + 1
    assert boxes
    for box in boxes:
        assert box.x0 >= -1.0
        assert box.x1 <= picture.bbox.x1 + 1.0
        assert box.y0 >= -1.0


@pytest.mark.parametrize("result", [make_result(), ALL_MODELS], ids=("three", "four"))
def test_texts_do_not_overlap(result):
    errors = dict.fromkeys(columns_of(result), make_errors(0.5432))
    with matplotlib.rc_context(STYLE):
        picture = draw(FIGURES["errors"](make_result(errors=errors)))
        FigureCanvasAgg(picture).draw()
    for ax in picture.axes:
        texts = [t for t in ax.texts if t.get_text()]
        for one, other in combinations(texts, 2):
            apart = not one.get_window_extent().overlaps(other.get_window_extent())
            assert apart, f"{one.get_text()} covers {other.get_text()}"
