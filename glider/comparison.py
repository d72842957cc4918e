"""Compares two saved reports: what differs, and whether by more than errors allow.

A number θ with standard errors s₁, s₂ in two independent campaigns has changed by
θ₂ - θ₁ ± √(s₁² + s₂²). With n numbers compared, one change counts where it is beyond
what the largest of n standard normal ones exceeds in one comparison of a hundred.
"""

import contextlib
import dataclasses
import itertools
import math
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.text import Text
from scipy.special import ndtri  # scipy.stats takes 0.4 s to import.

from glider.errors import InputError
from glider.files.schema import json_text, read_text, to_builtins
from glider.physics.effects import KINDS
from glider.physics.model import parse_model
from glider.physics.parameters import GliderParameters
from glider.report import numbers
from glider.report.terminal import for_console, make_table, writer
from glider.report.wording import counted, join, name_of, say
from glider.sysid.report import Estimate, Report, Spread, read_report

FALSE_ALARM = 0.01
"""Probability that any change is reported between campaigns of one glider."""

_EFFECTS = "effects"
_GROUPS = (_EFFECTS, "from flight to flight", "vehicle")


@dataclasses.dataclass(frozen=True, kw_only=True)
class _SavedReport(Report):
    """A report as it was saved."""

    path: Path  #: Of its report.json.
    given: GliderParameters | None  #: Specified ones, where a model.yaml has them.


def load_report(path: Path) -> _SavedReport:
    """Reads a report: its folder, or its report.json.

    Raises:
        InputError: it is no report, or one of another version.
    """
    report, file = read_report(path)
    given = None
    model = file.with_name("model.yaml")
    if not report.vehicle and model.exists():
        # With user effects it cannot be read: they compare without it.
        with contextlib.suppress(InputError):
            text = read_text(model, "a glider model")
            given = parse_model(text, str(model))[0].parameters
    return _SavedReport(**vars(report), path=file, given=given)


@dataclasses.dataclass(frozen=True)
class _Difference:
    """A number in two reports."""

    group: str  #: "effects", "from flight to flight" or "vehicle".
    kind: str  #: Of an effect; otherwise the name of the number.
    name: str  #: Of the coefficient of an effect; otherwise empty.
    first: Estimate | None  #: In the first report, None where it has none.
    second: Estimate | None
    note: str  #: What else to know, or nothing.

    @property
    def unit(self) -> str:
        """Unit of all its numbers."""
        [unit, *_] = self.units
        return unit

    @property
    def units(self) -> list[str]:
        """Units in the reports that have the number."""
        return [e.unit for e in (self.first, self.second) if e is not None]

    @property
    def change(self) -> Estimate | None:
        """Second less first with its standard error; None where one is missing."""
        if self.first is None or self.second is None or len(set(self.units)) > 1:
            return None
        std = math.hypot(self.first.std, self.second.std)
        return Estimate(self.second.value - self.first.value, std, self.unit)

    @property
    def z(self) -> float:
        """Change over its standard error; NaN where that is not known."""
        change = self.change
        return change.value / change.std if change and change.std > 0.0 else math.nan

    @property
    def words(self) -> str:
        """Label of an effect kind, or its name if user-defined."""
        if self.kind in KINDS:
            return KINDS[self.kind].words
        return name_of(self.kind)

    @property
    def label(self) -> str:
        """Name in the style of report.json: "wind.x"."""
        if self.name:
            return f"{self.kind}.{self.name}"
        return self.kind


@dataclasses.dataclass(frozen=True, kw_only=True)
class Comparison:
    """Two reports and what differs between them."""

    first: _SavedReport
    second: _SavedReport
    differences: tuple[_Difference, ...]  #: Of all numbers that either has.
    z_significant: float  #: Threshold above which a change counts.
    notes: tuple[str, ...]  #: On how far the two may be compared.

    @property
    def lacks_effects(self) -> bool:
        """Whether one report has an effect that the other lacks."""
        effects = [d for d in self.differences if d.group == _EFFECTS]
        return any(d.first is None or d.second is None for d in effects)

    def is_significant(self, difference: _Difference) -> bool:
        """Whether a number changed by more than its standard errors allow."""
        return abs(difference.z) > self.z_significant  # False for NaN.


def compare(first: _SavedReport, second: _SavedReport) -> Comparison:
    """Compares two reports."""
    a = _values(first)
    b = _values(second)
    keys = sorted(dict.fromkeys((*a, *b)), key=lambda key: _GROUPS.index(key[0]))
    kinds = list(dict.fromkeys(key[:2] for key in keys))
    differences = []
    for key in sorted(keys, key=lambda key: kinds.index(key[:2])):
        note = _absence(key[1], first, second) if key[0] == _EFFECTS else ""
        found = _Difference(*key, a.get(key), b.get(key), note)
        if len(set(found.units)) > 1:
            note = f"units differ: {' and '.join(found.units)}"
            found = dataclasses.replace(found, note=note)
        differences.append(found)
    count = sum(math.isfinite(d.z) for d in differences)
    return Comparison(
        first=first,
        second=second,
        differences=tuple(differences),
        z_significant=-float(ndtri(0.5 * FALSE_ALARM / max(count, 1))),
        notes=tuple(say("notes", first, second)),
    )


