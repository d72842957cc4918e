"""The dynamics of one glider, point by point, with exact slopes."""

import numpy as np
from pydrake.autodiffutils import ExtractGradient, ExtractValue, InitializeAutoDiff

from glider.compiled.collocation import LOOPS as POINTS
from glider.compiled.jacobian import differentiate, stacked
from glider.compiled.kernel import UncompilableError, compile_errors
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

    def rates(self, points: np.ndarray) -> np.ndarray:
        """Returns f (P, n) at many points (P, n + 1) of state and input."""
        found = np.empty((len(points), self.num_states))
        if self.fast:
            try:
                POINTS.over(self.model.kinds, self.model.has_field).rates_at(
                    np.ascontiguousarray(points), self._theta, found
                )
                return found
            except compile_errors():
                self.fast = False
        for k, point in enumerate(points):
            found[k] = self.evaluate(point[:-1], point[-1])
        return found

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
