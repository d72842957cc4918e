"""Residual curves over the angle of attack: errors of the formulas.

In a fit they are a nuisance with small, shrunken weights: they absorb the residual of a
formula of nearly the right shape, so that no second effect is added for it. Curves that
the simplest formulas can express are excluded: effects come first.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np

from glider.physics.effects import FIELD_TERMS, FIELD_VARIABLES, NO_FIELD, Field
from glider.physics.effects.field import COEFFICIENTS, TAIL_TERM, FieldData, make_field
from glider.sysid.likelihood.linear_flight import LinearFlight
from glider.sysid.replay.record import Record
from glider.sysid.replay.replayed import flow_variables

TERMS = (*COEFFICIENTS, TAIL_TERM)  # That the curves are of, among FIELD_TERMS.
# Prior spread of the weights of each term [-, -, m, -] at a strength of one: a few
# hundredths of a flat plate's largest coefficients (2, 2, 2 · 0.06 m), and a tenth.
STRENGTHS = (0.02, 0.02, 0.0012, 0.1)
COUNT = 12  # Gaussians over the flown angles of attack.


@dataclasses.dataclass(frozen=True, kw_only=True)
class Gaussians:
    """Gaussians over a variable, evenly spread, with a weight for each of some terms.

    Weights (M T,) go by functions first and then by terms.
    """

    variable: str  #: Of FIELD_VARIABLES.
    terms: tuple[str, ...]  #: T of FIELD_TERMS.
    centers: np.ndarray  #: (M,)

    @property
    def width(self) -> float:
        """Standard width of each."""
        return float(self.centers[1] - self.centers[0])

    def functions(self, values: np.ndarray) -> np.ndarray:
        """Returns the Gaussians (n, M) at values of the variable (n,)."""
        return np.exp(-0.5 * ((values[:, None] - self.centers) / self.width) ** 2)

    def field_data(self, weights: np.ndarray) -> FieldData:
        """Returns the field with such weights as a model file has it."""
        by_term = weights.reshape(-1, len(self.terms)).T
        return FieldData(
            kind="unexplained",
            variables=[self.variable],
            centers=self.centers[:, None].tolist(),
            widths=[self.width],
            weights=dict(zip(self.terms, by_term.tolist(), strict=True)),
        )

    def added_to(
        self, flight: LinearFlight, theta: np.ndarray, mix: np.ndarray
    ) -> LinearFlight:
        """Returns a flight with a column for each mixture (M T, q) of weights."""
        functions = self.functions(flight.midpoints(self.variable, theta))
        terms = [FIELD_TERMS.index(name) for name in self.terms]
        return flight.with_forces(functions, terms, mix)


def flown_values(
    records: Sequence[Record], theta: np.ndarray, variable: str
) -> np.ndarray:
    """Returns a variable of FIELD_VARIABLES along all flights of a model."""
    column = FIELD_VARIABLES.index(variable)
    return np.concatenate([flow_variables(r, theta)[:, column] for r in records])


@dataclasses.dataclass(frozen=True, kw_only=True)
class Curves(Gaussians):
    """A basis of curves over alpha."""

    mix: np.ndarray  #: (M T, q) weights of coordinates of a prior spread of one.
    angles: np.ndarray  #: (n,) a sample of the flown angles of attack [rad].

    @property
    def count(self) -> int:
        """Number of coordinates."""
        return self.mix.shape[1]

    def values(self, coordinates: np.ndarray, alpha: np.ndarray) -> np.ndarray:
        """Returns the curves of TERMS at angles of attack, (n, 4)."""
        return self.functions(alpha) @ (self.mix @ coordinates).reshape(-1, len(TERMS))

    def data(self, coordinates: np.ndarray) -> FieldData:
        """Returns the curves as a model file has them."""
        return self.field_data(self.mix @ coordinates)

    def field(self, coordinates: np.ndarray) -> Field:
        """Returns the arrays that the dynamics take."""
        return make_field(self.data(coordinates)) if coordinates.any() else NO_FIELD


def make_curves(records: Sequence[Record], theta: np.ndarray) -> Curves:
    """Spreads a basis over the angles of attack that flights of a model met."""
    alpha = flown_values(records, theta, "alpha")
    low, high = np.percentile(alpha, [1.0, 99.0])
    centers = np.linspace(low, max(high, low + 0.05), COUNT)
    angles = np.sort(alpha)[:: max(1, len(alpha) // 2000)]
    spreads = np.tile(STRENGTHS, COUNT)
    own = Gaussians(variable="alpha", terms=TERMS, centers=centers)
    functions = own.functions(angles)[:, :, None]
    shapes = [np.stack(shape, axis=1)[:, None, :] for shape in _simple_shapes(angles)]
    overlaps = np.array([(functions * s).mean(axis=0).ravel() for s in shapes])
    _, _, rows = np.linalg.svd(overlaps * spreads)
    free = rows[len(overlaps) :].T
    return Curves(**vars(own), mix=spreads[:, None] * free, angles=angles)


def _simple_shapes(alpha: np.ndarray) -> list[tuple[np.ndarray, ...]]:
    """Shapes that the simplest formulas add to TERMS, a tuple of (n,) each."""
    s, c = np.sin(alpha), np.cos(alpha)
    none, one = np.zeros_like(alpha), np.ones_like(alpha)
    return [
        (none, one, none, none),  # Profile drag.
        (c * c, s * c, none, none),  # Camber: C_n = cos alpha.
        (s * c, s * s, none, none),  # The flat plate's lift: mass, area.
        (-s, c, none, none),  # Axial drag.
        (none, none, one, none),  # Pitch moment.
        (none, none, s, none),  # Center of pressure, and
        (none, none, s**3, none),  # its travel.
        (none, none, none, one),  # The elevator's area.
    ]
