"""What was checked of a funnel, in words and as JSON: no more than was checked."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np

from glider.planning.problem import PerchingProblem
from glider.verification.dynamics.confidence import describe_set
from glider.verification.funnel.funnel import Funnel, gliders_note
from glider.verification.funnel.growth import SHARES
from glider.verification.proof.check import Verdict
from glider.verification.proof.flight_proof import FlightProof
from glider.verification.proof.purpose import arrival, hook_faults, model_hash

HASH_DIGITS = 16
"""Digits of a hash that are printed; JSON has them all."""


def check_report(
    funnel: Funnel,
    verdict: Verdict,
    proof: FlightProof | None,
    problem: PerchingProblem,
) -> dict[str, Any]:
    """Returns the outcome of `check-funnel` as it is written to JSON."""
    report = dataclasses.asdict(verdict) | {
        "holds": verdict.holds,
        "file_sha256": funnel.sha256,
        "glider_sha256": model_hash(funnel.nominal.model),
        "end": dataclasses.asdict(arrival(funnel, problem)),
        "hook_takes_all": not hook_faults(funnel, problem),
        "remainder": remainder_status(funnel, proof),
        "made_for": gliders_note(funnel),
    }
    if proof:
        report |= {
            "every_flight": proof.is_whole,
            "intervals_proven": proof.count,
            "intervals_tried": len(proof.intervals),
            "of_intervals": proof.of_intervals,
            "intervals_from_file": proof.from_file,
            "proven_until": proof.until,
            "fault": proof.fault,
            "candidate": proof.candidate and dataclasses.asdict(proof.candidate),
            "boxes": proof.boxes,
        }
    return report


def describe_check(
    funnel: Funnel,
    verdict: Verdict,
    proof: FlightProof | None,
    problem: PerchingProblem,
    model: Path | None,
) -> str:
    """Returns the outcome of `check-funnel` in sentences, one a line.

    Args:
        funnel: the funnel.
        verdict: of its check.
        proof: of its flights, where asked for.
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
    lines += _describe_gliders(funnel)
    if proof:
        lines.append(describe_proof(funnel, proof))
    return "\n".join([*lines, describe_arrival(funnel, problem)])


def remainder_status(funnel: Funnel, proof: FlightProof | None = None) -> str:
    """Returns how a funnel's remainder is known.

    "none" where it bears none, else "sampled", or with a proof "rigorous until
    t=0.8795", the time before which nothing that was tried is left unproven, and "in 3
    of 200 intervals" if these were not all.
    """
    if not funnel.beta.any():
        return "none"
    if proof is None or not proof.count:
        return "sampled"
    status, tried = f"rigorous until t={proof.until:.4f}", len(proof.intervals)
    if tried == proof.of_intervals or not proof.complete:
        return status
    return f"{status} in {tried} of {proof.of_intervals} intervals"


def describe_proof(funnel: Funnel, proof: FlightProof) -> str:
    """Returns sentences about a proof: no more than is proven."""
    if not funnel.beta.any():
        return "The certificate bears no remainder: it is of the polynomials alone."
    count, of = proof.count, proof.of_intervals
    whose, about = "this glider", ""
    if funnel.gliders:
        whose, about = "every glider of its set", " about its own center"
    if proof.is_whole:
        words = (
            f"Proven: every flight of {whose} that starts in the inlet stays in the "
            f"funnel{about} and ends in its last set, in continuous time: {of} "
            f"intervals, {proof.boxes:,} boxes"
        )
    elif proof.complete:
        flight = "flight of a glider of its set" if funnel.gliders else "flight"
        words = (
            f"Proven: no {flight} leaves the funnel{about} in {count} of its {of} "
            f"intervals, {proof.boxes:,} boxes; of the others nothing is proven"
        )
    else:
        words = _describe_failure(funnel, proof)
    if proof.from_file:
        words += f"; {proof.from_file} of the intervals were read from the file"
    return f"{words}."


def _describe_failure(funnel, proof):
    k, worst = proof.failed, proof.candidate
    names = zip(funnel.nominal.state_names, worst.state, strict=True)
    state = ", ".join(f"{name} = {value:.4g}" for name, value in names)
    whose = " with its own glider" if funnel.gliders else ""
    rises = "so V rises" if worst.growth > 0.0 else "so it is no counterexample"
    return (
        f"Not proven from {proof.times[k]:.4f} to {proof.times[k + 1]:.4f} s: "
        f"{proof.fault}; proven in {proof.count} of {proof.of_intervals} intervals.\n"
        f"The worst state that was found there{whose}, at {worst.time:.4f} s on the "
        "boundary: "
        f"{state}; with a servo without limits V̇/V is {worst.growth:.2g} 1/s, "
        f"{rises}"
    )


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


def _describe_gliders(funnel):
    """Returns what holds of the set of gliders that a funnel was made for, if any."""
    if not funnel.gliders:
        return []
    gliders = describe_set(funnel.gliders.confidence)
    return [
        f"It was made for more gliders, a {gliders}: at its times, about the center of "
        "each, the servo has room, the last set is in the goal, and the remainder that "
        "was seen is theirs too. So far that is sampled in floating point: of them "
        "only --prove proves anything."
    ]


def describe_arrival(funnel: Funnel, problem: PerchingProblem) -> str:
    """Returns a sentence about the last set, and what of it a hook takes."""
    reached, hook = arrival(funnel, problem), problem.hook
    low, high = np.degrees(reached.pitch)
    words = (
        f"The last set, at {reached.time:.4f} s, is within "
        f"{100.0 * reached.miss:.2f} cm of the wire, with pitches of {low:.0f}° to "
        f"{high:.0f}° and at most {reached.speed:.2f} m/s"
    )
    if not hook_faults(funnel, problem):
        return f"{words}: the hook takes all of it."
    low, high = np.degrees(hook.pitch_limits)
    return (
        f"{words}; the hook takes {low:.0f}° to {high:.0f}° and up to "
        f"{hook.speed_limit:.2f} m/s only: not all of it is a perch."
    )
