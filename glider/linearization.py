"""The compiled dynamics of one glider, point by point, with exact slopes."""

import numpy as np

from glider.kernel import compiled
from glider.parameters import parameter_vector


class Dynamics:
    """ẋ = f(x, u) of a glider in still air, at time 0.

    Attributes:
        num_states: n, with the effects' own states.
    """

    def __init__(self, plant):
        """Takes drawing and effects from a GliderPlant's model."""
        model = plant.model
        self.num_states = len(plant.state_names)
        self._kernel = compiled(plant.kinds, model.field is not None)
        self._field = model.residual_field
        self._theta = np.array(
            [
                *parameter_vector(model.parameters),
                *(value for effect in model.effects for value in effect.values),
            ]
        )
        self._z = np.zeros(self.num_states + 3 + len(self._theta))
        self._z[self.num_states + 3 :] = self._theta
        self._all = np.asfortranarray(np.eye(self.num_states + 1))
        self._none = np.empty((0, 0))

    def evaluate(self, x, u):
        """Returns f, shape (n,)."""
        return self._differentiate(x, u, self._none)[0]

    def linearize(self, x, u):
        """Returns f (n,) and its slopes by state and input (n, n + 1)."""
        return self._differentiate(x, u, self._all)

    def fly(self, x, inputs, step):
        """Returns where a state is after Runge-Kutta steps, shape (n,).

        Args:
            x: (n,) state.
            inputs: (K, 3) elevator-rate commands at the start, the middle and the
                end of each step [rad/s].
            step: [s].
        """
        for first, middle, last in inputs:
            k1 = self.evaluate(x, first)
            k2 = self.evaluate(x + 0.5 * step * k1, middle)
            k3 = self.evaluate(x + 0.5 * step * k2, middle)
            k4 = self.evaluate(x + step * k3, last)
            x = x + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        return x

    def _differentiate(self, x, u, directions):
        n = self.num_states
        value, slopes = np.empty(n), np.empty((n, directions.shape[1]))
        self._z[:n], self._z[n] = x, u
        self._kernel.directional(
            0.0, self._z, directions, n, self._field, value, slopes
        )
        return value, slopes
