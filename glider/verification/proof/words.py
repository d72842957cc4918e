"""What was checked of a funnel, in words and as JSON: no more than was checked."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np

from glider.planning.problem import PerchingProblem
from glider.verification.funnel.funnel import Funnel
from glider.verification.funnel.growth import SHARES
from glider.verification.proof.check import Verdict
from glider.verification.proof.purpose import Arrival, arrival, model_hash
from glider.verification.proof.remainder_proof import (
    RemainderProof,
    describe_proof,
    remainder_status,
)

HASH_DIGITS = 16
"""Digits of a hash that are printed; JSON has them all."""


def check_report(
    funnel: Funnel,
    verdict: Verdict,
    proof: RemainderProof | None,
    problem: PerchingProblem,
) -> dict[str, Any]:
    """Returns the outcome of `check-funnel` as it is written to JSON."""
    report = dataclasses.asdict(verdict) | {
        "holds": verdict.holds,
        "file_sha256": funnel.sha256,
        "glider_sha256": model_hash(funnel.nominal.model),
        "end": dataclasses.asdict(arrival(funnel, problem)),
        "remainder": remainder_status(funnel, proof),
    }
    if proof:
        report |= {
            "remainder_until": proof.until,
            "remainder_proven": proof.complete,
            "remainder_times": len(proof.times),
            "boxes": proof.boxes,
        }
    return report


def describe_check(
    funnel: Funnel,
    verdict: Verdict,
    proof: RemainderProof | None,
    problem: PerchingProblem,
    model: Path | None,
) -> str:
    """Returns the outcome of `check-funnel` in sentences, one a line.

    Args:
        funnel: the funnel.
        verdict: of its check.
        proof: of its remainder, where asked for.
        problem: that it was compared with.
        model: file of the glider that it was compared with; None for none.
    """
    of_glider = model_hash(funnel.nominal.model)[:HASH_DIGITS]
    meant = (
        f"compared with {model}" if model else "not compared with yours: --model does"
    )
    lines = [
        f"Funnel {funnel.sha256[:HASH_DIGITS]} of the glider {of_glider}, {meant}."
    ]
    if not verdict.holds:
        count = len(verdict.faults)
        faults = f"{count} fault{'s' if count > 1 else ''}"
        return "\n".join(
            [*lines, *verdict.faults, f"The certificate does not hold: {faults}."]
        )
    lines += [_describe_certificate(verdict), _describe_bearing(funnel, verdict)]
    if proof:
        lines.append(describe_proof(funnel, proof))
    return "\n".join([*lines, describe_arrival(arrival(funnel, problem), problem)])


def _describe_certificate(verdict):
    where = "each interval" if verdict.is_whole else "some intervals"
    return (
        f"The certificate holds at {verdict.times} of {verdict.of_times} times: "
        f"exactly, V̇/V <= {-verdict.slack:.2g} 1/s on the boundary, the nominal's "
        f"defect of {verdict.defect:.2g} 1/s counted; between them, in floating "
        f"point at {len(SHARES)} points of {where}, V̇/V <= {verdict.between:.2g} 1/s."
    )


def _describe_bearing(funnel, verdict):
    if not funnel.beta.any():
        return "It is of Taylor polynomials, not of the glider: it bears no remainder."
    return (
        "It bears a remainder of the Taylor polynomials; random points of the boundary "
        f"show up to {verdict.remainder_seen:.2f} times as much."
    )


def describe_arrival(reached: Arrival, problem: PerchingProblem) -> str:
    """Returns a sentence about the last set, and what of it a hook takes."""
    low, high = np.degrees(reached.pitch)
    words = (
        f"The last set, at {reached.time:.4f} s, is within "
        f"{100.0 * reached.miss:.2f} cm of the wire, with pitches of {low:.0f}° to "
        f"{high:.0f}° and at most {reached.speed:.2f} m/s"
    )
    hook = problem.hook
    least, most = hook.pitch_limits
    pitch_is_good = least <= reached.pitch[0] and reached.pitch[1] <= most
    if pitch_is_good and reached.speed <= hook.speed_limit:
        return f"{words}, which the hook takes."
    low, high = np.degrees([least, most])
    return (
        f"{words}; the hook takes {low:.0f}° to {high:.0f}° and up to "
        f"{hook.speed_limit:.2f} m/s only: not all of it is a perch."
    )