def _values(report: Report) -> dict[tuple[str, str, str], Estimate]:
    """Estimates of a report by group, kind and name."""
    effects, spreads, vehicle = _GROUPS
    values = {}
    for effect in report.effects:
        for name, coefficient in effect.coefficients.items():
            values[effects, effect.kind, name] = coefficient
    for name, spread in report.spreads.items():
        values[spreads, name, ""] = _spread(spread)
    for name, estimate in report.vehicle.items():
        values[vehicle, name, ""] = estimate
    return values


def _spread(spread: Spread) -> Estimate:
    """A standard deviation with its own standard error, s / √(2 (n - 1))."""
    count = sum(math.isfinite(v) for v in spread.values.values())
    std = spread.std / math.sqrt(2.0 * (count - 1)) if count > 1 else math.nan
    return Estimate(spread.std, std, spread.unit)


def _absence(kind: str, first: Report, second: Report) -> str:
    """A note on an effect of one report that the other lacks."""
    effects = {e.kind: e for e in first.effects}
    if kind not in effects:
        return _absence(kind, second, first)
    others = [e.kind for e in second.effects]
    if kind in others:
        return ""
    rivals = effects[kind].indistinguishable_from
    if instead := [other for other in others if other in rivals]:
        return f"may be its {join(instead, ' or ')}: indistinguishable on these flights"
    return "" if kind in second.candidates else "not tried there"


def headline(comparison: Comparison) -> str:
    """Returns what changed, in a few sentences."""
    compared = [d for d in comparison.differences if math.isfinite(d.z)]
    compared.sort(key=lambda difference: -abs(difference.z))
    changed = [
        f"{d.label} by {_signed(d.change)} ({_sigmas(abs(d.z))} σ)"
        for d in compared
        if comparison.is_significant(d) and d.change
    ]
    agreeing = len(compared) - len(changed)
    return " ".join(say("changes", comparison, changed, agreeing))


def _sigmas(z: float, sign: str = "-") -> str:
    digits = 0 if abs(z) >= 100.0 else 1
    return f"{z:{sign},.{digits}f}"


def _signed(estimate: Estimate) -> str:
    """Returns "+0.012 ± 0.002 m/s"."""
    text = numbers.format_estimate(estimate)
    if text.startswith(("-", "(-", numbers.MISSING)):
        return text
    return f"+{text}"


def print_comparison(comparison: Comparison, console: Console) -> None:
    """Prints what changed, and a table of all numbers side by side."""
    write = writer(console)
    first, second = (
        f"{report.campaign} ({counted(report.flights.fit, 'fitted flight')})"
        for report in (comparison.first, comparison.second)
    )
    write(f"A: {first}; B: {second}")
    write(headline(comparison), "bold")
    for note in comparison.notes:
        write(f"Note: {note}")
    write()
    table = make_table(console, "", "A", "B", "change", "σ", "")

    def add_row(style: str, *cells: str) -> None:
        table.add_row(*(Text(for_console(cell, console), style) for cell in cells))

    for heading, group in itertools.groupby(comparison.differences, _heading):
        add_row("bold", heading)
        for difference in group:
            is_changed = comparison.is_significant(difference)
            add_row("bold" if is_changed else "", *_cells(difference, is_changed))
    console.print(table)
    for difference in comparison.differences:
        if difference.note:
            name = name_of(difference.name or difference.kind)
            write(f"{_heading(difference)}, {name}: {difference.note}.")
    write(
        "σ: change divided by its standard error; * marks changes beyond "
        f"{comparison.z_significant:.1f} σ, more than chance explains."
    )


def _heading(difference: _Difference) -> str:
    if difference.group == _EFFECTS:
        return difference.kind
    return difference.group


def _cells(difference: _Difference, is_changed: bool) -> list[str]:
    name = name_of(difference.name or difference.kind)
    unit = "" if difference.unit == "-" else f" [{difference.unit}]"
    cells = [f"  {name}{unit}"]
    for estimate in (difference.first, difference.second):
        if estimate is None:
            cells.append(numbers.MISSING)
        else:
            plain = dataclasses.replace(estimate, unit="")
            cells.append(numbers.format_estimate(plain))
    change = numbers.MISSING
    if difference.change:
        text = _signed(dataclasses.replace(difference.change, unit=""))
        change = text.partition(" ±")[0]
    sigmas = numbers.MISSING
    if math.isfinite(difference.z):
        sigmas = _sigmas(difference.z, "+")
    return [*cells, change, sigmas, "*" if is_changed else ""]


def to_json(comparison: Comparison) -> str:
    """Returns a comparison as JSON."""
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


def _report(report: _SavedReport) -> dict[str, Any]:
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
    return None if estimate is None else {"value": estimate.value, "std": estimate.std}
