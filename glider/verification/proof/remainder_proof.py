"""The proof that the Taylor remainder is no larger than a funnel bears.

The ball of deviations is covered with boxes; on each, Taylor models enclose R. A box on
which the bound is too large is halved, until all are good or there are too many.
"""

import dataclasses
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from threadpoolctl import threadpool_limits

from glider.verification.dynamics.error_dynamics import expand
from glider.verification.dynamics.nominal import Nominal
from glider.verification.funnel.funnel import Funnel
from glider.verification.proof.boxes import RADIUS
from glider.verification.proof.enclosure import make_remainder

BUDGET = 400_000
"""Boxes at one time until the search gives up; the shipped funnels take 30,000."""

BATCH = 256
"""Boxes that are bounded at once; more do not fit the cache."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class TimeProof:
    """The outcome of a proof at one time."""

    proven: bool
    """Whether |R_k| <= β_k on the whole set."""

    boxes: int
    """Number of boxes that were bounded."""

    ratio: float
    """Largest |R_k| / β_k that was seen; above 1 there is nothing to prove."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class RemainderProof:
    """The outcome of the proof of a funnel's remainder."""

    times: np.ndarray
    """Times (N,) that were tried [s]."""

    at_times: tuple[TimeProof, ...]
    """Outcome at each time."""

    @property
    def until(self) -> float | None:
        """Last time before which nothing is left unproven; None for no time [s]."""
        last = None
        for time, proof in zip(self.times, self.at_times, strict=True):
            if not proof.proven:
                break
            last = float(time)
        return last

    @property
    def complete(self) -> bool:
        """Whether it is proven at all times that were tried."""
        return all(proof.proven for proof in self.at_times)

    @property
    def boxes(self) -> int:
        """Number of boxes at all times."""
        return sum(proof.boxes for proof in self.at_times)


def remainder_status(funnel: Funnel, proof: RemainderProof | None = None) -> str:
    """Returns how a funnel's remainder is known.

    "none" where it bears none, else "sampled", or with a proof of it "rigorous until
    t=0.8795", the last time before which nothing that was tried is left unproven, and
    "at 3 of 201 times" if these were not all.
    """
    if not funnel.beta.any():
        return "none"
    if proof is None or proof.until is None:
        return "sampled"
    status, count = f"rigorous until t={proof.until:.4f}", len(funnel.nominal.times)
    tried = len(proof.times)
    return status if tried == count else f"{status} at {tried} of {count} times"


def describe_proof(funnel: Funnel, proof: RemainderProof) -> str:
    """Returns a sentence about a proof."""
    if not funnel.beta.any():
        return "The certificate bears no remainder: it is of the polynomials alone."
    if proof.complete:
        return (
            f"The remainder is proven: at {len(proof.times)} of "
            f"{len(funnel.nominal.times)} times it is no larger than the certificate "
            f"bears, on {proof.boxes:,} boxes."
        )
    count = sum(one.proven for one in proof.at_times)
    largest = np.max([one.ratio for one in proof.at_times])
    until = "at no time" if proof.until is None else f"until {proof.until:.4f} s"
    words = (
        f"The remainder is proven {until}, and at {count} of the {len(proof.times)} "
        f"times that were tried, of {len(funnel.nominal.times)}"
    )
    if not np.isfinite(largest):
        return f"{words}; at some, the certificate bears none."
    return f"{words}; up to {largest:.2f} times what it bears was seen."


@threadpool_limits.wrap(limits=1, user_api="blas")  # Small matrices.
def prove_remainder(
    funnel: Funnel,
    every: int = 1,
    budget: int = BUDGET,
    progress: Callable[[float], None] | None = None,
) -> RemainderProof:
    """Tries to prove that the remainder is within the funnel's β at its times.

    Args:
        funnel: the funnel.
        every: look at every so many times only, the first and last included.
        budget: boxes at one time, until the search gives up.
        progress: called with the share that is done.
    """
    nominal, coefficients = funnel.nominal, expand(funnel.nominal)
    at = funnel.some_times(every)

    def prove(k):
        return prove_at(nominal, k, coefficients, funnel.S[k], funnel.beta[k], budget)

    proofs = []
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for proof in pool.map(prove, at):
            proofs.append(proof)
            if progress:
                progress(len(proofs) / len(at))
    return RemainderProof(times=nominal.times[at], at_times=tuple(proofs))


def prove_at(
    nominal: Nominal,
    at: int,
    coefficients: np.ndarray,
    S: np.ndarray,
    beta: np.ndarray,
    budget: int = BUDGET,
) -> TimeProof:
    """Tries to prove that |R_k| <= β_k over {eᵀ S e <= 1} at one time.

    Args:
        nominal: the flight.
        at: index of the time.
        coefficients: (T, n, M) of `expand`.
        S: (n, n) of the set.
        beta: (n,) β.
        budget: boxes, until the search gives up.
    """
    remainder = make_remainder(nominal, at, coefficients, S)
    limits = beta[remainder.rows, None]
    with np.errstate(divide="ignore"):
        ratio = float((remainder.largest / limits[:, 0]).max(initial=0.0))
    m = remainder.basis.shape[1]
    center, half = np.zeros((m, 1)), np.full((m, 1), RADIUS)
    boxes = 0
    while ratio <= 1.0 and center.shape[1] > 0 and boxes < budget:
        here, size = center[:, -BATCH:], half[:, -BATCH:]
        center, half = center[:, :-BATCH], half[:, :-BATCH]
        boxes += here.shape[1]
        bounds, reached, blame = remainder.bounds(here, size)
        ratio = max(ratio, float(np.nan_to_num(reached / limits, nan=0.0).max()))
        bad = ~(bounds <= limits)
        split = bad.any(axis=0)
        # Each rate that is not yet bounded has its say in the axis.
        blame = np.where(bad[:, None], blame / limits[:, None], 0.0).sum(axis=0)
        halves = halve(here[:, split], size[:, split], blame[:, split])
        center = np.concatenate([center, halves[0]], axis=1)
        half = np.concatenate([half, halves[1]], axis=1)
    proven = ratio <= 1.0 and center.shape[1] == 0
    return TimeProof(proven=proven, boxes=boxes, ratio=ratio)


def halve(center, half, blame):
    """Returns both halves of boxes along an axis each, without what misses the ball.

    Args:
        center: (m, B) of the boxes.
        half: (m, B) their half-widths.
        blame: (m, B); the axis is where it is largest.

    Returns:
        centers and half-widths, (m, up to 2 B) each.
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
    nearest = np.maximum(np.abs(center) - half, 0.0)
    touches = np.sum(nearest**2, axis=0) <= RADIUS**2 * (1.0 + 1e-12)
    return center[:, touches], half[:, touches]
