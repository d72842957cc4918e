"""The gliders of a set between two times of a funnel: their centers, as polynomials.

With δ = A v, the set is in |v_l| <= 1, and for an ellipsoid in |v| <= 1. The center is
x₀ + X A v, X the cubic Hermite polynomial between the times, and the command there
differs by -K X A v. Time is s from -1 to 1.
"""

import dataclasses

import numpy as np

from glider.verification.dynamics.nominal import nonlinear_parts
from glider.verification.dynamics.taylor_models import ROUNDING, WIDER
from glider.verification.funnel.funnel import Funnel
from glider.verification.sos.exact import Exact, InTime, exact, hermite


@dataclasses.dataclass(frozen=True, kw_only=True)
class GlidersPath:
    """Where the gliders of a set fly in an interval, in powers of s, lowest first.

    Attributes:
        names: names of the numbers that deviate.
        factor: matrix A (m, r).
        is_round: whether the set is in the unit ball of v, not only in its cube.
        inputs: x A of the states, and -K X A of the command, (n + 1, r, 5).
        slopes: ẋ A (n, r, 3) [1/s].
    """

    names: tuple[str, ...]
    factor: np.ndarray
    is_round: bool
    inputs: np.ndarray
    slopes: np.ndarray

    @property
    def dimension(self) -> int:
        """Number r of the set's dimensions."""
        return self.factor.shape[1]


def gliders_path(piece: Funnel) -> GlidersPath | None:
    """Returns the path of a funnel of two times; None where it is of one glider."""
    if piece.gliders is None:
        return None
    allowed, nominal = piece.gliders.confidence, piece.nominal
    half = 0.5 * (nominal.times[1] - nominal.times[0])
    (a, b), (da, db) = (
        ends @ allowed.factor for ends in (piece.gliders.shifts, piece.gliders.slopes)
    )
    da, db = half * da, half * db
    powers = [
        0.5 * (a + b) + 0.25 * (da - db),
        0.75 * (b - a) - 0.25 * (da + db),
        0.25 * (db - da),
        0.25 * (a - b + da + db),
    ]
    states = np.stack([*powers, np.zeros_like(a)], axis=-1)
    first, last = nominal.gains
    command = -np.einsum("i,irk->rk", 0.5 * (first + last), states)
    command[:, 1:] -= np.einsum("i,irk->rk", 0.5 * (last - first), states[..., :-1])
    return GlidersPath(
        names=allowed.names,
        factor=allowed.factor,
        is_round=allowed.shape == "ellipsoid",
        inputs=np.concatenate([states, command[None]]),
        slopes=states[..., 1:4] * [1.0, 2.0, 3.0] / half,
    )


def servo_reach(piece: Funnel, a: InTime, step: Exact) -> float:
    """Returns a bound of aᵀ X δ over the set and the interval, rounded up."""
    if piece.gliders is None:
        return 0.0
    allowed = piece.gliders.confidence
    X, _ = hermite(piece.gliders.shifts, piece.gliders.slopes, step)
    along = a @ X @ exact(allowed.factor)
    sizes = np.abs(along.bernstein()).max(axis=0)
    norm = np.linalg.norm(sizes) if allowed.shape == "ellipsoid" else sizes.sum()
    return float(norm * WIDER)


def gliders_defect(piece: Funnel) -> np.ndarray:
    """Returns bounds δ (n,) of what X δ lacks to be a flight, in the rates.

    It is zero for the rates that are not linear, which have it in R.
    """
    n = piece.num_states
    path, found = gliders_path(piece), np.zeros(n)
    if path is None:
        return found
    _, rows = nonlinear_parts(piece.nominal.model)
    jacobian = piece.nominal.open_loop[0][:, 1 : n + 2]
    wanted = np.einsum("ij,jrk->irk", jacobian, path.inputs)
    wanted[..., :3] -= path.slopes
    sizes = np.einsum("ij,jrk->ir", np.abs(jacobian), np.abs(path.inputs))
    sizes += np.abs(path.slopes).sum(axis=2)
    found = np.abs(wanted).sum(axis=(1, 2)) + ROUNDING * sizes.sum(axis=1)
    found[rows] = 0.0
    return found * WIDER


def unproven_numbers(piece: Funnel) -> bool:
    """Determines whether an otherwise linear rate depends on a number that deviates."""
    if piece.gliders is None:
        return False
    model = piece.nominal.model
    names = piece.gliders.confidence.names
    return nonlinear_parts(model, names)[1] != nonlinear_parts(model)[1]
