"""A funnel to look at: its tube of positions, in a figure and in Meshcat."""

import numpy as np
from matplotlib.axes import Axes
from pydrake.geometry import Meshcat, Rgba

from glider.verification.funnel.funnel import Funnel

_RINGS = 90
"""Rings of vertices along the flight."""

_SIDES = 24
"""Vertices of a ring."""

_BLUE = Rgba(0.2, 0.45, 0.85, 0.25)


def tube_of(funnel: Funnel, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns where the nominal flight is at times, and the tube beside it.

    Returns:
        positions (K, 2) in the plane, and vectors (K, 2) across the path: as long as a
        state of the funnel may be from the path in that direction [m].
    """
    place = np.linalg.inv(funnel.shape(times))[:, :2, :2]
    along = funnel.nominal.path(times, 1)[:, :2]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    normals = along[:, ::-1] * [-1.0, 1.0]
    radii = np.sqrt(np.einsum("ki,kij,kj->k", normals, place, normals))
    return funnel.center(times)[:, :2], radii[:, None] * normals


def plot_tube(ax: Axes, funnel: Funnel) -> None:
    """Draws the tube in the vertical plane about the nominal flight, to one scale."""
    centers, across = tube_of(funnel, funnel.nominal.times)
    edge = np.concatenate([centers + across, (centers - across)[::-1]])
    ax.fill(*edge.T, alpha=0.25, label="funnel, projected")
    ax.plot(*centers.T, color="k", lw=1.5, label="nominal flight")
    ax.set_aspect("equal", adjustable="datalim")
    ax.set(xlabel="x [m]", ylabel="z [m]")
    ax.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)


def draw_tube(meshcat: Meshcat, funnel: Funnel) -> None:
    """Draws the tube in Meshcat as a translucent surface of revolution."""
    first, last = funnel.nominal.times[[0, -1]]
    centers, across = tube_of(funnel, np.linspace(first, last, _RINGS))
    angles = np.linspace(0.0, 2.0 * np.pi, _SIDES + 1)
    X, Z = centers.T[:, :, None] + across.T[:, :, None] * np.cos(angles)
    Y = np.linalg.norm(across, axis=1, keepdims=True) * np.sin(angles)
    meshcat.PlotSurface("/funnel", X, Y, Z, _BLUE)
