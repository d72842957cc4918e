"""Exact slopes of the dynamics by complex steps."""

import numpy as np

from glider.compiled.constants import TINY
from glider.physics.chain import derivatives


def directional(t, z, directions, n, field, value, slopes):
    """The derivatives of a glider and their exact slopes along given directions.

    By complex steps, f'(z) v = Im f(z + i h v) / h for a tiny h, without a
    difference in which digits could cancel. Unit vectors give the Jacobian.

    Args:
        t: [s].
        z: (n + 3 + 9 + len(c),) state, command [rad/s], wind (x, z) [m/s], p, c.
        directions: (r, m); row i belongs to z[i], missing rows are zero.
        n: number of states.
        field: as in `derivatives`.
        value: (n,), written.
        slopes: (n, m), written.
    """
    y = z.astype(np.complex128)
    for k in range(max(directions.shape[1], 1)):
        if directions.shape[1] > 0:
            for i in range(directions.shape[0]):
                y[i] = z[i] + 1j * TINY * directions[i, k]
        p, c = y[n + 3 : n + 12], y[n + 12 :]
        d = derivatives(t, y, y[n], y[n + 1], y[n + 2], p, c, field)
        for i in range(len(d)):
            value[i] = d[i].real
            if directions.shape[1] > 0:
                slopes[i, k] = d[i].imag / TINY


LOOPS = (directional,)
ENTRIES = (directional,)
USES = ()
