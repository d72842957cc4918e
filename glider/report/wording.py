"""Sentences and phrases about what was found."""

import math
from collections.abc import Iterable, Sized
from typing import Any

from glider.campaign.checks.masks import ExcludedRows
from glider.physics.effects import KINDS
from glider.report.error_table import baseline, unit_beside_noise
from glider.report.numbers import (
    DIVERGED,
    format_estimate,
    format_evidence,
    format_share,
    format_spread,
    in_degrees,
)
from glider.sysid.result import CALIBRATED, LIBRARY_SHAPE, FoundEffect, Result

_MOST_COEFFICIENTS = 8
"""An effect with more of them shows the first; all are in the files."""

_MOST_IN_LINE = 2
"""Of more effects the headline leaves the coefficients to what follows it."""

_WORTH_TELLING = 0.95
"""A pitch zero that leaves a smaller share of the error than this is reported."""


def headline(result: Result) -> str:
    """Returns the verdict in one sentence."""
    if result.verdict == "no_effect":
        return _nothing_found(result)
    named = [e for e in result.effects if e.kind != "unexplained"]
    unnamed = [e for e in result.effects if e.kind == "unexplained"]
    found = [_in_line(e) if len(named) <= _MOST_IN_LINE else e.words for e in named]
    if unnamed or result.verdict in ("unexplained", "partly_explained"):
        on = [name for e in unnamed for name in e.depends_on]
        on = on or list(result.left.depends_on)
        varying = f" that varies with {join(on)}" if on else ""
        error = f"an error{varying} and that no effect of the library explains"
        found.append(error if varying else error.replace(" and that", " that"))
    if not found:
        found = [f"that {variation}" for variation in differences(result)]
    if result.verdict == "not_trusted":
        text = "Not trusted: the flights seem to show " if found else "Not trusted"
    else:
        text = "The flights show "
    change = _change(result)
    text += join(found, "; and ", "; ")
    return f"{text}; {change}." if change else f"{text}."


def _nothing_found(result: Result) -> str:
    before = baseline(result)
    model = "nominal model" if before == "nominal" else "refitted flat plate"
    text = f"The flights show no effect that the {model} lacks"
    errors = result.errors.get(before)
    if errors is None or not math.isfinite(errors.position_rms_m):
        return text + "."
    size = _length(result, errors.position_rms_m)
    return f"{text}; its position error on held-out flights is {size} (RMS)."


def remarks(result: Result) -> list[str]:
    """Sentences that qualify the headline."""
    said = []
    for e in result.effects:
        if e.indistinguishable_from:
            others = join(
                [words_of(k, result) for k in e.indistinguishable_from], " or "
            )
            said.append(f"These flights do not distinguish {e.words} from {others}.")
        if e.shape != LIBRARY_SHAPE:
            said.append(
                f"Shape not the library's ({e.kind}): the model carries a curve "
                "beside the formula."
            )
    return [*said, *filter(None, [_calibration_words(result), left_words(result)])]


def _calibration_words(result: Result) -> str:
    """Improvement by a pitch zero alone, if there is one."""
    plate, calibrated = (result.errors.get(m) for m in ("refitted", CALIBRATED))
    if plate is None or calibrated is None:
        return ""
    if not calibrated.position_rms_m < _WORTH_TELLING * plate.position_rms_m:
        return ""
    change = _from_to(result, plate.position_rms_m, calibrated.position_rms_m)
    return (
        "Removing a constant error of the pitch reading from the refitted baseline "
        f"alone changes the held-out position error {change} (RMS): this is "
        "calibration, not physics."
    )


def left_words(result: Result) -> str:
    """Returns what the corrected model leaves: a length and a ratio."""
    left = result.left
    if not math.isfinite(left.position_m):
        return ""
    model = "model" if result.verdict == "no_effect" else "corrected model"
    size = _length(result, left.position_m)
    text = f"The {model} leaves a position error of {size} (RMS) on held-out flights"
    if math.isfinite(left.ratio_to_noise):
        ratio = f"{left.ratio_to_noise:.3g}"
        if left.ratio_to_noise >= 100.0:
            ratio = f"{left.ratio_to_noise:,.0f}"
        text += f", {ratio} times the measurement noise"
    if left.depends_on:
        text += f"; it varies with {join(left.depends_on)}"
    return text + "."


def air_words(result: Result) -> str:
    """Returns how the air moves, as a sentence."""
    air = result.air
    if not math.isfinite(air.std_m_s):
        return ""
    if air.std_m_s == 0.0:
        return "The flights show no moving air."
    lasting = ""
    if math.isfinite(air.correlation_s):
        lasting = f", with a correlation time of about {air.correlation_s:.2g} s"
    return (
        f"The air moves by {air.std_m_s:.2g} m/s (one standard deviation){lasting}; "
        "model errors can look the same."
    )


