"""The gliders that the data allow: a confidence set of a model's numbers.

Where the estimates' errors are normal of covariance C, with C = A₁ A₁ᵀ of rank r,
estimated with ν degrees of freedom:

- the ellipsoid {δ = √q A₁ w : |w| <= 1}, q the quantile of Hotelling's T² of r numbers
  (of χ² where C is known), holds the true numbers with the level's probability;
- the box |δ_i| <= √q' σ_i, q' the same of one number (Student's t, squared) at the r-th
  root of the level, holds them at least as often, whatever the correlations
  (Šidák 1967).

Both are convex.
"""

import dataclasses
import functools
import math
from collections.abc import Iterable
from typing import Any

import numpy as np
from scipy.special import chdtri, fdtri  # scipy.stats takes 0.4 s to import.

from glider.errors import expect
from glider.physics.chain import theta_of
from glider.physics.covariance import Covariance
from glider.physics.model import GliderModel
from glider.physics.parameter_space import ParameterSpace, space_of
from glider.physics.parameters import PARAMETER_NAMES, Theta


def physical(
    model: GliderModel, names: tuple[str, ...], deviations: np.ndarray
) -> np.ndarray:
    """Returns deviations (..., m), shortened to where all numbers are physical.

    All numbers of a deviation to a mass below zero, or to a coefficient beyond its
    bounds, shrink by the same share: so it stays in a convex set about the estimate.
    To draw gliders instead, see `glider_at`.
    """
    places = model.space.places(names)
    estimates = model.vector[places]
    lower, upper = _bounds(model.space, places, estimates)
    margin = np.where(deviations > 0.0, upper - estimates, lower - estimates)
    share = np.divide(
        margin, deviations, out=np.ones_like(deviations), where=deviations != 0.0
    )
    share = share.min(axis=-1, keepdims=True, initial=1.0)
    return deviations * np.where(share < 1.0, share * (1.0 - _INSIDE), 1.0)


