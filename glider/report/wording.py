"""Sentences and phrases about what was found."""

import math
from typing import Any

from glider.physics.effects import KINDS
from glider.report.error_table import baseline
from glider.report.numbers import (
    DIVERGED,
    MISSING,
    format_estimate,
    format_length,
    in_degrees,
)
from glider.sysid.result import (
    Z_SIGNIFICANT,
    FoundEffect,
    Result,
)

_MOST_COEFFICIENTS = 8
"""An effect with more of them shows the first; all are in the files."""


def headline(result: Result) -> str:
    """Returns the verdict in one sentence."""
    named = [e for e in result.effects if e.kind != "unexplained"]
    unnamed = [e for e in result.effects if e.kind == "unexplained"]
    is_unexplained = bool(unnamed) or result.verdict == "unexplained"
    if result.verdict == "no_effect":
        before = baseline(result)
        model = "nominal model" if before == "as_drawn" else "refitted flat plate"
        errors = result.errors.get(before)
        text = f"The flights show no effect that the {model} lacks"
        if result.left_z >= Z_SIGNIFICANT:
            text = (
                f"The {model} is not all that the flights show, but no effect "
                "of the library earns its place"
            )
        if errors is None or not math.isfinite(errors.position_rms_m):
            return text + "."
        size = format_length(errors.position_rms_m)
        return f"{text}; it flies held-out flights to {size} in position (RMS)."
    found = [_in_line(e) for e in named]
    if is_unexplained:
        on = [name for e in unnamed for name in e.depends_on]
        varying = f" that varies with {_and(on)}" if on else ""
        error = f"an error{varying} and that no effect of the library explains"
        found.append(error if varying else error.replace(" and that", " that"))
    text = "The flights show " + _and(found, "; and ", "; ")
    change = _change(result)
    return f"{text}; {change}." if change else f"{text}."


def remarks(result: Result) -> list[str]:
    """Returns what a reader of the headline must know too, as sentences."""
    said = []
    for e in result.effects:
        if e.indistinguishable_from:
            others = _and(
                [_words_of(k, result) for k in e.indistinguishable_from], " or "
            )
            said.append(f"From these flights, {e.words} could also be {others}.")
    if result.left_z >= Z_SIGNIFICANT:
        said.append(left_words(result))
    return said


def _change(result: Result) -> str:
    before, after = (result.errors.get(m) for m in (baseline(result), "corrected"))
    if before is None or after is None:
        return ""
    old, new = before.position_rms_m, after.position_rms_m
    if not new < DIVERGED:
        return "held-out rollouts of the corrected model diverge"
    if not old < DIVERGED:
        return (
            f"held-out rollouts, which diverged, now err by {format_length(new)} (RMS)"
        )
    verb = "falls" if new < old else "goes"
    change = f"from {format_length(old)} to {format_length(new)}"
    return f"held-out position error {verb} {change} (RMS)"


def left_words(result: Result) -> str:
    """Returns what the corrected model leaves, as a sentence."""
    z = result.left_z
    model = "model" if result.verdict == "no_effect" else "corrected model"
    if not math.isfinite(z):
        return ""
    if z < Z_SIGNIFICANT:
        return f"The {model} leaves nothing but noise ({z:.1f} σ)."
    size = f"{z:.1f}" if z < 100.0 else f"{z:,.0f}"
    return (
        f"The {model} still leaves more than noise ({size} σ; "
        f"below {Z_SIGNIFICANT:g} is noise)."
    )


def effect_view(effect: FoundEffect, result: Result) -> dict[str, Any]:
    """Returns an effect as text."""
    items = list(effect.coefficients.items())
    return {
        "kind": effect.kind,
        "is_unexplained": effect.kind == "unexplained",
        "words": effect.words,
        "coefficients": [
            (name.replace("_", " "), format_estimate(c) + in_degrees(c))
            for name, c in items[:_MOST_COEFFICIENTS]
        ],
        "more": max(len(items) - _MOST_COEFFICIENTS, 0),
        "evidence": f"{effect.evidence:+,.0f}"
        if math.isfinite(effect.evidence)
        else MISSING,
        "share": f"{100.0 * effect.share:.0f} %"
        if math.isfinite(effect.share)
        else MISSING,
        "confused": [
            f"{_words_of(k, result)} ({k})" for k in effect.indistinguishable_from
        ],
        "depends_on": list(effect.depends_on),
    }


def _in_line(effect):
    """Returns "a steady wind: x = -0.600 ± 0.001 m/s, z = ..."."""
    texts = [
        f"{name.replace('_', ' ')} = {format_estimate(c)}"
        for name, c in list(effect.coefficients.items())[:3]
    ]
    colon = ", with " if ":" in effect.words else ": "
    return effect.words + (colon if texts else "") + ", ".join(texts)


def _words_of(kind: str, result: Result) -> str:
    """Returns an effect's short phrase for people."""
    kinds = {**KINDS, **{e.kind: e for e in result.own_effects}}
    return kinds[kind].words if kind in kinds else kind.replace("_", " ")


def _and(items, last=" and ", between=", "):
    items = list(dict.fromkeys(items))
    return last.join(filter(None, [between.join(items[:-1]), *items[-1:]]))


def counted(items, noun):
    """Returns "1 flight" or "3 flights"."""
    return f"{len(items)} {noun}{'' if len(items) == 1 else 's'}"


def notes_of(result):
    """Returns what was assumed, as sentences."""
    notes = result.settings.get("notes", ())
    return list(notes) if isinstance(notes, (list, tuple)) else [str(notes)]
