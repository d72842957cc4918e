"""Words and rows of a comparison, for the terminal and the page alike."""

import dataclasses
import math

from glider.comparison.differences import EFFECTS, Comparison, Difference, words_of_kind
from glider.comparison.saved import SavedReport
from glider.report.error_table import ALONG, END, FREE, PITCH, error_of
from glider.report.numbers import (
    DEGREE,
    MISSING,
    Unit,
    format_angle,
    format_estimate,
    format_gain,
    format_length,
    length_unit,
)
from glider.report.plots.style import LABELS
from glider.report.wording import counted, join
from glider.sysid.result import Estimate

_ERRORS = {
    FREE: "free rollout, position",
    END: "free rollout, position at the end",
    PITCH: "free rollout, pitch",
    ALONG: "along measured pitch, position",
}
"""Field of `Errors` to its name for people."""


def headline(comparison: Comparison) -> str:
    """Returns what changed, in a few sentences."""
    compared = [d for d in comparison.differences if math.isfinite(d.z)]
    changed = [d for d in compared if comparison.is_significant(d)]
    changed.sort(key=lambda d: -abs(d.z))
    said = []
    if changed:
        said.append(f"Changed: {join([_change(d) for d in changed], '; ', '; ')}.")
    for name, missing in (("A", "second"), ("B", "first")):
        kinds = dict.fromkeys(
            words_of_kind(d.kind)
            for d in comparison.differences
            if d.group == EFFECTS and getattr(d, missing) is None
        )
        if kinds:
            said.append(f"Only {name} shows {join(kinds, '; and ', '; ')}.")
    rest = len(compared) - len(changed)
    if rest:
        numbers = "1 number agrees" if rest == 1 else f"{rest} numbers agree"
        agree = f"{numbers} within {comparison.z_significant:.1f} σ."
        said.append(agree if said else f"No significant change: {agree}")
    return " ".join(said) or "Neither report has a number to compare."


def _change(d: Difference) -> str:
    assert d.change is not None
    return f"{d.label} by {signed(d.change)} ({_sigmas(abs(d.z))} σ)"


def _sigmas(z: float) -> str:
    return f"{z:,.0f}" if abs(z) >= 100.0 else f"{z:.1f}"


def signed(estimate: Estimate) -> str:
    """Returns "+0.012 ± 0.002 m/s"."""
    text = format_estimate(estimate)
    return text if text.startswith(("-", "(-", MISSING)) else f"+{text}"


@dataclasses.dataclass(frozen=True, kw_only=True)
class Row:
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
    """Returns all numbers that either report has."""
    return [
        Row(
            heading=words_of_kind(d.kind) if d.group == EFFECTS else d.group,
            kind=d.kind if d.group == EFFECTS else d.group,
            name=(d.name or d.kind).replace("_", " "),
            unit="" if d.unit == "-" else d.unit,
            first=_plain(d.first),
            second=_plain(d.second),
            change=MISSING
            if d.change is None
            else signed(dataclasses.replace(d.change, unit="")),
            z=("+" if d.z > 0.0 else "") + _sigmas(d.z)
            if math.isfinite(d.z)
            else MISSING,
            changed=comparison.is_significant(d),
            note=d.note,
        )
        for d in comparison.differences
    ]


def _plain(estimate: Estimate | None) -> str:
    if estimate is None:
        return MISSING
    return format_estimate(dataclasses.replace(estimate, unit=""))


@dataclasses.dataclass(frozen=True, kw_only=True)
class ErrorRow:
    """An error of a model in two reports, as text in one unit."""

    name: str
    model: str
    unit: str
    first: str
    second: str
    gain: str


def error_values(comparison: Comparison, error: str, model: str) -> tuple[float, float]:
    """An error of a model in both reports [SI]; NaN where it has none."""
    first, second = comparison.first, comparison.second
    return error_of(first, model, error), error_of(second, model, error)


def models_of(comparison: Comparison) -> list[str]:
    """Models of which either report has errors."""
    reports = comparison.first, comparison.second
    return [m for m in LABELS if any(r.errors.get(m) is not None for r in reports)]


def error_rows(comparison: Comparison) -> list[ErrorRow]:
    """Returns errors on held-out flights, of each model in both reports."""
    found = []
    for error, name in _ERRORS.items():
        for model in models_of(comparison):
            values = error_values(comparison, error, model)
            unit = unit_of(comparison, error, *values)
            found.append(
                ErrorRow(
                    name=name,
                    model=LABELS[model],
                    unit=unit.name,
                    first=unit.digits(values[0]),
                    second=unit.digits(values[1]),
                    gain=format_gain(*values),
                )
            )
    return found


def unit_of(comparison: Comparison, error: str, *values: float) -> Unit:
    """Returns the unit in which an error of both reports reads best."""
    if error.endswith("_rad"):
        return DEGREE
    noises = (comparison.first.noise.position_m, comparison.second.noise.position_m)
    return length_unit(*(v for v in (*values, *noises) if math.isfinite(v)))


def facts(report: SavedReport) -> list[tuple[str, str]]:
    """Returns what else a report tells, by name."""
    air = MISSING
    if math.isfinite(report.air.std_m_s):
        air = f"{report.air.std_m_s:.2g} m/s" if report.air.std_m_s else "still"
    return [
        ("verdict", report.verdict.replace("_", " ")),
        (
            "flights",
            f"{len(report.flights.fit)} + {len(report.flights.held_out)} held out",
        ),
        (
            "noise",
            f"{format_length(report.noise.position_m)}, "
            f"{format_angle(report.noise.pitch_rad)}",
        ),
        ("moving air", air),
    ]


def title(comparison: Comparison) -> str:
    """Returns what is compared with what."""
    a, b = comparison.first, comparison.second
    flights = [counted(r.flights.fit, "fitted flight") for r in (a, b)]
    return f"A: {a.campaign} ({flights[0]}); B: {b.campaign} ({flights[1]})"
