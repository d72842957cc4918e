"""The proof that every flight that starts in a funnel stays there.

Intervals are proven in several processes. What is proven can be kept in a record
(`glider.files.record`), from which an interrupted proof continues. Its header has the
hashes of the funnel and of the program that proves it.
"""

import dataclasses
import functools
import hashlib
import math
import sys
import warnings
from pathlib import Path

import flint
import joblib
import numba
import numpy as np
import scipy

from glider.errors import InputError, expect
from glider.files.record import append_sealed, read_sealed
from glider.paths import PACKAGE
from glider.progress import Shares, silent
from glider.verification.funnel.funnel import Funnel
from glider.verification.proof.held import held_faults
from glider.verification.proof.interval_proof import (
    BUDGET,
    Candidate,
    IntervalProof,
    prove_interval,
    worst_candidate,
)

_FORMAT = "drake-glider funnel proof 2"

_CHECKER = ("verification", "physics", "compiled", "control", "files")
"""Packages whose sources a proof depends on."""


@functools.cache
def checker_hash() -> str:
    """Returns the hash of the program that proves, and what it uses, in hexadecimal."""
    versions = [sys.version, *(m.__version__ for m in (np, scipy, numba, flint))]
    digest = hashlib.sha256("\n".join(versions).encode())
    for folder in _CHECKER:
        for path in sorted((PACKAGE / folder).rglob("*.py")):
            digest.update(path.relative_to(PACKAGE).as_posix().encode())
            digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()


@dataclasses.dataclass(frozen=True, kw_only=True)
class FlightProof:
    """The outcome of a proof, up to the first interval that is not proven."""

    times: np.ndarray  #: The funnel's times (T,) [s].
    #: Of each interval that was tried, by its index, in order; one at most is no proof.
    outcomes: dict[int, IntervalProof]
    from_file: int  #: Number of them that were read from a file.
    candidate: Candidate | None  #: Where flights may leave the one that is not proven.

    @property
    def of_intervals(self) -> int:
        """Number of intervals that the funnel has."""
        return int(np.count_nonzero(np.diff(self.times)))

    @property
    def failed(self) -> int | None:
        """Index of the interval that is not proven; None where all tried are."""
        return next((k for k, found in self.outcomes.items() if not found.proven), None)

    @property
    def complete(self) -> bool:
        """Whether all that were tried are proven."""
        return self.failed is None

    @property
    def is_whole(self) -> bool:
        """Whether it is proven of every interval: the theorem holds."""
        return self.complete and len(self.outcomes) == self.of_intervals

    @property
    def until(self) -> float:
        """Time before which nothing that was tried is left unproven [s]."""
        last = max(self.outcomes) + 1
        return float(self.times[last if self.failed is None else self.failed])

    @property
    def fault(self) -> str:
        """Reason why that one is not; empty where all are."""
        return "" if self.failed is None else self.outcomes[self.failed].fault

    @property
    def count(self) -> int:
        """Number of intervals that are proven."""
        return sum(found.proven for found in self.outcomes.values())

    @property
    def boxes(self) -> int:
        """Number of boxes in all intervals."""
        return sum(found.boxes for found in self.outcomes.values())


def remainder_status(funnel: Funnel, proof: FlightProof | None = None) -> str:
    """Returns how a funnel's remainder is known: "none", "sampled", or as it is proven.

    That is "rigorous until t=0.8795", the time before which all that was tried is
    proven, and "in 3 of 200 intervals" if these were not all.
    """
    if proof is None or not proof.count or not funnel.beta.any():
        return "sampled" if funnel.beta.any() else "none"
    status = f"rigorous until t={proof.until:.4f}"
    tried = len(proof.outcomes)
    if tried == proof.of_intervals or not proof.complete:
        return status
    return f"{status} in {tried} of {proof.of_intervals} intervals"


def prove_flights(
    funnel: Funnel,
    every: int = 1,
    *,
    budget: int = BUDGET,
    workers: int = -1,
    resume: Path | None = None,
    progress: Shares = silent,
    is_checked: bool = False,
) -> FlightProof:
    """Tries to prove that no flight leaves a funnel between its ends.

    Args:
        every: look at every so many intervals only, the first and last included.
        budget: boxes of one interval, until the search for a bound gives up.
        workers: processes; as many as there are cores if -1.
        resume: file that is read, if it is there, and that every outcome is added to.
        is_checked: whether `check_funnel` holds, which proves held commands too; else
            they are proven first.

    Raises:
        InputError: the file is not a record of this funnel's proof, or held commands
            are not what the funnel says that they are.
    """
    for fault in () if is_checked else held_faults(funnel, progress):
        raise InputError(f"Nothing is proven: {fault}")
    flows = funnel.nominal.flows.tolist()
    wanted = sorted({*flows[::every], flows[-1]})
    header = _Header(
        format=_FORMAT, funnel=funnel.sha256, checker=checker_hash(), budget=budget
    )
    lines = read_sealed(resume, header, _Record, "a proof", "funnel") if resume else []
    known = {line.interval: line for line in lines if line.proven}
    done = {k: known[k] for k in wanted if k in known}
    left = [k for k in wanted if k not in known]
    from_file = len(done)
    found = joblib.Parallel(n_jobs=workers, return_as="generator")(
        joblib.delayed(prove_interval)(funnel.between(k, k + 1), budget) for k in left
    )
    for k, outcome in zip(left, found, strict=False):
        done[k] = outcome
        if resume and outcome.proven:
            line = _Record(interval=k, **dataclasses.asdict(outcome))
            append_sealed(resume, header, line)
        progress(len(done) / len(wanted))
        if not outcome.proven:
            break
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # That the rest is not needed any more.
        found.close()
    failed = [funnel.between(k, k + 1) for k in done if not done[k].proven]
    return FlightProof(
        times=funnel.nominal.times,
        outcomes=dict(sorted(done.items())),
        from_file=from_file,
        candidate=worst_candidate(failed[0]) if failed else None,
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Header:
    """First line of a record, with hashes."""

    format: str
    funnel: str
    checker: str = ""
    budget: int = BUDGET


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Record(IntervalProof):
    """Each other line: an interval that was proven."""

    interval: int
    seal: str = ""

    def __post_init__(self):
        for name in ("interval", "boxes", "parts", "ratio"):
            value = getattr(self, name)
            words = "a number that is zero or positive"
            expect(0 <= value < math.inf, f"field '{name}'", value, words)
