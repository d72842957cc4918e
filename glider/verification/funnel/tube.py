"""The positions that a funnel allows: a tube about the path in the vertical plane."""

import numpy as np

from glider.verification.funnel.funnel import Funnel


def tube_radii(funnel: Funnel, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns unit normals of the path in the plane (K, 2) and radii (K,) [m].

    A radius is how far a state of the funnel may be from the path, across it.
    """
    place = np.linalg.inv(funnel.shape(times))[:, :2, :2]
    centers = funnel.center(times)
    along = np.gradient(centers[:, :2], times, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    normals = np.stack([-along[:, 1], along[:, 0]], axis=1)
    radii = np.sqrt(np.einsum("ki,kij,kj->k", normals, place, normals))
    return normals, radii


def tube_outline(funnel: Funnel) -> np.ndarray:
    """Returns the tube's edge as a polygon (2 T, 2) of x, z [m]."""
    times = funnel.nominal.times
    normals, radii = tube_radii(funnel, times)
    centers = funnel.center(times)[:, :2]
    above, below = (centers + sign * radii[:, None] * normals for sign in (1.0, -1.0))
    return np.concatenate([above, below[::-1]])
