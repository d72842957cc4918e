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

from rich.console import Console
from rich.text import Text
from scipy.special import ndtri  # scipy.stats takes 0.4 s to import.

from glider.errors import InputError
from glider.files.schema import json_text, read_text
from glider.physics.effects import KINDS
from glider.physics.model import parse_model
from glider.physics.parameters import GliderParameters
from glider.report import numbers
from glider.report.terminal import for_console, make_table, writer
from glider.report.wording import counted, join, name_of, say
from glider.sysid.result import Estimate, Report, read_report

FALSE_ALARM = 0.01
"""Probability that any change is reported between campaigns of one glider."""

_EFFECTS = "effects"
_SPREADS = "from flight to flight"
_VEHICLE = "vehicle"
_GROUPS = (_EFFECTS, _SPREADS, _VEHICLE)


@dataclasses.dataclass(frozen=True, kw_only=True)
class _SavedReport(Report):
    """A report as it was saved."""

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
    return _SavedReport(**vars(report), given=given)


@dataclasses.dataclass(frozen=True)
class _Difference:
    """A number in two reports."""

    group: str  #: One of _GROUPS.
    kind: str  #: Of an effect; otherwise the name of the number.
    name: str  #: Of the coefficient of an effect; otherwise empty.
    first: Estimate | None  #: In the first report, None where it has none.
    second: Estimate | None
    note: str = ""  #: What else to know.

    @property
    def unit(self) -> str:
        """Unit of the number."""
        known = self.first or self.second
        return "" if known is None else known.unit

    @property
    def change(self) -> Estimate | None:
        """Second less first with its standard error; None where there is no such."""
        if self.first is None or self.second is None:
            return None
        if self.first.unit != self.second.unit:
            return None
        value = self.second.value - self.first.value
        std = math.hypot(self.first.std, self.second.std)
        return Estimate(value, std, self.unit)

    @property
    def z(self) -> float:
        """Change over its standard error; NaN where that is not known."""
        change = self.change
        if change is None or not change.std > 0.0:
            return math.nan
        return change.value / change.std

    @property
    def words(self) -> str:
        """Label of an effect kind, or its name if user-defined."""
        if self.kind in KINDS:
            return KINDS[self.kind].words
        return name_of(self.kind)

    @property
    def label(self) -> str:
        """Name in the style of report.json: "wind.x"."""
        return f"{self.kind}.{self.name}".rstrip(".")

    @property
    def heading(self) -> str:
        """What it is listed under: its effect, or its group."""
        return self.kind if self.group == _EFFECTS else self.group

    @property
    def short(self) -> str:
        """Its name under the heading."""
        return name_of(self.name or self.kind)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Comparison:
    """What differs between two reports."""

    first: Report
    second: Report
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
    keys = list(dict.fromkeys((*a, *b)))
    kinds = list(dict.fromkeys(key[:2] for key in keys))
    keys.sort(key=lambda key: (_GROUPS.index(key[0]), kinds.index(key[:2])))
    differences = []
    for key in keys:
        one = a.get(key)
        other = b.get(key)
        note = ""
        if one and other and one.unit != other.unit:
            note = f"units differ: {one.unit} and {other.unit}"
        elif key[0] == _EFFECTS:
            note = _absence(key[1], first, second)
        differences.append(_Difference(*key, one, other, note))
    count = sum(math.isfinite(d.z) for d in differences)
    return Comparison(
        first=first,
        second=second,
        differences=tuple(differences),
        z_significant=-float(ndtri(0.5 * FALSE_ALARM / max(count, 1))),
        notes=tuple(say("notes", first, second)),
    )


def _values(report: Report) -> dict[tuple[str, str, str], Estimate]:
    """Estimates of a report by group, kind and name.

    A standard deviation over n flights has its own standard error, s / √(2 (n - 1)).
    """
    values = {}
    for effect in report.effects:
        for name, coefficient in effect.coefficients.items():
            values[_EFFECTS, effect.kind, name] = coefficient
    for name, spread in report.spreads.items():
        count = sum(math.isfinite(v) for v in spread.values.values())
        error = spread.std / math.sqrt(2.0 * (count - 1)) if count > 1 else math.nan
        values[_SPREADS, name, ""] = Estimate(spread.std, error, spread.unit)
    for name, estimate in report.vehicle.items():
        values[_VEHICLE, name, ""] = estimate
    return values


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
    changed = []
    for d in compared:
        if d.change and comparison.is_significant(d):
            changed.append(f"{d.label} by {_signed(d.change)} ({abs(d.z):,.1f} σ)")
    agreeing = len(compared) - len(changed)
    return " ".join(say("changes", comparison, changed, agreeing))


def _signed(estimate: Estimate) -> str:
    """Returns "+0.012 ± 0.002 m/s"."""
    text = numbers.format_estimate(estimate)
    has_sign = text.startswith(("-", "(-", numbers.MISSING))
    return text if has_sign else f"+{text}"


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

    groups = itertools.groupby(comparison.differences, lambda d: d.heading)
    for heading, group in groups:
        add_row("bold", heading)
        for difference in group:
            cells = _cells(difference)
            if comparison.is_significant(difference):
                add_row("bold", *cells, "*")
            else:
                add_row("", *cells, "")
    console.print(table)
    for difference in comparison.differences:
        if difference.note:
            write(f"{difference.heading}, {difference.short}: {difference.note}.")
    write(
        "σ: change divided by its standard error; * marks changes beyond "
        f"{comparison.z_significant:.1f} σ, more than chance explains."
    )


def _cells(difference: _Difference) -> list[str]:
    """Name, both numbers, their change, and that over its standard error."""
    unit = "" if difference.unit == "-" else f" [{difference.unit}]"
    cells = [f"  {difference.short}{unit}"]
    for estimate in (difference.first, difference.second):
        cell = numbers.MISSING
        if estimate is not None:
            plain = dataclasses.replace(estimate, unit="")
            cell = numbers.format_estimate(plain)
        cells.append(cell)
    change = numbers.MISSING
    if difference.change:
        plain = dataclasses.replace(difference.change, unit="")
        change = _signed(plain).partition(" ±")[0]
    sigmas = numbers.MISSING
    if math.isfinite(difference.z):
        sigmas = f"{difference.z:+,.1f}"
    return [*cells, change, sigmas]


def to_json(comparison: Comparison) -> str:
    """Returns a comparison as JSON."""
    differences = []
    for d in comparison.differences:
        found = {
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
        differences.append(found)
    return json_text(
        {
            "summary": headline(comparison),
            "z_significant": comparison.z_significant,
            "differences": differences,
            "notes": comparison.notes,
        }
    )


def _estimate(estimate: Estimate | None) -> dict[str, float] | None:
    return None if estimate is None else {"value": estimate.value, "std": estimate.std}
