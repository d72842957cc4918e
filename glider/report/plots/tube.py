"""The positions that a funnel allows, to draw: a tube about its path."""

import numpy as np

from glider.verification.funnel.funnel import Funnel


def tube_radii(funnel: Funnel, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns unit normals of the path in the plane (K, 2) and radii (K,) [m].

    A radius is how far a state of the funnel may be from the path, across it.
    """
    place = np.linalg.inv(funnel.shape(times))[:, :2, :2]
    along = funnel.nominal.path(times, 1)[:, :2]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    normals = np.stack([-along[:, 1], along[:, 0]], axis=1)
    return normals, np.sqrt(np.einsum("ki,kij,kj->k", normals, place, normals))


def tube_outline(funnel: Funnel) -> np.ndarray:
    """Returns the tube's edge as a polygon (2 T, 2) of x, z [m]."""
    normals, radii = tube_radii(funnel, funnel.nominal.times)
    centers, across = funnel.nominal.states[:, :2], radii[:, None] * normals
    return np.concatenate([centers + across, (centers - across)[::-1]])
