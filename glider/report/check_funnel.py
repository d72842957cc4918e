"""What was checked and proven of a funnel, in sentences and as JSON.

The sentences are in `templates/check_funnel.txt`.
"""

import dataclasses
import functools
import hashlib
from pathlib import Path
from typing import Any

import numpy as np

from glider.errors import printable
from glider.physics.confidence import describe_level, describe_set
from glider.physics.model import GliderModel, model_text
from glider.planning.problem import PerchingProblem
from glider.report.wording import TEMPLATES
from glider.verification.funnel.funnel import Funnel, gliders_note
from glider.verification.proof.check import Verdict
from glider.verification.proof.flight_proof import FlightProof
from glider.verification.proof.latency import ProvenLatency
from glider.verification.proof.purpose import Purpose, arrival, hook_faults, set_sizes

_HASH_DIGITS = 16
"""Digits of a hash that are printed; JSON has them all."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Checked:
    """What was checked and proven of a funnel."""

    path: Path | None  #: File of the model that it was compared with.
    purpose: Purpose  #: What was asked of it.
    funnel: Funnel
    verdict: Verdict
    proof: FlightProof | None = None  #: If it was asked for and the certificate holds.
    latency: ProvenLatency | None = None  #: If one was given and all else is proven.

    @property
    def holds(self) -> bool:
        """Whether its certificate holds."""
        return self.verdict.holds

    @property
    def is_proven(self) -> bool:
        """Whether it is proven as a whole."""
        is_whole = self.holds and self.verdict.is_whole
        is_proven = self.proof is not None and self.proof.is_whole
        lacks = self.latency is not None and not self.latency.holds
        return is_whole and is_proven and not lacks


def check_report(checked: Checked) -> dict[str, Any]:
    """Returns the outcome of `check-funnel` as it is written to JSON."""
    funnel = checked.funnel
    problem = checked.purpose.problem or PerchingProblem()
    proof = checked.proof
    latency = checked.latency
    settings = funnel.settings
    last = funnel.nominal.times[-1]
    report = dataclasses.asdict(checked.verdict) | {
        "loop": {  # The state is the true one; the period is exact.
            "state": "true",
            "commands": "held" if settings.period else "continuous",
            "period_s": settings.period,
            "latency_s": 0.0,
            "jitter_s": 0.0,
            "command_error_rad_s": settings.command_error,
            "wind_m_s": settings.wind,
            "set_level": funnel.allowed.level if funnel.is_of_set else None,
        },
        "holds": checked.holds,
        "file_sha256": funnel.sha256,
        "glider_sha256": _model_hash(funnel.nominal.model),
        "made_for": gliders_note(funnel),
        "inlet": set_sizes(funnel, 0.0),
        "last_set": set_sizes(funnel, last),
        "largest_command_error_rad_s": float(funnel.errors.max()),
        "model_compared": checked.path is not None,
        "set_compared": funnel.is_of_set and bool(checked.purpose.covariance),
        "end": dataclasses.asdict(arrival(funnel, problem)),
        "hook_takes_all": not hook_faults(funnel, problem),
    }
    if proof:
        report |= {
            "every_flight": proof.is_whole,
            "intervals_proven": proof.count,
            "intervals_tried": len(proof.outcomes),
            "of_intervals": proof.of_intervals,
            "proven_until": proof.until,
            "fault": proof.fault,
            "boxes": proof.boxes,
        }
    if latency:
        report["latency"] = dataclasses.asdict(latency) | {
            "holds": latency.holds,
            "state": "true",
            "jitter_s": 0.0,
            "predictor_knows_all_commands": True,
            "first_command_is_predicted": False,
        }
    return report


def describe_check(checked: Checked) -> str:
    """Returns the outcome of `check-funnel` in sentences, one a line."""
    funnel = checked.funnel
    verdict = checked.verdict
    problem = checked.purpose.problem or PerchingProblem()
    covariance = checked.purpose.covariance
    lines = [_text("certificate", funnel, verdict, checked.path, covariance)]
    if verdict.holds:
        first = set_sizes(funnel, 0.0)
        last = set_sizes(funnel, funnel.nominal.times[-1])
        lines.append(_text("sizes", first, last))
    if checked.proof:
        lines.append(describe_proof(funnel, checked.proof))
    if verdict.holds:
        accepted = not hook_faults(funnel, problem)
        reached = arrival(funnel, problem)
        lines.append(_text("last_set", reached, problem.hook, accepted))
    if checked.latency:
        lines.append(_text("latency", checked.latency, funnel))
    return "\n".join(lines)


def describe_proof(funnel: Funnel, proof: FlightProof) -> str:
    """Returns sentences about a proof."""
    return _text("proof", funnel, proof)


def _model_hash(model: GliderModel) -> str:
    """Returns the hash of a glider's file, in hexadecimal: the same for equal ones."""
    return hashlib.sha256(model_text(model).encode()).hexdigest()


def _text(macro, *values):
    """Returns the text of a macro: a line for each paragraph."""
    paragraphs = getattr(_template().module, macro)(*values).split("\n\n")
    lines = (printable(" ".join(paragraph.split())) for paragraph in paragraphs)
    return "\n".join(line for line in lines if line)


@functools.cache
def _template():
    words = {
        "digits": _HASH_DIGITS,
        "describe_set": describe_set,
        "describe_level": describe_level,
        "model_hash": lambda funnel: _model_hash(funnel.nominal.model),
        "degrees": lambda limits: "{:.0f}° to {:.0f}°".format(*np.degrees(limits)),
    }
    return TEMPLATES.get_template("check_funnel.txt", globals=words)
