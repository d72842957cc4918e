"""The tube of a funnel: as wide as its sets, in the figure and in Meshcat."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from diagrams.programs.page import open_meshcat
from diagrams.tube import draw_tube, plot_tube, tube_of
from glider.paths import models_path
from glider.verification.funnel.funnel import load_funnel


@pytest.fixture(scope="module")
def funnel():
    return load_funnel(models_path("funnels", "held_head_wind_95_hook.npz"))


def test_the_tube_is_as_wide_as_the_sets_and_no_wider(funnel):
    """Of states that move across the path, the farthest in a set is at the radius."""
    times = np.linspace(*funnel.nominal.times[[0, -1]], 12)
    positions, across = tube_of(funnel, times)
    np.testing.assert_array_equal(positions, funnel.center(times)[:, :2])
    radii = np.linalg.norm(across, axis=1)
    normals = across / radii[:, None]
    rates = funnel.nominal.path(times, 1)[:, :2]
    np.testing.assert_allclose(np.sum(normals * rates, axis=1), 0.0, atol=1e-9)
    rng = np.random.default_rng(0)
    for time, normal, radius in zip(times, normals, radii, strict=True):
        shape = funnel.shape(time)
        states = rng.normal(size=(4000, len(shape)))
        states /= np.sqrt(np.einsum("ki,ij,kj->k", states, shape, states))[:, None]
        assert np.abs(states[:, :2] @ normal).max() <= radius
        across = np.zeros(len(shape))
        across[:2] = normal
        farthest = np.linalg.solve(shape, across) / radius
        assert farthest @ shape @ farthest == pytest.approx(1.0)
        assert farthest[:2] @ normal == pytest.approx(radius)


def test_figure_and_meshcat_show_it(funnel):
    axes = Figure().subplots()
    plot_tube(axes, funnel)
    low, high = axes.dataLim.intervaly
    _, [across, *_] = tube_of(funnel, funnel.nominal.times)
    radius = np.linalg.norm(across)
    assert low < funnel.nominal.states[0, 1] - 0.9 * radius < high
    meshcat = open_meshcat()
    draw_tube(meshcat, funnel)
    assert meshcat.HasPath("/funnel")
