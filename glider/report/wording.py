"""Sentences and phrases about a result; the former are in templates/sentences.txt."""

import math
from collections.abc import Iterable, Sized
from typing import Any

import jinja2
import numpy as np

from glider.campaign.checks.masks import ExcludedRows
from glider.physics.effects import KINDS
from glider.report import numbers
from glider.report.error_table import FREE, baseline, error_of, unit_beside_noise
from glider.sysid.result import LIBRARY_SHAPE, FoundEffect, Result

_MOST_COEFFICIENTS = 8
"""An effect with more of them shows the first; all are in the files."""


def headline(result: Result) -> str:
    """The verdict in one sentence."""
    return " ".join(say("headline", result))


def remarks(result: Result) -> list[str]:
    """Sentences that qualify the headline."""
    return say("remarks", result)


def differences(result: Result) -> list[str]:
    """Flight-to-flight variations that belong to no effect."""
    return say("differences", result)


def say(name: str, *values: object) -> list[str]:
    """Sentences of a macro of sentences.txt, one a line there."""
    text = getattr(_SENTENCES.module, name)(*values)
    return [" ".join(line.split()) for line in text.splitlines() if line.strip()]


def join(items: Iterable[str], last: str = " and ", between: str = ", ") -> str:
    """Returns "a, b and c", each item once."""
    once = list(dict.fromkeys(items))
    return last.join(filter(None, [between.join(once[:-1]), *once[-1:]]))


def counted(items: Sized, noun: str) -> str:
    """Returns "1 flight" or "3 flights"."""
    return f"{len(items)} {noun}{'' if len(items) == 1 else 's'}"


def words_of(result: Result, kinds: Iterable[str]) -> list[str]:
    """Short phrases for kinds of effects."""
    known = {**KINDS, **{e.kind: e for e in result.own_effects}}
    return [known[k].words if k in known else name_of(k) for k in kinds]


def name_of(text: str) -> str:
    """A name of the program as people write it."""
    return text.replace("_", " ")


def excluded_words(s: ExcludedRows) -> str:
    """Which rows were not used, and why."""
    rows = "all rows" if s.rows == "all" else f"lines {s.rows}"
    return f"{s.file}, {rows}: {s.why}"


def notes_of(result: Result) -> list[str]:
    """Assumptions, as sentences."""
    notes = result.settings.get("notes", ())
    return list(notes) if isinstance(notes, (list, tuple)) else [str(notes)]


def effect_views(result: Result) -> list[dict[str, Any]]:
    """Effects as text."""
    return [_effect_view(effect, result) for effect in result.effects]


def _effect_view(effect: FoundEffect, result: Result) -> dict[str, Any]:
    items = list(effect.coefficients.items())
    units = {name: c.unit for name, c in items}
    others = effect.indistinguishable_from
    return {
        "kind": effect.kind,
        "is_unexplained": effect.kind == "unexplained",
        "words": effect.words,
        "coefficients": [
            (name_of(name), numbers.format_estimate(c) + numbers.in_degrees(c))
            for name, c in items[:_MOST_COEFFICIENTS]
        ],
        "more": max(len(items) - _MOST_COEFFICIENTS, 0),
        "spread": [
            (name_of(name), numbers.format_spread(s, units.get(name, "")))
            for name, s in effect.spread_over_flights.items()
        ],
        "evidence": numbers.format_evidence(effect.evidence),
        "share": numbers.format_share(effect.share_of_residual),
        "inclusion": numbers.format_share(effect.inclusion),
        "shape_fits": effect.shape == LIBRARY_SHAPE,
        "confused": [
            f"{words} ({kind})"
            for words, kind in zip(words_of(result, others), others, strict=True)
        ],
        "depends_on": effect.depends_on,
    }


def _from_to(result: Result, old: float, new: float) -> str:
    unit = unit_beside_noise(result, old, new)
    return f"from {unit.text(old)} to {unit.text(new)}"


def _model_of(result: Result) -> str:
    is_given = baseline(result) == "nominal"
    return "nominal model" if is_given else "refitted flat plate"


TEMPLATES = jinja2.Environment(
    loader=jinja2.PackageLoader("glider.report"),
    autoescape=jinja2.select_autoescape(["html"]),
    undefined=jinja2.StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)
"""Templates of pages and of sentences."""

TEMPLATES.tests["is_better"] = lambda fold: (
    fold.corrected.position_rms_m < fold.refitted.position_rms_m
)
TEMPLATES.globals |= {
    "DIVERGED": numbers.DIVERGED,
    "baseline": baseline,
    "both": lambda r: all(r.errors.get(m) for m in (baseline(r), "corrected")),
    "counted": counted,
    "error": lambda r, model: error_of(r, model, FREE),
    "estimate": numbers.format_estimate,
    "from_to": _from_to,
    "inf": math.inf,
    "join": join,
    "length": lambda r, value: unit_beside_noise(r, value).text(value),
    "model_of": _model_of,
    "name_of": name_of,
    "numbers": lambda value: ", ".join(f"{v:g}" for v in np.atleast_1d(value)),
    "spread": numbers.format_spread,
    "vars": vars,
    "words_of": words_of,
}
_SENTENCES = TEMPLATES.get_template("sentences.txt")
