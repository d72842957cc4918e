"""report.json: what other programs read."""

import dataclasses
import math
from typing import Any

import numpy as np

from glider.sysid.result import (
    CALIBRATED,
    MODELS,
    Errors,
    Estimate,
    FoundEffect,
    Result,
)


def to_json(result: Result) -> dict[str, Any]:
    """Returns report.json: lists, dicts, strings, numbers, booleans and None."""
    errors = {model: _errors(result.errors.get(model)) for model in MODELS}
    outlying = result.outlying
    if result.errors.get(CALIBRATED) is not None:
        errors[CALIBRATED] = _errors(result.errors[CALIBRATED])
    return plain(
        {
            "campaign": result.campaign,
            "flights": {"fit": result.fit_flights, "held_out": result.held_out_flights},
            "verdict": result.verdict,
            "reason": result.reason,
            "effects": [_effect(e) for e in result.effects],
            "errors": errors,
            "outlying": None
            if outlying is None
            else {
                "flights": outlying.names,
                "errors": {m: _errors(e) for m, e in outlying.errors.items()},
            },
            "evidence_threshold": dataclasses.asdict(result.evidence_threshold),
            "folds": [
                {
                    "held_out": fold.held_out,
                    "refitted": _errors(fold.refitted),
                    "corrected": _errors(fold.corrected),
                }
                for fold in result.folds
            ],
            "left": dataclasses.asdict(result.left),
            "air": {
                "std_m_s": result.air.std_m_s,
                "correlation_s": result.air.correlation_s,
            },
            "spreads": {n: dataclasses.asdict(s) for n, s in result.spreads.items()},
            "correlations": result.correlations,
            "candidates": result.candidates,
            "combinations": [dataclasses.asdict(c) for c in result.combinations],
            "curves": [dataclasses.asdict(c) for c in result.curves],
            "vehicle": _estimates(result.vehicle),
            "warnings": result.warnings,
            "set_aside": [dataclasses.asdict(s) for s in result.set_aside],
            "planarity": result.planarity,
            "seed": result.settings.get("seed"),
            "settings": result.settings,
            "noise": {
                "position_m": result.noise_position_m,
                "pitch_rad": result.noise_pitch_rad,
            },
            "seconds": result.seconds,
            "version": result.version,
        }
    )


def _effect(e: FoundEffect) -> dict[str, Any]:
    return {
        "kind": e.kind,
        "coefficients": _estimates(e.coefficients),
        "evidence": e.evidence,
        "share_of_residual": e.share,
        "inclusion": e.inclusion,
        "spread_over_flights": e.spread,
        "shape": "library" if e.shape_fits else "not the library's",
        "indistinguishable_from": e.indistinguishable_from,
        "depends_on": e.depends_on,
    }


def _estimates(estimates: dict[str, Estimate]) -> dict[str, Any]:
    return {name: dataclasses.asdict(c) for name, c in estimates.items()}


def _errors(errors: Errors | None) -> dict[str, Any] | None:
    if errors is None:
        return None
    return {
        "equation": {
            "tangential": errors.tangential,
            "normal": errors.normal,
            "pitch": errors.pitch,
        },
        "rollout": {
            "position_rms_m": errors.position_rms_m,
            "position_end_m": errors.position_end_m,
            "pitch_rms_rad": errors.pitch_rms_rad,
        },
        "rollout_measured_pitch": {
            "position_rms_m": errors.measured_pitch_position_rms_m
        },
    }


def plain(value: Any) -> Any:
    """Returns what JSON has: no arrays, no NumPy numbers, None for NaN and infinity."""
    if isinstance(value, dict):
        return {str(name): plain(v) for name, v in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [plain(v) for v in value]
    if value is None or isinstance(value, (str, bool)):
        return value
    if isinstance(value, np.bool_):
        return bool(value)
    if isinstance(value, (int, np.integer)):
        return int(value)
    if isinstance(value, (float, np.floating)):
        return float(value) if math.isfinite(value) else None
    return str(value)
