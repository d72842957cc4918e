"""Sentences, phrases and rows of tables about a result, for the page and the terminal.

Sentences are in templates/sentences.txt, errors in `error_table`.
"""

import math
from collections.abc import Iterable, Sized
from typing import Any

import jinja2

from glider.physics.effects import KINDS
from glider.report import numbers
from glider.report.error_table import FREE, baseline, error_of, unit_beside_floor
from glider.sysid.result import (
    LIBRARY_SHAPE,
    Estimate,
    FoundEffect,
    Result,
    excluded_among,
)

_MOST_COEFFICIENTS = 8
"""An effect with more of them shows the first; all are in the files."""

_MOST_PAIRS = 8
_WORTH_SHOWING = 0.5  # Least |correlation| of a pair that is shown.


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


def notes_of(result: Result) -> list[str]:
    """Assumptions, as sentences."""
    return list(result.settings.get("notes", ()))


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
        "coefficients": _values(items[:_MOST_COEFFICIENTS]),
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


def rival_rows(result: Result) -> list[tuple[str, list[str], str]]:
    """File, effects and probability of the corrected model and its rivals, if any."""
    if not result.rivals:
        return []
    models = {"model.yaml": result.alternatives[0]}

    for number, own in enumerate(result.rivals, 1):
        models[f"rivals/rival_{number}.yaml"] = own

    rows = []

    for file, own in models.items():
        share = f"{100.0 * own.probability:.3g} %"
        rows.append((file, _of_model(result, own.model), share))

    return rows


def _of_model(result, model):
    """Short phrases for the effects of a model, and for the free functions it has."""
    free = [
        f"free functions of {', '.join(own.variables)}" for own in model.free_functions
    ]
    return [*words_of(result, [e.kind.kind for e in model.effects]), *free]


def correlation_rows(result: Result) -> list[tuple[str, str, str]]:
    """Pairs of coefficients with correlated errors, the closest first."""
    pairs = {}

    for a, row in result.correlations.items():
        for b, value in row.items():
            if a != b and abs(value) >= _WORTH_SHOWING:  # False for NaN.
                pair = tuple(sorted((a, b)))
                pairs[pair] = value

    ranked = sorted(pairs.items(), key=lambda pair: -abs(pair[1]))
    return [(a, b, f"{value:+.2f}") for (a, b), value in ranked[:_MOST_PAIRS]]


def vehicle_rows(result: Result) -> list[tuple[str, str]]:
    """Estimated parameters of the vehicle."""
    return _values(result.vehicle.items())


_CLOCKS = {
    "poses": "offset of the poses' clock from that of the servo",
    "commands": "offset of the commands' clock from that of the elevator",
    "drift": "drift between the clocks of poses and servo over the session",
}


def clock_rows(result: Result) -> list[tuple[str, str]]:
    """Estimated offsets of clocks."""
    values = _values(result.clocks.items())
    return [(_CLOCKS.get(name, name), value) for name, value in values]


def _values(estimates: Iterable[tuple[str, Estimate]]) -> list[tuple[str, str]]:
    """Names and estimates, angles in degrees too."""
    rows = []

    for name, c in estimates:
        text = numbers.format_estimate(c) + numbers.in_degrees(c)
        rows.append((name_of(name), text))

    return rows


def spread_rows(result: Result) -> list[tuple[str, str, str]]:
    """Flight-to-flight variations: name, standard deviation, the largest value."""
    rows = []
    for name, spread in result.spreads.items():
        known = {f: v for f, v in spread.values.items() if math.isfinite(v)}
        most = max(known, key=lambda f: abs(known[f]), default=None)
        largest = numbers.MISSING
        if most is not None:
            largest = f"{most}: {numbers.format_spread(known[most], spread.unit)}"
        std = numbers.format_spread(spread.std, spread.unit, spread.std_error)
        rows.append((name_of(name), std, largest))
    return rows


def _from_to(result: Result, old: float, new: float) -> str:
    unit = unit_beside_floor(result, old, new)
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
    "angle": numbers.format_angle,
    "baseline": baseline,
    "both": lambda r: all(r.errors.get(m) for m in (baseline(r), "corrected")),
    "counted": counted,
    "excluded_among": excluded_among,
    "error": lambda r, model: error_of(r, model, FREE),
    "estimate": numbers.format_estimate,
    "from_to": _from_to,
    "inf": math.inf,
    "join": join,
    "notes_of": notes_of,
    "clock_rows": clock_rows,
    "vehicle_rows": vehicle_rows,
    "length": lambda r, value: unit_beside_floor(r, value).text(value),
    "may_be_chance": lambda r: r.left.ratio_to_floor > 1.0 and r.left.may_be_chance,
    "metres": numbers.format_length,
    "model_of": _model_of,
    "name_of": name_of,
    "spread": numbers.format_spread,
    "vars": vars,
    "words_of": words_of,
}
_SENTENCES = TEMPLATES.get_template("sentences.txt")
