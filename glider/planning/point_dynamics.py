"""The dynamics of one glider, point by point, with exact slopes."""

import numba
import numpy as np
from pydrake.autodiffutils import ExtractGradient, ExtractValue, InitializeAutoDiff

from glider.compiled.kernel import compiled
from glider.physics.compose import compose
from glider.physics.parameters import parameter_vector


class Dynamics:
    """ẋ = f(x, u) of a glider in still air, at time 0.

    Compiled; where a formula does not compile, or the plant is not `fast`, by the
    formulas as they are, with AutoDiffXd.

    Attributes:
        num_states: n, with the effects' own states.
    """

    def __init__(self, plant):
        """Takes drawing and effects from a GliderPlant's model.

        Args:
            plant: a GliderPlant; not `fast` any more once a formula of its does
                not compile.
        """
        model = plant.model
        self._plant = plant
        self.num_states = len(plant.state_names)
        self._has_field = model.field is not None
        self._field = model.residual_field
        self._p, self._c = parameter_vector(model.parameters), model.coefficients
        self._z = np.zeros(self.num_states + 3 + len(self._p) + len(self._c))
        self._z[self.num_states + 3 :] = np.concatenate([self._p, self._c])
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
        if not self._plant.fast:
            return self._differentiate_plainly(x, u)
        n = self.num_states
        value, slopes = np.empty(n), np.empty((n, directions.shape[1]))
        self._z[:n], self._z[n] = x, u
        kernel = compiled(self._plant.kinds, self._has_field)
        try:
            kernel.directional(0.0, self._z, directions, n, self._field, value, slopes)
        except numba.core.errors.NumbaError:
            self._plant.fast = False
            return self._differentiate_plainly(x, u)
        return value, slopes

    def _differentiate_plainly(self, x, u):
        """Returns f (n,) and its slopes by state and input (n, n + 1)."""
        z = InitializeAutoDiff(np.append(x, u))[:, 0]
        chain = compose(self._plant.kinds, self._has_field)
        rates = np.array(
            chain.derivatives(
                0.0, z[:-1], z[-1], 0.0, 0.0, self._p, self._c, self._field
            )
        )
        return ExtractValue(rates)[:, 0], ExtractGradient(rates)
