"""Rotation matrices of logs as quaternions."""

import numpy as np
from scipy.spatial.transform import Rotation


def to_quaternions(matrices: np.ndarray) -> np.ndarray:
    """Quaternions x, y, z, w (n, 4) of matrices (n, 3, 3), nan where none is one.

    Zeros stand for a body that is not seen.
    """
    seen = np.isfinite(matrices).all(axis=(1, 2))
    seen[seen] = np.linalg.det(matrices[seen]) > 0.5
    quaternions = np.full((len(matrices), 4), np.nan)
    if seen.any():
        quaternions[seen] = Rotation.from_matrix(matrices[seen]).as_quat()
    return quaternions
