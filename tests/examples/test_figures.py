"""Figures: legends cover nothing, rings are round."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from learning_figures import save_learning_figure


def save_learning(path):
    x = np.linspace(-3.5, 0.0, 40)
    paths = [np.column_stack([x, 0.3 * np.sin(x + 0.1 * k)]) for k in range(4)]
    costs = {"terminal_cost": [100.0, 10.0, 1.0], "miss_m": [0.3, 0.05, 0.01]}
    loops = {"rbf": {**costs, "weight_change": [1.0, 0.1]}, "traced": costs}
    save_learning_figure(path, paths, {**loops, "oracle_miss_m": 0.01, "launches": 3})


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


@pytest.mark.parametrize("drawn", [save_learning], indirect=True)
def test_a_legend_covers_no_axes_and_is_not_cut(drawn):
    legends = [ax.get_legend() for ax in drawn.axes if ax.get_legend() is not None]
    assert legends
    for legend in legends:
        box = legend.get_window_extent().padded(-1.0)  # It may touch.
        assert not any(ax.get_window_extent().overlaps(box) for ax in drawn.axes)
        assert drawn.bbox.x1 >= box.x1
        assert drawn.bbox.y1 >= box.y1


@pytest.mark.parametrize("drawn", [save_learning], indirect=True)
def test_a_ring_is_round(drawn):
    assert drawn.axes[0].get_aspect() == 1.0
