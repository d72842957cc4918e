"""What is proven on an interval: its certificate, and the bound of its remainder.

The certificate, in exact arithmetic: at all times the sets are ellipsoids, the servo
follows its command, and V falls on the boundary if |R| <= β; β stands for
β (1 + eᵀ F e) here and in `enclosure`. That R is no larger: boxes that cover the ball
of deviations, the interval and the set of gliders are halved until Taylor models bound
R / β by 1 on each, or there are too many. Where one ball is too wide for all of an
interval, there is one for each half.
"""

import dataclasses
import warnings
from collections.abc import Callable, Iterator
from typing import Any

import joblib
import numpy as np
from threadpoolctl import threadpool_limits

from glider.compiled.taylor import WIDER
from glider.progress import Shares
from glider.verification.dynamics.defect import defect_bounds
from glider.verification.funnel.funnel import Funnel
from glider.verification.proof.enclosure import make_remainder
from glider.verification.proof.interval import (
    Interval,
    acts_elsewhere,
    covers,
    gliders_defect,
    keeps_servo,
    make_interval,
    stays_definite,
    tight_cover,
)
from glider.verification.proof.interval_growth import (
    HALVINGS,
    gram_guesses,
    prove_growth,
)
from glider.verification.sos.exact import exact

_SLACK_SHARE = 0.1
"""Share of the margin of V̇/V that is proven; the rest is left to rounding."""

_BUDGET = 400_000
"""Boxes of one interval until the search gives up; shipped funnels take 90,000."""

_PATIENCE = 150_000
"""Boxes of one ball, after which each half of its time gets a ball of its own. Where R
comes near β, a ball that is 2 % wider than the sets may take any number of boxes."""

_STRETCH = 1.3
"""Factor by which a ball may be wider than the sets along an axis. R grows with its
fourth power, but halves of an interval, which are tighter, take boxes of their own: of
38 intervals with held commands a fifth to a quarter of those with 1.05."""

_FEW = 4
"""Intervals for which it takes longer to start processes."""

_BATCH = 256
"""Boxes that are bounded at once; more are no faster."""

_FAR = 2.0
"""Bound of a box above which it is halved along two axes at once."""

