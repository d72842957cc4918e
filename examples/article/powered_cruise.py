"""The article's powered cruise: level flight and the LQR that holds it.

`cruise` holds a glide with the elevator alone. Here the thrust, the
coefficient of the effect of that name, is the second input.
"""

import numpy as np
from scipy.linalg import solve_continuous_are
from scipy.optimize import fsolve

from glider.compiled.runge_kutta import TINY
from glider.errors import InputError
from glider.physics.compose import compose
from glider.physics.effects import THRUST
from glider.physics.model import GliderModel
from glider.physics.parameters import GliderParameters


def level_flight(parameters: GliderParameters, speed: float) -> np.ndarray:
    """Returns state and thrust (8,) of level flight in still air.

    Raises:
        InputError: there is none at this speed within the elevator's travel.
    """

    def point(unknown):
        pitch, elevator, thrust = unknown
        return np.array([0.0, 0.0, pitch, elevator, speed, 0.0, 0.0, thrust])

    found, _, status, _ = fsolve(
        lambda unknown: _motion(parameters, point(unknown), 0.0)[4:7],
        [-0.1, 0.1, 0.3],
        full_output=True,
        xtol=1e-12,
    )
    low, high, _ = parameters.servo
    if status != 1 or not low <= found[1] <= high:
        raise InputError(f"No level flight at {speed:g} m/s was found.")
    return point(found)


def cruise_gain(parameters: GliderParameters, trim: np.ndarray) -> np.ndarray:
    """Returns the gain (2, 7) from the state to elevator rate and thrust.

    The article's weights: 1 on every state but x, 1000 on z, 0.1 on the inputs.
    """
    slopes = np.empty((7, 9))
    for k in range(9):  # State, thrust, elevator rate.
        y = np.append(trim, 0.0).astype(complex)
        y[k] += 1j * TINY
        slopes[:, k] = _motion(parameters, y[:8], y[8]).imag / TINY
    A, B = slopes[1:, 1:7], slopes[1:, [8, 7]]
    Q, R = np.diag([1000.0, 1.0, 1.0, 1.0, 1.0, 1.0]), 0.1 * np.eye(2)
    gain = np.linalg.solve(R, B.T @ solve_continuous_are(A, B, Q, R))
    return np.hstack([np.zeros((2, 1)), gain])


def _motion(
    parameters: GliderParameters, point: np.ndarray, rate: complex
) -> np.ndarray:
    """Returns the derivatives (7,) at a state and thrust (8,) in still air."""
    derivatives = compose((THRUST,)).derivatives
    theta = GliderModel(parameters=parameters).numbers._replace(c=point[7:])
    return np.array(derivatives(0.0, point[:7], rate, 0.0, 0.0, theta))