def _bounds(
    space: ParameterSpace, places: list[int], estimates: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Returns the bounds (m,) of numbers; an estimate beyond one may stay."""
    lower = np.minimum(space.lower[places], estimates)
    upper = np.maximum(space.upper[places], estimates)
    return lower, upper


def theta_at(
    model: GliderModel, names: tuple[str, ...], deviations: Iterable[Any]
) -> Theta:
    """Returns the numbers of gliders that deviate from a model by m numbers or arrays.

    The numbers that do not deviate stay floats.
    """
    numbers = model.vector.tolist()
    for place, deviation in zip(model.space.places(names), deviations, strict=True):
        numbers[place] = numbers[place] + deviation
    return theta_of(numbers, model.gaussians)


def glider_at(
    model: GliderModel, names: tuple[str, ...], deviation: np.ndarray
) -> GliderModel:
    """Returns a glider that deviates from a model.

    Args:
        model: of the estimates.
        names: of the m numbers that deviate.
        deviation: (m,) of each.

    Raises:
        InputError: it is not physical.
    """
    # Effects that do nothing too: model.space omits them.
    space = space_of(tuple(effect.kind for effect in model.effects))
    vector = space.pack(model.parameters, model.effects)
    places = space.places(names)
    vector[places] += np.reshape(deviation, len(places))
    parameters, effects = space.unpack(vector, model.parameters)
    return dataclasses.replace(model, parameters=parameters, effects=effects)


_INSIDE = 1e-9
"""Share by which a number stays within its bounds, for rounding."""


LEVEL = 0.95
"""Default probability with which a set holds the true numbers."""

_FLAT = 1e-12
"""Eigenvalue of the correlations below which a direction is known exactly."""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class ConfidenceSet:
    """An ellipsoid of deviations δ of a glider's numbers from their estimates."""

    covariance: Covariance  #: Covariance of the m numbers that may deviate.
    level: float = LEVEL  #: Probability with which the true numbers are in it.

    def __post_init__(self):
        """Raises InputError where there is no such set."""
        level = self.level
        is_number = isinstance(level, (int, float)) and not isinstance(level, bool)
        good = is_number and 0.0 < level < 1.0
        expect(good, "The confidence", level, "a probability between 0 and 1")

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the m numbers."""
        return self.covariance.names

    @functools.cached_property
    def factor(self) -> np.ndarray:
        """A (m, r) of δ = A w, w in the unit ball."""
        matrix = self.covariance.matrix
        std = self.covariance.std
        # Of the correlations: the axes should not depend on the units.
        scale = np.where(std > 0.0, std, 1.0)
        values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
        kept = values > _FLAT
        radius = self._radius(max(int(kept.sum()), 1))
        return radius * scale[:, None] * vectors[:, kept] * np.sqrt(values[kept])

    def _radius(self, count: int) -> float:
        """Root of the quantile of Hotelling's T² of so many numbers, or of χ²."""
        freedom = self.covariance.degrees_of_freedom
        if freedom is None:
            return math.sqrt(chdtri(count, 1.0 - self.level))
        rest = freedom - count + 1.0
        return math.sqrt(count * freedom / rest * fdtri(count, rest, self.level))

    @property
    def dimension(self) -> int:
        """Number r of its dimensions; 0 where all is known."""
        return self.factor.shape[1]

    def on_boundary(self, directions: np.ndarray) -> np.ndarray:
        """Returns δ (..., m) on the boundary, towards directions (..., r) of w."""
        size = np.linalg.norm(directions, axis=-1, keepdims=True)
        return (directions / np.maximum(size, 1e-300)) @ self.factor.T

    def reach(self, directions: np.ndarray) -> np.ndarray:
        """Returns max aᵀ δ over the set (...) for directions a (..., m)."""
        return np.linalg.norm(directions @ self.factor, axis=-1)

    def farthest(self, matrix: np.ndarray) -> float:
        """Returns a bound of |B w| over all w, for a matrix B (k, r)."""
        return float(np.linalg.norm(matrix, 2)) if matrix.size else 0.0

    def holds(self, deviations: np.ndarray) -> np.ndarray:
        """Returns whether deviations (..., m) are in the set, but for rounding."""
        w = deviations @ np.linalg.pinv(self.factor).T
        widths = self.reach(np.eye(len(self.names)))
        off = np.abs(w @ self.factor.T - deviations)
        in_span = np.all(off <= 1e-9 * widths, axis=-1)
        inside = np.linalg.norm(w, axis=-1) <= 1.0 + 1e-9
        return in_span & inside

    def is_same(self, other: "ConfidenceSet") -> bool:
        """Determines whether another set is this one, to the last digit."""
        same = self.names == other.names
        return same and np.array_equal(self.factor, other.factor)

    def covers(self, other: "ConfidenceSet") -> bool:
        """Determines whether it contains another, but for rounding.

        A number that it does not name may not deviate in the other.
        """
        places = {name: row for row, name in enumerate(self.names)}
        theirs = np.zeros((len(self.names), other.dimension))
        for name, row in zip(other.names, other.factor, strict=True):
            if name in places:
                theirs[places[name]] = row
            elif row.any():
                return False
        own = np.linalg.norm(self.factor, axis=1)
        others = np.linalg.norm(theirs, axis=1)
        size = np.maximum(own, others)
        size = np.where(size > 0.0, size, 1.0)[:, None]
        mine = self.factor / size
        theirs = theirs / size
        left = mine @ mine.T - theirs @ theirs.T
        return bool(np.linalg.eigvalsh(left).min(initial=0.0) >= -1e-9)


ALONE = ConfidenceSet(covariance=Covariance(names=(), matrix=np.zeros((0, 0))))
"""The set of one glider, of which nothing deviates."""


def make_confidence(
    model: GliderModel, covariance: Covariance, level: float = LEVEL
) -> ConfidenceSet:
    """Returns the confidence set of all numbers that a glider's flight depends on."""
    # A fault of sensor or log changes only what is measured.
    flown = {
        name
        for name, kind in model.space.kinds.items()
        if kind.stage not in ("sensor", "log")
    }
    among = covariance.among({*PARAMETER_NAMES, *flown})
    return ConfidenceSet(covariance=among, level=level)


def describe_set(confidence: ConfidenceSet) -> str:
    """Returns a set in a few words: "95 % ellipsoid of wind.x ± 0.001"."""
    widths = confidence.reach(np.eye(len(confidence.names)))
    within = ", ".join(
        f"{name} ± {width:.2g}"
        for name, width in zip(confidence.names, widths, strict=True)
        if width > 0.0
    )
    level = describe_level(confidence.level)
    return f"{level} ellipsoid of {within or 'nothing'}"


def describe_level(level: float) -> str:
    """Returns a probability in percent: "95 %"."""
    percent = f"{100.0 * level:g}"
    return f"{'over 99.999' if percent == '100' else percent} %"
