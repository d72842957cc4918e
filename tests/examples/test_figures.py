"""Figures: legends cover nothing, and funnels say what they are."""

import types
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from examples.perching_funnel import save_funnel_figure
from glider.paths import models_path
from glider.verification.funnel.funnel import load_funnel


def save_funnel(path):
    funnel = load_funnel(models_path("funnels", "drawn.npz"))
    study = types.SimpleNamespace(funnel=funnel, flights=[funnel.nominal.states])
    save_funnel_figure(path, {"nominal": study})


@pytest.fixture
def drawn(monkeypatch, request):
    """The figure that a function saves, laid out."""
    kept = []

    def keep(figure, path, **options):
        figure.draw_without_rendering()
        kept.append(figure)

    monkeypatch.setattr(Figure, "savefig", keep)
    request.param(Path("figure.png"))
    [figure] = kept
    return figure


@pytest.mark.parametrize("drawn", [save_funnel], indirect=True)
def test_a_legend_covers_no_axes_and_is_not_cut(drawn):
    legends = [ax.get_legend() for ax in drawn.axes if ax.get_legend() is not None]
    assert legends
    for legend in legends:
        box = legend.get_window_extent().padded(-1.0)  # It may touch.
        assert not any(ax.get_window_extent().overlaps(box) for ax in drawn.axes)
        assert drawn.bbox.x1 >= box.x1
        assert drawn.bbox.y1 >= box.y1


@pytest.mark.parametrize("drawn", [save_funnel], indirect=True)
def test_a_funnel_says_whether_it_is_a_slice_or_a_projection(drawn):
    top, *widths = drawn.axes
    words = [text.get_text() for text in top.get_legend().get_texts()]
    assert words == ["funnel, projected", "1 flight"]
    assert all("slice" in ax.get_ylabel() for ax in widths)
