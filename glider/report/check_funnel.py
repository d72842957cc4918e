"""What was checked, proven and flown of a funnel, in sentences and as JSON.

The sentences are in `templates/check_funnel.txt`.
"""

import dataclasses
import functools
import hashlib
from pathlib import Path
from typing import Any, NamedTuple

import jinja2
import numpy as np

from glider.errors import printable
from glider.physics.confidence import describe_level, describe_set
from glider.physics.covariance import Covariance
from glider.physics.model import GliderModel, model_text
from glider.planning.problem import PerchingProblem
from glider.verification.funnel.funnel import Funnel, gliders_note
from glider.verification.funnel.growth import SHARES
from glider.verification.proof.check import Verdict
from glider.verification.proof.flight_proof import FlightProof
from glider.verification.proof.latency import ProvenLatency
from glider.verification.proof.phases import LEVEL, first_commands
from glider.verification.proof.purpose import arrival, hook_faults, set_sizes
from glider.verification.trials.as_flown import FlownTrial
from glider.verification.trials.falsify import Falsification

_HASH_DIGITS = 16
"""Digits of a hash that are printed; JSON has them all."""


class Checked(NamedTuple):
    """What was checked and proven: of a funnel, or of one and those of its phases."""

    problem: PerchingProblem
    covariance: Covariance | None
    funnels: tuple[Funnel, ...]
    verdicts: list[Verdict]
    faults: list[str]  #: Of phases.
    proofs: list[FlightProof]  #: As far as they were asked for, until one fails.
    latency: ProvenLatency | None  #: What is proven of one; None where all else failed.

    @property
    def holds(self) -> bool:
        """Whether all certificates hold, at any phase."""
        return not self.faults and all(verdict.holds for verdict in self.verdicts)

    @property
    def is_proven(self) -> bool:
        """Whether it is proven as a whole."""
        is_checked = self.holds and all(verdict.is_whole for verdict in self.verdicts)
        are_whole = [proof.is_whole for proof in self.proofs]
        lacks = self.latency is not None and not self.latency.holds
        whole = len(are_whole) == len(self.funnels) and all(are_whole)
        return is_checked and whole and not lacks


def check_report(
    funnel: Funnel,
    verdict: Verdict,
    proof: FlightProof | None,
    problem: PerchingProblem | None,
) -> dict[str, Any]:
    """Returns the outcome of `check-funnel` as it is written to JSON.

    The problem is None where the funnel's end is no perch.
    """
    report = dataclasses.asdict(verdict) | {
        "loop": _loop_report(funnel, funnel.settings),
        "holds": verdict.holds,
        "file_sha256": funnel.sha256,
        "glider_sha256": _model_hash(funnel.nominal.model),
        "made_for": gliders_note(funnel),
        "inlet": set_sizes(funnel, 0.0),
        "last_set": set_sizes(funnel, funnel.nominal.times[-1]),
        "command_error_rad_s": funnel.settings.command_error,
        "wind_m_s": funnel.settings.wind,
        "period_s": funnel.settings.period,
        "largest_command_error_rad_s": float(funnel.errors.max()),
    }
    if problem:
        report["end"] = dataclasses.asdict(arrival(funnel, problem))
        report["hook_takes_all"] = not hook_faults(funnel, problem)
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
    return report


def _loop_report(funnel, settings, latency=0.0):
    """Returns the loop that a theorem is about as it is written to JSON.

    The state is the true one, without an estimator; periods and latency are exact.
    """
    gliders = funnel.gliders
    return {
        "state": "true",
        "commands": _commands(funnel),
        "period_s": settings.period,
        "latency_s": latency,
        "jitter_s": 0.0,
        "command_error_rad_s": settings.command_error,
        "wind_m_s": settings.wind,
        "set_level": gliders and gliders.confidence.level,
    }


def _commands(funnel):
    """Returns what moves the elevator: held commands, others, or none."""
    nominal = funnel.nominal
    if funnel.settings.period:
        return "held"
    return "continuous" if nominal.inputs.any() or nominal.gains.any() else "none"


def trial_report(funnel: Funnel, trial: Falsification, seed: int) -> dict[str, Any]:
    """Returns the outcome of flights of a set as it is written to JSON."""
    confidence = trial.confidence
    assert confidence is not None
    worst = int(np.argmax(trial.later))
    return {
        "names": list(confidence.names),
        "level": confidence.level,
        "shape": confidence.shape,
        "half_widths": confidence.reach(np.eye(len(confidence.names))).tolist(),
        "funnel_was_made_for_them": _made_for(funnel, trial),
        "flights": trial.samples,
        "escapes": trial.escapes,
        "largest_level": float(trial.levels.max()),
        "largest_later_level": float(trial.later.max()),
        "largest_end_level": float(trial.ends.max()),
        "worst_deviation": trial.deviations[worst].tolist(),
        "worst_start_time": float(trial.starts[worst]),
        "seed": seed,
    }