_LEFT = 1.3
"""Power by which an axis' blame falls with its width, where a box was halved."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class IntervalProof:
    """The outcome of a proof on one interval."""

    fault: str = ""  #: Reason why nothing is proven, a clause; empty where all is.
    boxes: int = 0  #: Number of boxes on which the remainder was bounded.
    ratio: float = 0.0  #: Largest |R| / β in the centers of boxes.

    @property
    def proven(self) -> bool:
        """Whether no flight leaves the sets of this interval."""
        return not self.fault


def proven_slack(funnel: Funnel) -> float:
    """Returns the slack of V̇ <= -slack V that is to be proven [1/s]."""
    return _SLACK_SHARE * funnel.settings.margin


def some_intervals(funnel: Funnel, every: int) -> list[int]:
    """Returns the indices of every so many intervals, the first and last included."""
    flows = funnel.nominal.flows.tolist()
    return sorted({*flows[::every], flows[-1]})


def each_interval(
    function: Callable[[Funnel], IntervalProof],
    funnel: Funnel,
    wanted: list[int],
    workers: int,
    progress: Shares,
) -> Iterator[tuple[int, IntervalProof]]:
    """Yields indices of intervals, and what a function of each returns, in order.

    Args:
        function: of funnels of two times.
        funnel: whose intervals they are.
        wanted: indices of the intervals.
        workers: processes, if there are many; as many as there are cores if -1.
        progress: called with the share that is done.
    """
    workers = workers if len(wanted) > _FEW else 1
    tasks = (joblib.delayed(function)(funnel.between(k, k + 1)) for k in wanted)
    found = joblib.Parallel(n_jobs=workers, return_as="generator")(tasks)
    try:
        for number, (k, outcome) in enumerate(zip(wanted, found, strict=True), 1):
            progress(number / len(wanted))
            yield k, outcome
    finally:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # That the rest is not needed any more.
            found.close()


@threadpool_limits.wrap(limits=1, user_api="blas")  # Small matrices.
@np.errstate(all="ignore")  # What is infinite or NaN proves nothing.
def prove_interval(
    piece: Funnel, *, certificate: bool = True, remainder: bool = True
) -> IntervalProof:
    """Tries to prove that no flight leaves a funnel of two times between them.

    Args:
        piece: the funnel.
        certificate: whether to prove that none leaves if |R| <= β.
        remainder: whether to prove that.
    """
    try:
        if remainder and not piece.beta.any():
            return IntervalProof(fault="the certificate accounts for no remainder")
        fault = _certificate_fault(piece) if certificate else ""
        if fault or not remainder:
            return IntervalProof(fault=fault)
        return _prove_remainder(piece, make_interval(piece))
    except (np.linalg.LinAlgError, OverflowError, ValueError):
        # Of what floating point has to propose.
        return IntervalProof(
            fault="a weight is zero, its numbers are too large, or its sets too flat"
        )


def _certificate_fault(piece):
    """Returns what is not proven, a clause; empty where all is."""
    if fault := acts_elsewhere(piece):
        return fault
    interval = make_interval(piece)
    if not stays_definite(interval.S):
        return "a set is not an ellipsoid"
    if not keeps_servo(interval):
        return "the servo would meet its limits"
    slack = _needed_slack(piece, interval)
    if not np.isfinite(slack):
        return "the nominal's defect is not bounded"
    if not prove_growth(interval, exact(slack), gram_guesses(piece, slack)):
        return "V was not proven to fall on the boundary"
    return ""


def _needed_slack(piece: Funnel, interval: Interval) -> float:
    """Returns `proven_slack` and what defects add to V̇/V [1/s].

    They are the nominal's and that of the gliders' centers. They add 2 √(δᵀ |S| δ),
    rounded up, with the largest of Bernstein's coefficients of S.
    """
    delta = defect_bounds(piece.nominal)[0] + gliders_defect(piece)
    largest = np.abs(interval.S.bernstein()).max(axis=0)
    growth = float(2.0 * np.sqrt(delta @ largest @ delta) * WIDER)
    return proven_slack(piece) + growth


def _prove_remainder(
    piece: Funnel, interval: Interval, budget: int = _BUDGET, halvings: int = HALVINGS
) -> IntervalProof:
    """Tries to prove that |R| <= β on the sets of an interval or a part of it."""
    basis, stretch = tight_cover(interval)
    found = _bounded(False, boxes=0, ratio=0.0)
    if stretch <= _STRETCH or not halvings:
        remainder = make_remainder(piece, basis, interval.span)  # It turns the basis.
        if covers(interval, remainder.basis):
            most = min(_PATIENCE, budget) if halvings else budget
            found = bound_remainder(remainder, most)
    if found.proven or not halvings:
        return found
    boxes = found.boxes
    ratio = 0.0
    for half in interval.halves():
        found = _prove_remainder(piece, half, budget - boxes, halvings - 1)
        boxes = boxes + found.boxes
        ratio = max(ratio, found.ratio)
        if not found.proven:
            break
    return _bounded(found.proven, boxes, ratio)


def bound_remainder(remainder: Any, budget: int = _BUDGET) -> IntervalProof:
    """Tries to prove that |R| <= β on all boxes of the ball.

    R is a `TaylorRemainder`, or what has its span, dimension, balls and bounds.
    """
    ratio = 0.0
    boxes = 0
    size = remainder.dimension
    center = np.zeros((size, 1))
    half = np.ones((size, 1))
    first, last = remainder.span
    center[-1], half[-1] = 0.5 * (first + last), 0.5 * (last - first)
    while ratio <= 1.0 and center.shape[1] > 0 and boxes < budget:
        here = center[:, -_BATCH:].copy()
        width = half[:, -_BATCH:].copy()
        center = center[:, :-_BATCH]
        half = half[:, :-_BATCH]
        boxes += here.shape[1]
        bounds, reached, blame = remainder.bounds(here, width)
        ratio = max(ratio, float(np.nan_to_num(reached, nan=0.0).max()))
        bad = ~(bounds <= 1.0)
        split = bad.any(axis=0)
        # Each rate that is not yet bounded has its say in the axis.
        blame = np.where(bad[:, None], blame, 0.0).sum(axis=0)
        here = here[:, split]
        width = width[:, split]
        blame = blame[:, split]
        new, smaller, of = halve(here, width, blame, remainder.balls)
        again = ~(bounds.max(axis=0)[split][of] <= _FAR)
        left = blame[:, of] * (smaller / width[:, of]) ** _LEFT
        newer, smallest, _ = halve(
            new[:, again], smaller[:, again], left[:, again], remainder.balls
        )
        center = np.concatenate([center, new[:, ~again], newer], axis=1)
        half = np.concatenate([half, smaller[:, ~again], smallest], axis=1)
    return _bounded(ratio <= 1.0 and center.shape[1] == 0, boxes, ratio)


def _bounded(proven, boxes, ratio):
    """Returns the outcome for the remainder alone."""
    fault = ""
    if not proven:
        fault = f"the remainder was not bounded on {boxes:,} boxes"
        if ratio > 1.0:
            fault = f"the remainder is {ratio:.4g} times its bound"
    return IntervalProof(fault=fault, boxes=boxes, ratio=ratio)


def halve(center, half, blame, balls=(slice(0, -1),)):
    """Returns both halves of boxes along an axis each, and which box each is a half of.

    Boxes are (m + 1, B), the last coordinate time; the axis is where the blame is
    largest. Balls have the coordinates that are those of a unit ball each. A half
    shrinks to a box about what of it is in all balls; what misses one is left out.
    """
    # Where nothing is known yet, the widest.
    axis = np.where(np.isfinite(blame).all(axis=0), blame, half).argmax(axis=0)
    boxes = np.arange(len(axis))
    step = np.zeros_like(half)
    step[axis, boxes] = 0.5 * half[axis, boxes]
    center = np.concatenate([center - step, center + step], axis=1)
    half = np.tile(half - step, 2)
    low = center - half
    high = center + half
    touches = np.full(len(center[0]), True)
    for ball in balls:
        nearest = np.maximum(np.abs(center[ball]) - half[ball], 0.0) ** 2
        room = 1.0 + 1e-12 - nearest.sum(axis=0)
        touches &= room >= 0.0
        # In the ball w_i² is at most 1 less the least squares of the others.
        reach = np.sqrt(np.maximum(room + nearest, 0.0))
        low[ball] = np.maximum(low[ball], -reach)
        high[ball] = np.minimum(high[ball], reach)
    # A little wider, so that rounding leaves no gap between them.
    center = 0.5 * (low + high)
    half = 0.5 * (high - low) + 1e-15
    return center[:, touches], half[:, touches], np.tile(boxes, 2)[touches]
