"""The covariance of a model's parameters.

It does not change how a glider flies, so a model's file has it beside the model.
"""

import dataclasses
from collections.abc import Collection, Sequence

import numpy as np

from glider.errors import expect
from glider.physics.effects.effect import Effect
from glider.physics.parameter_space import space_of

ROUNDING = 1e-9
"""Amount by which correlations may differ from their mirror images, and the least
eigenvalue of all of them be negative: a file has been rounded."""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Covariance:
    """Covariance of the errors of some coefficients and parameters.

    Raises:
        InputError: the matrix is none, or a name comes twice.
    """

    #: What the m rows are of: "kind.coefficient" of an effect, or a parameter.
    names: tuple[str, ...]
    matrix: np.ndarray  #: (m, m), in the product of both units.
    #: ν of Student's t and of Hotelling's T², at least m: of the flights that it was
    #: estimated from; None for normal errors.
    degrees_of_freedom: float | None = None

    def __post_init__(self):
        """Raises InputError where this is no covariance."""
        names = self.names
        matrix = self.matrix
        count = len(self.names)
        unique = len(set(names)) == count
        expect(unique, "covariance: 'names'", names, "each name once, none twice")
        shape = matrix.shape
        square = (count, count)
        expect(shape == square, "covariance: the matrix's shape", shape, str(square))
        finite = bool(np.all(np.isfinite(matrix)))
        expect(finite, "covariance: 'matrix'", matrix, "finite numbers")
        variances = np.diag(matrix)
        for name, variance in zip(names, variances, strict=True):
            what = f"covariance: the variance of '{name}'"
            expect(variance >= 0.0, what, variance, "a number not negative")
        size = np.sqrt(np.outer(variances, variances))
        for i, j in np.argwhere(np.abs(matrix - matrix.T) > ROUNDING * size)[:1]:
            what = f"covariance: the pair {i + 1}, {j + 1} of 'matrix'"
            pair = [matrix[i, j], matrix[j, i]]
            expect(False, what, pair, "one value in a symmetric matrix")
        # Where a variance is zero, all of its row has to be.
        scaled = matrix / np.where(size > 0.0, size, np.where(matrix == 0.0, 1.0, 1e-9))
        freedom = self.degrees_of_freedom
        what = "covariance: 'degrees_of_freedom'"
        good = freedom is None or count <= freedom < np.inf
        expect(good, what, freedom, f"a finite number, at least {count}")
        least = np.linalg.eigvalsh(scaled).min(initial=0.0)
        what = "covariance: the least eigenvalue of the correlations"
        good = bool(least >= -ROUNDING * max(count, 1))
        expect(good, what, float(least), "none that is negative")

    def among(self, owners: Collection[str]) -> "Covariance":
        """Returns the part of some effects, by kind, and parameters, by name."""
        names = tuple(n for n in self.names if n.partition(".")[0] in owners)
        rows = [self.names.index(name) for name in names]
        matrix = self.matrix[np.ix_(rows, rows)]
        return dataclasses.replace(self, names=names, matrix=matrix)

    @property
    def std(self) -> np.ndarray:
        """Standard errors (m,)."""
        return np.sqrt(np.diag(self.matrix))


def check_names(names: Sequence[str], effects: Sequence[Effect]) -> None:
    """Raises InputError unless all names are of a glider with these effects."""
    known = space_of(tuple(effect.kind for effect in effects)).names
    for name in names:
        expect(name in known, "covariance: a name", name, f"one of {', '.join(known)}")
