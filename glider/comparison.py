"""Compares two saved reports: a table of their numbers and of what changed.

A number θ with standard errors s₁, s₂ in two independent campaigns has changed by
θ₂ - θ₁ ± √(s₁² + s₂²). With n numbers compared, one change counts where it is beyond
what the largest of n standard normal ones exceeds in one comparison of a hundred.

An effect that one report lacks counts as none there. Its evidence is below the
threshold T of an effect, and evidence is about (θ/s)²/2, so that s√(2T) is its standard
error, by that of the other report. One that was not tried there does not count, nor one
for which another effect there may stand.
"""

import dataclasses
import math
from pathlib import Path

from rich.console import Console
from rich.text import Text
from scipy.special import ndtri  # scipy.stats takes 0.4 s to import.

from glider.files.schema import Number
from glider.physics.effects import KINDS
from glider.report import numbers
from glider.report.terminal import make_table, writer
from glider.report.wording import counted, name_of
from glider.sysid.result import Estimate, Report

_FALSE_ALARM = 0.01
"""Probability that any change is reported between campaigns of one glider."""

_SIZES = {
    f"{k}.{c.name}" for k in KINDS for c in KINDS[k].coefficients if not c.default
}
"""Coefficients of effects that are 0 where there is no such effect."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Difference:
    """A number in two reports."""

    name: str  #: Such as "wind.x".
    first: Estimate | None  #: In the first report; None where it has none.
    second: Estimate | None
    change: Estimate | None  #: Second less first; None where there is no such.
    z: Number  #: Change over its standard error; NaN where that is not known.


@dataclasses.dataclass(frozen=True, kw_only=True)
class Comparison:
    """All numbers of two reports side by side."""

    summary: str
    z_significant: Number  #: Threshold above which a change counts.
    differences: tuple[_Difference, ...]

    def is_significant(self, difference: _Difference) -> bool:
        """Whether a number changed by more than its standard errors allow."""
        return abs(difference.z) > self.z_significant  # False for NaN.


def compare(first: Report, second: Report) -> Comparison:
    """Compares two reports."""
    a = _values(first)
    b = _values(second)
    a |= _absent(first, second)
    b |= _absent(second, first)
    names = dict.fromkeys((*a, *b))
    differences = [_difference(name, a.get(name), b.get(name)) for name in names]
    compared = [abs(d.z) for d in differences if math.isfinite(d.z)]
    most = -float(ndtri(0.5 * _FALSE_ALARM / max(len(compared), 1)))
    changed = sum(z > most for z in compared)
    summary = f"{changed} of {counted(compared, 'value')} changed beyond {most:.1f} σ."
    for letter, report in (("A", first), ("B", second)):
        if report.verdict in ("not_trusted", "unexplained"):
            summary += (
                f" The verdict on {letter} is {name_of(report.verdict)}: its "
                "coefficients may stand for something else."
            )

    return Comparison(
        summary=summary, z_significant=most, differences=tuple(differences)
    )


def _absent(lacking: Report, having: Report) -> dict[str, Estimate]:
    """Returns the sizes that effects of one report have in another that lacks them.

    None is one that was not tried there, or for which another effect may stand.
    """
    tried = lacking.settings.get("effects")
    named = {effect.kind for effect in lacking.effects}
    alike = {
        kind for effect in lacking.effects for kind in effect.indistinguishable_from
    }
    share = math.sqrt(2.0 * lacking.evidence_threshold)
    found = {}
    for effect in having.effects:
        kind = effect.kind
        has_stand_in = not named.isdisjoint(effect.indistinguishable_from)
        was_tried = tried is None or kind in tried
        if kind in named | alike or has_stand_in or not was_tried:
            continue
        for name, known in effect.coefficients.items():
            key = f"{kind}.{name}"
            if key in _SIZES:
                found[key] = Estimate(0.0, share * known.std, known.unit)

    return found


def _difference(
    name: str, first: Estimate | None, second: Estimate | None
) -> _Difference:
    change = None
    z = math.nan
    if first and second and first.unit == second.unit:
        std = math.hypot(first.std, second.std)
        change = Estimate(second.value - first.value, std, first.unit)
        if std > 0.0:
            z = change.value / std

    return _Difference(name=name, first=first, second=second, change=change, z=z)


def _values(report: Report) -> dict[str, Estimate]:
    """Estimates of a report by name."""
    values = {}
    for effect in report.effects:
        for name, coefficient in effect.coefficients.items():
            values[f"{effect.kind}.{name}"] = coefficient

    for name, spread in report.spreads.items():
        estimate = Estimate(spread.std, spread.std_error, spread.unit)
        values[f"{name}, from flight to flight"] = estimate

    for name, estimate in report.vehicle.items():
        values[f"vehicle.{name}"] = estimate

    return values


def print_comparison(
    comparison: Comparison,
    first: tuple[Report, Path],
    second: tuple[Report, Path],
    console: Console,
) -> None:
    """Prints a table of all numbers side by side, below the reports and their files."""
    write = writer(console)
    for letter, (report, file) in (("A", first), ("B", second)):
        flights = counted(report.flights.fit, "fitted flight")
        write(f"{letter}: {file.parent}, campaign {report.campaign}, {flights}")

    write(comparison.summary, "bold")
    write()
    table = make_table("", "A", "B", "change", "σ", "")
    for difference in comparison.differences:
        cells = _cells(difference)
        style = ""
        if comparison.is_significant(difference):
            cells[-1] = "*"
            style = "bold"

        table.add_row(*(Text(cell, style) for cell in cells))

    console.print(table)
    write(
        "σ: change divided by its standard error; * marks what chance cannot explain. "
        "An effect that a report lacks counts as 0 there, ± the largest that is missed."
    )


def _cells(difference: _Difference) -> list[str]:
    """Name, both numbers, their change, that over its standard error, and a mark."""
    known = difference.first or difference.second
    unit = known.unit if known else ""
    name = name_of(difference.name)
    if unit not in ("", "-"):
        name = f"{name} [{unit}]"
    change, _, _ = _without_unit(difference.change).partition(" ±")
    if difference.change and not change.startswith("-"):
        change = f"+{change}"
    z = difference.z
    sigmas = f"{z:+,.1f}" if math.isfinite(z) else numbers.MISSING
    first = _without_unit(difference.first)
    return [name, first, _without_unit(difference.second), change, sigmas, ""]


def _without_unit(estimate: Estimate | None) -> str:
    if estimate is None:
        return numbers.MISSING
    return numbers.format_estimate(dataclasses.replace(estimate, unit=""))
