"""The proof that the Taylor remainder is within the bounds of a funnel.

The ball of deviations, times an interval of time and the set of gliders, is covered
with boxes; on each, Taylor models enclose R / β. A box on which the bound is above 1 is
halved, until all are good or there are too many. The ball has to cover the sets of all
of an interval; where it is too wide for that, there is one for each half.
"""

import dataclasses

import numpy as np

from glider.verification.funnel.funnel import Funnel
from glider.verification.proof.enclosure import TaylorRemainder, make_remainder
from glider.verification.proof.interval import Interval, covers, tight_cover

BUDGET = 400_000
"""Boxes of one interval until the search gives up; the shipped funnels take 30,000."""

HALVINGS = 4
"""Times that an interval is halved for a ball that is tight enough."""

PATIENCE = 40_000
"""Boxes that a ball gets, until each half of its time gets its own. Where R
comes near β, a ball that is 2 % wider than the sets may take any number of boxes."""

STRETCH = 1.05
"""Share by which a ball may be wider than the sets along an axis: R grows with its
fourth power."""

HOPELESS = 1.3
"""Largest |R| / β that was seen, from which no tighter ball is tried."""

BATCH = 256
"""Boxes that are bounded at once; more do not fit the cache."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class RemainderProof:
    """The outcome of a proof on one interval.

    Attributes:
        proven: whether |R| <= β on all of its sets.
        boxes: number of boxes that were bounded.
        ratio: largest |R| / β that was seen; above 1 there is nothing to prove.
    """

    proven: bool
    boxes: int
    ratio: float


def prove_remainder(
    piece: Funnel,
    interval: Interval,
    budget: int = BUDGET,
    span: tuple[float, float] = (-1.0, 1.0),
    halvings: int = HALVINGS,
) -> RemainderProof:
    """Tries to prove that |R| <= β on the sets of a funnel of two times.

    Args:
        budget: boxes, until the search gives up.
        span: first and last s of the part, of -1 to 1.
    """
    basis, stretch = tight_cover(interval)
    found = RemainderProof(proven=False, boxes=0, ratio=np.inf)
    if (stretch <= STRETCH or not halvings) and covers(interval, basis):
        most = min(PATIENCE, budget) if halvings else budget
        found = bound_remainder(make_remainder(piece, basis, span), most)
        halvings = halvings if found.ratio <= HOPELESS else 0
    if found.proven or not halvings:
        return found
    boxes, ratio = found.boxes, 0.0
    middle = 0.5 * sum(span)
    spans = (span[0], middle), (middle, span[1])
    for half, part in zip(interval.halves(), spans, strict=True):
        found = prove_remainder(piece, half, budget - boxes, part, halvings - 1)
        boxes, ratio = boxes + found.boxes, max(ratio, found.ratio)
        if not found.proven:
            break
    return RemainderProof(proven=found.proven, boxes=boxes, ratio=ratio)


def bound_remainder(remainder: TaylorRemainder, budget: int = BUDGET) -> RemainderProof:
    """Tries to prove that |R| <= β on all boxes of the ball.

    Args:
        budget: boxes, until the search gives up.
    """
    ratio, boxes = float(remainder.seen.max(initial=0.0)), 0
    size = remainder.dimension
    center, half = np.zeros((size, 1)), np.ones((size, 1))
    first, last = remainder.span
    center[-1], half[-1] = 0.5 * (first + last), 0.5 * (last - first)
    while ratio <= 1.0 and center.shape[1] > 0 and boxes < budget:
        here, width = center[:, -BATCH:], half[:, -BATCH:]
        center, half = center[:, :-BATCH], half[:, :-BATCH]
        boxes += here.shape[1]
        bounds, reached, blame = remainder.bounds(here, width)
        ratio = max(ratio, float(np.nan_to_num(reached, nan=0.0).max()))
        bad = ~(bounds <= 1.0)
        split = bad.any(axis=0)
        # Each rate that is not yet bounded has its say in the axis.
        blame = np.where(bad[:, None], blame, 0.0).sum(axis=0)
        halves = halve(
            here[:, split], width[:, split], blame[:, split], remainder.balls
        )
        center = np.concatenate([center, halves[0]], axis=1)
        half = np.concatenate([half, halves[1]], axis=1)
    proven = ratio <= 1.0 and center.shape[1] == 0
    return RemainderProof(proven=proven, boxes=boxes, ratio=ratio)


def halve(center, half, blame, balls=(slice(0, -1),)):
    """Returns both halves of boxes along an axis each, without what misses the ball.

    Args:
        center: (m + 1, B) of the boxes; the last coordinate is time.
        blame: (m + 1, B); the axis is where it is largest.
        balls: which coordinates are those of a unit ball, for each ball.

    Returns:
        centers and half-widths, (m + 1, up to 2 B) each.
    """
    # Where nothing is known yet, the widest.
    axis = np.where(np.isfinite(blame).all(axis=0), blame, half).argmax(axis=0)
    boxes = np.arange(len(axis))
    half = half.copy()
    half[axis, boxes] *= 0.5
    step = np.zeros_like(half)
    step[axis, boxes] = half[axis, boxes]
    # A little wider, so that rounding leaves no gap between them.
    half[axis, boxes] += 1e-15
    center = np.concatenate([center - step, center + step], axis=1)
    half = np.concatenate([half, half], axis=1)
    nearest = np.maximum(np.abs(center) - half, 0.0) ** 2
    squares = np.array([nearest[ball].sum(axis=0) for ball in balls])
    touches = np.all(squares <= 1.0 + 1e-12, axis=0)
    return center[:, touches], half[:, touches]
