"""Any figure of merit with the uncertainty of a traced glider.

perched = propagate(result, lambda model: fly(model, policy, starts).perched.mean())
print(f"{perched.mean:.2f} ± {perched.std:.2f}")
"""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from glider.errors import expect
from glider.physics.confidence import glider_at
from glider.physics.model import GliderModel
from glider.sysid.result import Alternative, Result

LEVELS = 0.025, 0.5, 0.975
"""Probabilities of the quantiles by default: the median, and a 95 % interval."""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Propagated:
    """A figure of merit over the gliders that the flights allow."""

    estimate: float  #: Of the corrected model.
    values: np.ndarray  #: (draws,) of drawn gliders.
    places: np.ndarray  #: (draws,) each one's place in `Result.alternatives`.

    @property
    def mean(self) -> float:
        """Mean over the gliders."""
        return float(np.mean(self.values))

    @property
    def std(self) -> float:
        """Standard deviation over the gliders."""
        return float(np.std(self.values, ddof=1))

    def quantiles(self, levels: Sequence[float] = LEVELS) -> np.ndarray:
        """Returns the values that so large a share of the gliders stays below."""
        return np.quantile(self.values, levels)


def propagate(
    result: Result,
    metric: Callable[[GliderModel], float],
    *,
    draws: int = 200,
    seed: int = 0,
) -> Propagated:
    """Carries the uncertainty of a result into a figure of merit.

    Gliders are drawn from `Result.alternatives`: a set of effects by its probability,
    then its coefficients and the unknown parameters of the vehicle by their covariance
    and Student's t. A number that would not be physical is set to its bound; the
    others do not change.

    Args:
        result: of `close_the_loop`.
        metric: of a glider; called once for each draw.
        draws: number of gliders.
        seed: of the draws; same seed, same gliders.

    Raises:
        InputError: fewer than two draws.
    """
    expect(draws >= 2, "the number of draws", draws, "at least 2")
    rng = np.random.default_rng(seed)
    alternatives = result.alternatives
    chances = [alternative.probability for alternative in alternatives]
    places = rng.choice(len(alternatives), size=draws, p=chances)
    gliders = (_drawn(alternatives[place], rng) for place in places)
    return Propagated(
        estimate=metric(result.model),
        values=np.array([metric(glider) for glider in gliders], dtype=float),
        places=places,
    )


def _drawn(alternative: Alternative, rng: np.random.Generator) -> GliderModel:
    """A glider of other numbers, as probable as they are."""
    model = alternative.model
    known = alternative.covariance
    if known is None:
        return model
    none = np.zeros(len(known.names))
    change = rng.multivariate_normal(none, known.matrix, method="eigh")
    if (freedom := known.degrees_of_freedom) is not None:
        change *= np.sqrt(freedom / rng.chisquare(freedom))
    return glider_at(model, known.names, change, truncate=True)
