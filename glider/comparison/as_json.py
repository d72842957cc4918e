"""A comparison for programs."""

from typing import Any

from glider.comparison.differences import Comparison, Difference
from glider.comparison.saved import SavedReport
from glider.comparison.wording import headline
from glider.report.json_report import plain
from glider.sysid.result import Estimate


def to_json(comparison: Comparison) -> dict[str, Any]:
    """Returns a comparison as lists, dicts, strings, numbers, booleans and None."""
    return plain(
        {
            "first": _report(comparison.first),
            "second": _report(comparison.second),
            "summary": headline(comparison),
            "z_significant": comparison.z_significant,
            "differences": [
                _difference(d) | {"is_significant": comparison.is_significant(d)}
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
        "errors": report.errors,
    }


def _difference(d: Difference) -> dict[str, Any]:
    return {
        "group": d.group,
        "name": d.label,
        "unit": d.unit,
        "first": _estimate(d.first),
        "second": _estimate(d.second),
        "change": _estimate(d.change),
        "z": d.z,
        "note": d.note,
    }


def _estimate(estimate: Estimate | None) -> dict[str, float] | None:
    if estimate is None:
        return None
    return {"value": estimate.value, "std": estimate.std}
