"""A comparison for programs."""

from typing import Any

from glider.comparison.differences import Comparison
from glider.comparison.saved import SavedReport
from glider.comparison.wording import headline
from glider.files.schema import json_text, to_builtins
from glider.sysid.result import Estimate


def to_json(comparison: Comparison) -> str:
    """The text of comparison.json."""
    return json_text(
        {
            "first": _report(comparison.first),
            "second": _report(comparison.second),
            "summary": headline(comparison),
            "z_significant": comparison.z_significant,
            "differences": [
                {
                    "group": d.group,
                    "name": d.label,
                    "unit": d.unit,
                    "first": _estimate(d.first),
                    "second": _estimate(d.second),
                    "change": _estimate(d.change),
                    "z": d.z,
                    "note": d.note,
                    "is_significant": comparison.is_significant(d),
                }
                for d in comparison.differences
            ],
            "notes": comparison.notes,
        }
    )


def _report(report: SavedReport) -> dict[str, Any]:
    return {
        "file": str(report.path),
        "campaign": report.campaign,
        "verdict": report.verdict,
        "reason": report.reason,
        "effects": {
            e.kind: {"evidence": e.evidence, "inclusion": e.inclusion}
            for e in report.effects
        },
        "errors": {
            model: {
                f"{group}.{name}": error
                for group, part in to_builtins(errors).items()
                for name, error in part.items()
            }
            for model, errors in report.errors.items()
            if errors is not None
        },
    }


def _estimate(estimate: Estimate | None) -> dict[str, float] | None:
    if estimate is None:
        return None
    return {"value": estimate.value, "std": estimate.std}
