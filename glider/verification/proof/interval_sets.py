"""The sets of an interval: within the servo's limits, and within a ball; exactly."""

from fractions import Fraction

import numpy as np

from glider.verification.proof.interval import Interval
from glider.verification.sos.exact import Exact, exact, is_positive_definite
from glider.verification.sos.exact_time import InTime

HALVINGS = 3
"""Times that an interval is halved where a form is not seen to be definite."""

COVER_ROOM = 1e-4
"""Share by which a ball is larger than it need be, for what was not sampled."""

FLOOR = 0.05
"""Share of each variable's spread that is added to the sets before they are covered:
where they are flatter they may be covered loosely, but that must not tilt the ball."""

COVER_SAMPLES = 9
"""Times of an interval that the ball is made for."""


def stays_definite(matrix: InTime, halvings: int = HALVINGS) -> bool:
    """Returns whether a symmetric matrix is positive definite throughout, for sure."""
    if all(map(is_positive_definite, matrix.parts)):
        return True
    if not (halvings and is_positive_definite(matrix.parts[0])):
        return False
    return all(stays_definite(half, halvings - 1) for half in matrix.halves())


def keeps_servo(interval: Interval) -> bool:
    """Returns whether the sets keep the servo within its limits, for sure.

    aᵀ e < b on the ellipsoid where b > 0 and b² S - a aᵀ is positive definite.
    """
    for a, b in interval.limits:
        left = b * b * interval.S - a[:, None] @ a[None]
        if not (stays_definite(b[None, None]) and stays_definite(left)):
            return False
    return True


def covers(interval: Interval, basis: np.ndarray) -> bool:
    """Returns whether all y of the sets are basis w with |w| <= 1, for sure.

    So it is where C S⁻¹ Cᵀ < basis basisᵀ, and so where the matrix
        S   Cᵀ
        C   basis basisᵀ
    is positive definite.
    """
    B, degree = exact(basis), interval.S.degree
    blocks = interval.S, interval.outputs[interval.which], InTime((B @ B.T,))
    parts = zip(*(block.raised(degree).parts for block in blocks), strict=True)
    return stays_definite(InTime(tuple(_joined(*part) for part in parts)))


def tight_cover(interval: Interval) -> tuple[np.ndarray, float]:
    """Returns a basis whose ball should cover the sets tightly, and its stretch.

    That is how much wider it is than the set in the middle, along some axis.
    """
    shadows = []
    for k in range(COVER_SAMPLES):
        share = Fraction(k, COVER_SAMPLES - 1)
        S = interval.S.at(share).to_float()
        C = interval.outputs.at(share).to_float()[interval.which]
        shadows.append(C @ np.linalg.solve(S, C.T))
    middle = np.diagonal(shadows[COVER_SAMPLES // 2])
    turned = np.array(shadows) + FLOOR**2 * np.diag(middle)
    # The least that holds two ellipsoids, nearly: their mean and half their difference.
    L = np.linalg.cholesky(0.5 * (turned[0] + turned[-1]))
    L_inv = np.linalg.inv(L)
    turned = L_inv @ turned @ L_inv.T
    values, vectors = np.linalg.eigh(0.5 * (turned[-1] - turned[0]))
    cover = np.eye(len(L)) + (vectors * np.abs(values)) @ vectors.T
    more = max(np.linalg.eigvalsh(one - cover)[-1] for one in turned)
    values, vectors = np.linalg.eigh(cover)
    wider = np.sqrt(values + max(more, 0.0) + COVER_ROOM)
    basis = L @ (vectors * wider) @ vectors.T
    return basis, float(np.sqrt(np.max(np.sum(basis**2, axis=1) / middle)))


def _joined(S, C, ball):
    low = min(S.exponent, C.exponent, ball.exponent)
    rows = [[S.at(low), C.at(low).T], [C.at(low), ball.at(low)]]
    return Exact(np.block(rows), low)
