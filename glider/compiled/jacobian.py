"""Exact slopes of the dynamics by complex steps."""

import numpy as np

from glider.compiled.kernel import CompileError, Family, UncompilableError
from glider.compiled.runge_kutta import TINY
from glider.physics.chain import NUM_INPUTS, derivatives_of
from glider.physics.model import GliderModel


def directional(t, z, directions, n, gaussians, value, slopes):
    """The derivatives of a glider and their exact slopes along given directions.

    By complex steps, f'(z) v = Im f(z + i h v) / h for a tiny h, without a
    difference in which digits could cancel. Unit vectors give the Jacobian.

    Args:
        t: [s].
        z: as in `derivatives_of`.
        directions: (r, m); row i belongs to z[i], missing rows are zero.
        n: number of states.
        gaussians: of the free functions.
        value: (n,), written.
        slopes: (n, m), written.
    """
    y = z.astype(np.complex128)
    for k in range(max(directions.shape[1], 1)):
        if directions.shape[1] > 0:
            for i in range(directions.shape[0]):
                y[i] = z[i] + 1j * TINY * directions[i, k]
        d = derivatives_of(t, y, n, gaussians)
        for i in range(len(d)):
            value[i] = d[i].real
            if directions.shape[1] > 0:
                slopes[i, k] = d[i].imag / TINY


LOOPS = Family((directional,), (directional,))


def stacked(model: GliderModel) -> np.ndarray:
    """Returns the z of `derivatives_of` with state and inputs at zero."""
    return np.concatenate([np.zeros(model.num_states + NUM_INPUTS), model.vector])


def differentiate(
    model: GliderModel, t: float, z: np.ndarray, directions: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Returns the derivatives (n,) and their slopes (n, m) along directions.

    Args:
        model: whose effects and free functions act; its numbers stand in z.
        t: [s].
        z: as in `derivatives_of`, see `stacked`.
        directions: (r, m), in Fortran's order so that one type is compiled.

    Raises:
        UncompilableError: a formula is not of what numba compiles.
    """
    n = model.num_states
    value = np.empty(n)
    slopes = np.empty((n, directions.shape[1]))
    loop = LOOPS.over(model.kinds).directional
    try:
        loop(t, z, directions, n, model.gaussians, value, slopes)
    except CompileError as error:
        raise UncompilableError(str(error)) from None
    return value, slopes