def flown_report(trial: FlownTrial, seed: int) -> dict[str, Any]:
    """Returns the outcome of flights as they are flown as it is written to JSON."""
    hold = trial.loop.hold
    return {
        "period_s": hold.period,
        "latency_s": hold.latency,
        "predicts": hold.predicts,
        "wind_m_s": trial.loop.wind,
        "command_error_rad_s": trial.loop.command_error,
        "gliders": trial.loop.gliders and describe_set(trial.loop.gliders),
        "flights": len(trial.levels),
        "of_the_ascent": int(trial.climbed.sum()),
        "escapes": trial.escapes,
        "end_outside": trial.astray,
        "largest_level": float(trial.levels.max()),
        "largest_later_level": float(trial.later.max()),
        "largest_end_level": float(trial.ends.max()),
        "seed": seed,
    }


def describe_flown(trial: FlownTrial, seed: int) -> str:
    """Returns the outcome of flights as they are flown in sentences, one a line."""
    return _text("as_flown", trial, seed)


def describe_check(
    funnel: Funnel,
    verdict: Verdict,
    proof: FlightProof | None,
    problem: PerchingProblem | None,
    model: Path | None,
    covariance: Covariance | None = None,
) -> str:
    """Returns the outcome of `check-funnel` in sentences, one a line.

    A model is the file of the glider that it was compared with; it may have a
    covariance, which the funnel's set of gliders was then compared with. The problem
    is None where the funnel's end is no perch.
    """
    lines = [_text("certificate", funnel, verdict, model, covariance)]
    if verdict.holds:
        ends = (set_sizes(funnel, t) for t in funnel.nominal.times[[0, -1]])
        lines.append(_text("sizes", *ends))
        lines += [describe_proof(funnel, proof)] if proof else []
    if verdict.holds and problem:
        accepted = not hook_faults(funnel, problem)
        reached = arrival(funnel, problem)
        lines.append(_text("last_set", reached, problem.hook, accepted))
    return "\n".join(lines)


def phases_report(checked: Checked) -> dict[str, Any]:
    """Returns whether funnels are one loop at any phase as it is written to JSON."""
    least, (launch, *rests) = _least_of(checked), checked.funnels
    return {
        "holds": not checked.faults,
        "faults": checked.faults,
        "proven": checked.is_proven,
        "loop": _loop_report(rests[0], least, first_commands(launch, rests)[0]),
        "first_command_s": list(first_commands(launch, rests)),
        "level": LEVEL,
        "command_error_rad_s": least.command_error,
        "wind_m_s": least.wind,
        "made_for": gliders_note(launch),
    }


def describe_phases(checked: Checked) -> str:
    """Returns the same in sentences, and what is proven of all of them together."""
    least, (launch, *rests) = _least_of(checked), checked.funnels
    times = 1e3 * np.array(first_commands(launch, rests))
    faults = checked.faults
    proven = checked.is_proven
    return _text("phases", len(rests), least, LEVEL, faults, times, proven, launch)


def describe_latency(checked: Checked) -> str:
    """Returns what is proven of a latency in a sentence."""
    launch, *rests = checked.funnels
    return _text("latency", checked.latency, launch, bool(rests))


def latency_report(checked: Checked) -> dict[str, Any]:
    """Returns the same as it is written to JSON."""
    proven, (_, *rests) = checked.latency, checked.funnels
    assert proven is not None
    return dataclasses.asdict(proven) | {
        "holds": proven.holds,
        "state": "true",
        "jitter_s": 0.0,
        "predictor_knows_all_commands": True,
        "first_command_is_predicted": bool(rests),
    }


def _least_of(checked):
    """Returns the settings of the last funnel, with the least bounds of all."""
    funnels = checked.funnels
    latency = checked.latency
    error, wind = np.min([own.settings.pushes for own in funnels], axis=0).tolist()
    error = min(error, latency.error_left) if latency and latency.holds else error
    return dataclasses.replace(funnels[-1].settings, command_error=error, wind=wind)


def describe_proof(funnel: Funnel, proof: FlightProof) -> str:
    """Returns sentences about a proof."""
    return _text("proof", funnel, proof)


def describe_trial(funnel: Funnel, trial: Falsification, seed: int) -> str:
    """Returns the outcome of flights of a set in sentences, one a line."""
    worst = int(np.argmax(trial.later))
    made_for = _made_for(funnel, trial)
    of_worst = trial.deviations[worst], trial.starts[worst]
    return _text("flights", funnel, trial, seed, made_for, *of_worst)


def _made_for(funnel, trial):
    """Determines whether all gliders flown are in the funnel's set; None without."""
    if not funnel.gliders:
        return None
    return bool(np.all(funnel.gliders.confidence.holds(trial.deviations)))


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
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("glider.report"),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals |= {
        "digits": _HASH_DIGITS,
        "shares": len(SHARES),
        "describe_set": describe_set,
        "describe_level": describe_level,
        "commands_of": _commands,
        "model_hash": lambda funnel: _model_hash(funnel.nominal.model),
        "degrees": lambda limits: "{:.0f}° to {:.0f}°".format(*np.degrees(limits)),
    }
    return environment.get_template("check_funnel.txt")
