"""A comparison as text: for people in rows, tables and sentences, for programs as JSON.

The page has the same rows.
"""

import dataclasses
import itertools
import math
from collections.abc import Callable
from typing import Any, NamedTuple

from rich.console import Console
from rich.table import Table
from rich.text import Text

from glider.comparison.differences import EFFECTS, Comparison, SavedReport
from glider.files.schema import json_text, to_builtins
from glider.report import numbers
from glider.report.error_table import ALONG, END, FREE, PITCH, columns_of, error_of
from glider.report.plots.style import LABELS
from glider.report.terminal import for_console, make_table, writer
from glider.report.wording import counted, name_of, say
from glider.sysid.report import Estimate

_ERRORS = {
    FREE: "free rollout, position",
    END: "free rollout, position at the end",
    PITCH: "free rollout, pitch",
    ALONG: "along measured pitch, position",
}
"""Field of `Errors` to its name for people."""


def headline(comparison: Comparison) -> str:
    """What changed, in a few sentences."""
    compared = [d for d in comparison.differences if math.isfinite(d.z)]
    changed = [
        f"{d.label} by {signed(d.change)} ({_sigmas(abs(d.z))} σ)"
        for d in sorted(compared, key=lambda d: -abs(d.z))
        if comparison.is_significant(d) and d.change
    ]
    agreeing = len(compared) - len(changed)
    return " ".join(say("changes", comparison, changed, agreeing))


def _sigmas(z: float, sign: str = "-") -> str:
    return f"{z:{sign},.0f}" if abs(z) >= 100.0 else f"{z:{sign}.1f}"


def signed(estimate: Estimate) -> str:
    """Returns "+0.012 ± 0.002 m/s"."""
    text = numbers.format_estimate(estimate)
    return text if text.startswith(("-", "(-", numbers.MISSING)) else f"+{text}"


class Row(NamedTuple):
    """A number in two reports, as text, under a heading; `kind` is a shorter one."""

    heading: str
    kind: str
    name: str
    unit: str
    first: str
    second: str
    change: str
    z: str
    changed: bool
    note: str


def rows(comparison: Comparison) -> list[Row]:
    """All values that either report has."""
    return [
        Row(
            heading=d.words if d.group == EFFECTS else d.group,
            kind=d.kind if d.group == EFFECTS else d.group,
            name=name_of(d.name or d.kind),
            unit="" if d.unit == "-" else d.unit,
            first=_plain(d.first),
            second=_plain(d.second),
            change=_plain(d.change, signed),
            z=_sigmas(d.z, "+") if math.isfinite(d.z) else numbers.MISSING,
            changed=comparison.is_significant(d),
            note=d.note,
        )
        for d in comparison.differences
    ]


def _plain(
    estimate: Estimate | None,
    write: Callable[[Estimate], str] = numbers.format_estimate,
) -> str:
    if estimate is None:
        return numbers.MISSING
    return write(dataclasses.replace(estimate, unit=""))


def error_rows(comparison: Comparison) -> list[tuple[str, ...]]:
    """Errors on held-out flights, of each model in both reports.

    Name, model, unit, error in A and in B, and their ratio: all of it text.
    """
    found = []
    models = columns_of(*comparison.reports)
    for error, model in itertools.product(_ERRORS, models):
        values = [error_of(report, model, error) for report in comparison.reports]
        unit = unit_of(comparison, error, *values)
        names = _ERRORS[error], LABELS[model], unit.name
        digits = map(unit.digits, values)
        found.append((*names, *digits, numbers.format_gain(*values)))
    return found


def unit_of(comparison: Comparison, error: str, *values: float) -> numbers.Unit:
    """The unit in which an error of both reports reads best."""
    if error.endswith("_rad"):
        return numbers.DEGREE
    noises = (report.noise.position_m for report in comparison.reports)
    return numbers.length_unit(*(v for v in (*values, *noises) if math.isfinite(v)))


def facts(comparison: Comparison) -> list[tuple[str, str, str]]:
    """Further facts by name, of both reports."""
    first, second = map(_facts, comparison.reports)
    return [(name, first[name], second[name]) for name in first]


def _facts(report: SavedReport) -> dict[str, str]:
    air = numbers.MISSING
    if math.isfinite(report.air.std_m_s):
        air = f"{report.air.std_m_s:.2g} m/s" if report.air.std_m_s else "still"
    fit, held_out = len(report.flights.fit), len(report.flights.held_out)
    position = numbers.format_length(report.noise.position_m)
    return {
        "verdict": name_of(report.verdict),
        "flights": f"{fit} + {held_out} held out",
        "noise": f"{position}, {numbers.format_angle(report.noise.pitch_rad)}",
        "turbulence σ": air,
    }


def print_comparison(comparison: Comparison, console: Console) -> None:
    """Prints what changed, the values side by side, and the errors."""
    write = writer(console)
    a, b = (
        f"{r.campaign} ({counted(r.flights.fit, 'fitted flight')})"
        for r in comparison.reports
    )
    write(f"A: {a}; B: {b}")
    write(headline(comparison), "bold")
    for note in comparison.notes:
        write(f"Note: {note}")
    write()
    console.print(_differences(comparison, console))
    for row in rows(comparison):
        if row.note:
            write(f"{row.kind}, {row.name}: {row.note}.")
    write(
        "σ: change divided by its standard error; * marks changes beyond "
        f"{comparison.z_significant:.1f} σ, more than chance explains."
    )
    write()
    console.print(_errors(comparison, console))
    write()
    for name, first, second in facts(comparison):
        write(f"{name}: {first} in A, {second} in B")


def _differences(comparison: Comparison, console: Console) -> Table:
    table = make_table(console, "", "A", "B", "change", "σ", "")
    for kind, group in itertools.groupby(rows(comparison), lambda row: row.kind):
        _add_row(table, console, "bold", kind)
        for row in group:
            unit = f" [{row.unit}]" if row.unit else ""
            change, mark = row.change.partition(" ±")[0], "*" if row.changed else ""
            cells = f"  {row.name}{unit}", row.first, row.second, change, row.z, mark
            _add_row(table, console, "bold" if row.changed else "", *cells)
    return table


def _errors(comparison: Comparison, console: Console) -> Table:
    table = make_table(console, "Errors on held-out flights", "", "A", "B", "A over B")
    for name, group in itertools.groupby(error_rows(comparison), lambda row: row[0]):
        _add_row(table, console, "bold", name)
        for _, model, unit, *cells in group:
            _add_row(table, console, "", f"  {model}", f"[{unit}]", *cells)
    return table


def _add_row(table: Table, console: Console, style: str, *cells: str) -> None:
    table.add_row(*(Text(for_console(cell, console), style) for cell in cells))


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
    return None if estimate is None else {"value": estimate.value, "std": estimate.std}