def differences(result: Result) -> list[str]:
    """Flight-to-flight variation that no effect reports."""
    told = {e.kind for e in result.effects if e.spread_over_flights}
    return [
        f"{_name(n)} varies from flight to flight by {format_spread(s.std, s.unit)}"
        for n, s in result.spreads.items()
        if math.isfinite(s.std) and n not in told
    ]


def fold_words(result: Result) -> str:
    """Returns in how many folds the corrected model is the better one."""
    folds = result.folds
    if not folds:
        return ""
    better = sum(f.corrected.position_rms_m < f.refitted.position_rms_m for f in folds)
    return (
        f"With each flight held out once, free rollouts of the corrected model are "
        "closer than those of the refitted baseline in "
        f"{better} of {counted(folds, 'fold')}."
    )


def set_aside_words(s: ExcludedRows) -> str:
    """Returns which rows were not used, and why."""
    rows = "all rows" if s.rows == "all" else f"lines {s.rows}"
    return f"{s.file}, {rows}: {s.why}"


def _change(result: Result) -> str:
    before, after = (result.errors.get(m) for m in (baseline(result), "corrected"))
    if before is None or after is None:
        return ""
    old, new = before.position_rms_m, after.position_rms_m
    if not new < DIVERGED:
        return "held-out rollouts of the corrected model diverge"
    if not old < DIVERGED:
        size = _length(result, new)
        return f"held-out rollouts, which diverged, now have an error of {size} (RMS)"
    verb = "falls" if new < old else "changes"
    return f"held-out position error {verb} {_from_to(result, old, new)} (RMS)"


def _length(result: Result, value: float) -> str:
    return unit_beside_noise(result, value).text(value)


def _from_to(result: Result, old: float, new: float) -> str:
    unit = unit_beside_noise(result, old, new)
    return f"from {unit.text(old)} to {unit.text(new)}"


def effect_view(effect: FoundEffect, result: Result) -> dict[str, Any]:
    """Returns an effect as text."""
    items = list(effect.coefficients.items())
    units = {name: c.unit for name, c in items}
    return {
        "kind": effect.kind,
        "is_unexplained": effect.kind == "unexplained",
        "words": effect.words,
        "coefficients": [
            (_name(name), format_estimate(c) + in_degrees(c))
            for name, c in items[:_MOST_COEFFICIENTS]
        ],
        "more": max(len(items) - _MOST_COEFFICIENTS, 0),
        "spread": [
            (_name(name), format_spread(s, units.get(name, "")))
            for name, s in effect.spread_over_flights.items()
        ],
        "evidence": format_evidence(effect.evidence),
        "share": format_share(effect.share_of_residual),
        "inclusion": format_share(effect.inclusion),
        "shape_fits": effect.shape == LIBRARY_SHAPE,
        "confused": [
            f"{words_of(k, result)} ({k})" for k in effect.indistinguishable_from
        ],
        "depends_on": list(effect.depends_on),
    }


def _in_line(effect):
    """Returns "a steady wind: x = -0.600 ± 0.001 m/s, z = ..."."""
    texts = [
        f"{_name(name)} = {format_estimate(c)}"
        for name, c in list(effect.coefficients.items())[:3]
    ]
    texts += [
        f"{_name(name)} varies by {format_spread(s, effect.coefficients[name].unit)} "
        "from flight to flight"
        for name, s in effect.spread_over_flights.items()
        if name in effect.coefficients
    ]
    colon = ", with " if ":" in effect.words else ": "
    return effect.words + (colon if texts else "") + ", ".join(texts)


def words_of(kind: str, result: Result) -> str:
    """Returns an effect's short phrase for people."""
    kinds = {**KINDS, **{e.kind: e for e in result.own_effects}}
    return kinds[kind].words if kind in kinds else _name(kind)


def join(items: Iterable[str], last: str = " and ", between: str = ", ") -> str:
    """Returns "a, b and c", each item once."""
    once = list(dict.fromkeys(items))
    return last.join(filter(None, [between.join(once[:-1]), *once[-1:]]))


def counted(items: Sized, noun: str) -> str:
    """Returns "1 flight" or "3 flights"."""
    return f"{len(items)} {noun}{'' if len(items) == 1 else 's'}"


def notes_of(result: Result) -> list[str]:
    """Returns what was assumed, as sentences."""
    notes = result.settings.get("notes", ())
    return list(notes) if isinstance(notes, (list, tuple)) else [str(notes)]


def _name(text: str) -> str:
    return text.replace("_", " ")
