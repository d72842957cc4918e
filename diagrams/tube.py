"""A funnel to look at: its tube of positions, in a figure and in Meshcat."""

import numpy as np
from matplotlib.axes import Axes
from pydrake.geometry import Meshcat, Rgba

from glider.verification.funnel.funnel import Funnel

_RINGS = 90
"""Rings of vertices along the flight."""

_SIDES = 24
"""Vertices of a ring."""


def tube_of(funnel: Funnel, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns unit normals of the path in the plane (K, 2) and radii (K,) [m].

    A radius is how far a state of the funnel may be from the path, across it.
    """
    place = np.linalg.inv(funnel.shape(times))[:, :2, :2]
    along = funnel.nominal.path(times, 1)[:, :2]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    normals = np.stack([-along[:, 1], along[:, 0]], axis=1)
    return normals, np.sqrt(np.einsum("ki,kij,kj->k", normals, place, normals))


def plot_tube(ax: Axes, funnel: Funnel) -> None:
    """Draws the tube in the vertical plane about the nominal flight, to one scale."""
    normals, radii = tube_of(funnel, funnel.nominal.times)
    centers = funnel.nominal.states[:, :2]
    across = radii[:, None] * normals
    edge = np.concatenate([centers + across, (centers - across)[::-1]])
    ax.fill(*edge.T, alpha=0.25, label="funnel, projected")
    ax.plot(*centers.T, color="k", lw=1.5, label="nominal flight")
    ax.set_aspect("equal", adjustable="datalim")
    ax.set(xlabel="x [m]", ylabel="z [m]")
    ax.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)


def draw_tube(meshcat: Meshcat, funnel: Funnel) -> None:
    """Draws the tube in Meshcat as a translucent surface of revolution."""
    first, last = funnel.nominal.times[[0, -1]]
    times = np.linspace(first, last, _RINGS)
    normals, radii = tube_of(funnel, times)
    angles = np.linspace(0.0, 2.0 * np.pi, _SIDES, endpoint=False)
    across = radii[:, None] * np.cos(angles)
    vertices = np.zeros((_RINGS, _SIDES, 3))
    vertices[..., [0, 2]] = funnel.center(times)[:, None, :2]
    vertices[..., [0, 2]] += across[..., None] * normals[:, None]
    vertices[..., 1] = radii[:, None] * np.sin(angles)
    ring, side = np.meshgrid(np.arange(_RINGS - 1), np.arange(_SIDES), indexing="ij")
    here = (ring * _SIDES + side).ravel()
    beside = (ring * _SIDES + (side + 1) % _SIDES).ravel()
    halves = [
        np.stack([here, beside, here + _SIDES]),
        np.stack([beside, beside + _SIDES, here + _SIDES]),
    ]
    faces = np.hstack(halves)
    blue = Rgba(0.2, 0.45, 0.85, 0.25)
    meshcat.SetTriangleMesh("/funnel", vertices.reshape(-1, 3).T, faces, blue)
