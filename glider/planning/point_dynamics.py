"""The dynamics of one glider, point by point, with exact slopes."""

import numpy as np
from pydrake.autodiffutils import ExtractGradient, ExtractValue, InitializeAutoDiff

from glider.compiled.jacobian import differentiate, stacked
from glider.compiled.kernel import UncompilableError
from glider.compiled.runge_kutta import advance
from glider.physics.model import GliderModel


class Dynamics:
    """ẋ = f(x, u) of a glider in still air, at time 0.

    Attributes:
        model: the glider.
        num_states: n, with the effects' own states.
        fast: whether it is compiled; False once a formula turns out not to compile.
            Then it is the formulas as they are, with AutoDiffXd.
    """

    def __init__(self, model: GliderModel, fast: bool = True) -> None:
        """Takes what `Dynamics` holds."""
        self.model, self.num_states, self.fast = model, model.num_states, fast
        self._theta, self._derivatives = model.numbers, model.chain.derivatives
        self._z = stacked(self.num_states, self._theta)
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

        def slope(t, node, x, tape, rate):
            rate[:] = self.evaluate(x, tape[node])

        x, work = x.copy(), np.empty((3, self.num_states))
        for tape in inputs:
            advance(slope, 0.0, x, step, 4, tape, work)
        return x

    def _differentiate(self, x, u, directions):
        n = self.num_states
        if self.fast:
            self._z[:n], self._z[n] = x, u
            try:
                return differentiate(self.model, 0.0, self._z, directions)
            except UncompilableError:
                self.fast = False
        z = InitializeAutoDiff(np.append(x, u))[:, 0]
        rates = np.array(self._derivatives(0.0, z[:-1], z[-1], 0.0, 0.0, self._theta))
        return ExtractValue(rates)[:, 0], ExtractGradient(rates)
