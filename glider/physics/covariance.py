"""How well the numbers of a model are known: the covariance of their errors.

It is knowledge about a glider and does not change how it flies, so that a model's file
has it beside the model.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np

from glider.errors import InputError
from glider.physics.effects.effect import Effect, EffectKind
from glider.physics.parameters import PARAMETER_NAMES

ROUNDING = 1e-9
"""Amount by which correlations may differ from their mirror images, and the least
eigenvalue of all of them be negative: a file has been rounded."""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Covariance:
    """Covariance of the errors of some coefficients and parameters.

    Raises:
        InputError: the matrix is none, or a name comes twice.
    """

    names: tuple[str, ...]
    """What the m rows are of: "kind.coefficient" of an effect, or a parameter."""

    matrix: np.ndarray
    """(m, m), in the product of both units."""

    def __post_init__(self):
        """Raises InputError where this is no covariance."""
        count, matrix = len(self.names), self.matrix
        twice = [name for name in self.names if self.names.count(name) > 1]
        if twice:
            raise InputError(f"covariance: '{twice[0]}' is in 'names' twice.")
        if matrix.shape != (count, count):
            raise InputError(
                f"covariance: 'matrix' has shape {matrix.shape}; {(count, count)}, a "
                "row for each of 'names', is needed."
            )
        if not np.all(np.isfinite(matrix)):
            raise InputError(
                f"covariance: 'matrix' has {matrix[~np.isfinite(matrix)][0]}; finite "
                "numbers are needed."
            )
        variances = np.diag(matrix)
        if np.any(variances < 0.0):
            worst = int(np.argmin(variances))
            raise InputError(
                f"covariance: the variance of '{self.names[worst]}' is "
                f"{variances[worst]:.3g}; a number not negative is needed."
            )
        size = np.sqrt(np.outer(variances, variances))
        skew = np.abs(matrix - matrix.T) - ROUNDING * size
        if np.any(skew > 0.0):
            i, j = np.unravel_index(np.argmax(skew), skew.shape)
            raise InputError(
                f"covariance: 'matrix' has {matrix[i, j]:.3g} in row {i + 1} and "
                f"column {j + 1} and {matrix[j, i]:.3g} in its mirror image; a "
                "symmetric matrix is needed."
            )
        # Where a variance is zero, all of its row has to be.
        scaled = matrix / np.where(size > 0.0, size, np.where(matrix == 0.0, 1.0, 1e-9))
        least = np.linalg.eigvalsh(scaled).min(initial=0.0)
        if least < -ROUNDING * max(count, 1):
            raise InputError(
                "covariance: the correlations in 'matrix' have the eigenvalue "
                f"{least:.3g}; none that is negative is needed."
            )

    def part(self, names: Sequence[str]) -> "Covariance":
        """Returns the covariance of some of the names, in their order."""
        rows = [self.names.index(name) for name in names]
        return Covariance(
            names=tuple(names), matrix=self.matrix[np.ix_(rows, rows)].copy()
        )

    def of_flight(self, kinds: Sequence[EffectKind]) -> "Covariance":
        """Returns the part of it that the flight of a glider depends on.

        A fault of sensor or log changes what is measured, not how the glider flies.

        Args:
            kinds: of its effects that act.
        """
        flown = {e.kind for e in kinds if e.stage not in ("sensor", "log")}
        flown |= set(PARAMETER_NAMES)
        return self.part([n for n in self.names if n.partition(".")[0] in flown])


def known_names(effects: Sequence[Effect]) -> tuple[str, ...]:
    """Returns the names of all numbers of a glider with these effects."""
    coefficients = (
        f"{e.kind.kind}.{c.name}" for e in effects for c in e.kind.coefficients
    )
    return (*PARAMETER_NAMES, *coefficients)


def covariance_of_rows(
    names: Sequence[str], rows: Sequence[Sequence[float]]
) -> Covariance:
    """Returns the covariance that rows of numbers are.

    Raises:
        InputError: they are none; their lengths may differ.
    """
    count, lengths = len(names), [len(row) for row in rows]
    if lengths != [count] * count:
        raise InputError(
            f"covariance: 'matrix' has rows of {', '.join(map(str, lengths)) or 'no'} "
            f"numbers; {count} rows of {count}, one for each of 'names', are needed."
        )
    matrix = np.array(rows, dtype=float).reshape(count, count)
    return Covariance(names=tuple(names), matrix=matrix)


def check_names(names: Sequence[str], effects: Sequence[Effect]) -> None:
    """Raises InputError unless all names are of a glider with these effects."""
    known = known_names(effects)
    for name in names:
        if name not in known:
            raise InputError(
                f"covariance: 'names' has '{name}', which the model has not; it has "
                f"{', '.join(known)}."
            )
