"""report.json: what other programs read."""

from typing import Any

from glider.report.numbers import finite_or_none
from glider.sysid.result import (
    MODELS,
    Errors,
    Result,
)


def to_json(result: Result) -> dict[str, Any]:
    """Returns report.json: lists, dicts, strings, finite floats and None."""
    return {
        "campaign": result.campaign,
        "flights": {
            "fit": list(result.fit_flights),
            "held_out": list(result.held_out_flights),
        },
        "verdict": result.verdict,
        "effects": [
            {
                "kind": e.kind,
                "coefficients": {
                    name: {
                        "value": finite_or_none(c.value),
                        "std": finite_or_none(c.std),
                        "unit": c.unit,
                    }
                    for name, c in e.coefficients.items()
                },
                "evidence": finite_or_none(e.evidence),
                "share_of_residual": finite_or_none(e.share),
                "indistinguishable_from": list(e.indistinguishable_from),
                "depends_on": list(e.depends_on),
            }
            for e in result.effects
        ],
        "errors": {model: _errors_json(result.errors.get(model)) for model in MODELS},
        "noise": {
            "position_m": finite_or_none(result.noise_position_m),
            "pitch_rad": finite_or_none(result.noise_pitch_rad),
        },
        "seconds": {stage: finite_or_none(s) for stage, s in result.seconds.items()},
        "version": result.version,
    }


def _errors_json(errors: Errors | None) -> dict[str, Any] | None:
    if errors is None:
        return None
    return {
        "equation": {
            "tangential": finite_or_none(errors.tangential),
            "normal": finite_or_none(errors.normal),
            "pitch": finite_or_none(errors.pitch),
        },
        "rollout": {
            "position_rms_m": finite_or_none(errors.position_rms_m),
            "position_end_m": finite_or_none(errors.position_end_m),
            "pitch_rms_rad": finite_or_none(errors.pitch_rms_rad),
        },
        "rollout_measured_pitch": {
            "position_rms_m": finite_or_none(errors.measured_pitch_position_rms_m)
        },
    }
