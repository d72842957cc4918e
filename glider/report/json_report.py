"""report.json: what other programs read."""

from typing import Any

from glider.report.numbers import finite
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
                        "value": finite(c.value),
                        "std": finite(c.std),
                        "unit": c.unit,
                    }
                    for name, c in e.coefficients.items()
                },
                "evidence": finite(e.evidence),
                "share_of_residual": finite(e.share),
                "indistinguishable_from": list(e.indistinguishable_from),
                "depends_on": list(e.depends_on),
            }
            for e in result.effects
        ],
        "errors": {model: _errors_json(result.errors.get(model)) for model in MODELS},
        "noise": {
            "position_m": finite(result.noise_position_m),
            "pitch_rad": finite(result.noise_pitch_rad),
        },
        "seconds": {stage: finite(s) for stage, s in result.seconds.items()},
        "version": result.version,
    }


def _errors_json(errors: Errors | None) -> dict[str, Any] | None:
    if errors is None:
        return None
    return {
        "equation": {
            "tangential": finite(errors.tangential),
            "normal": finite(errors.normal),
            "pitch": finite(errors.pitch),
        },
        "rollout": {
            "position_rms_m": finite(errors.position_rms_m),
            "position_end_m": finite(errors.position_end_m),
            "pitch_rms_rad": finite(errors.pitch_rms_rad),
        },
        "rollout_measured_pitch": {
            "position_rms_m": finite(errors.measured_pitch_position_rms_m)
        },
    }
