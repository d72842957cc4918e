"""Words and rows of a comparison, for the terminal and the page."""

import dataclasses
import itertools
import math
from collections.abc import Callable
from typing import NamedTuple

from glider.comparison.differences import EFFECTS, Comparison
from glider.comparison.saved import SavedReport
from glider.report import numbers
from glider.report.error_table import ALONG, END, FREE, PITCH, error_of
from glider.report.plots.style import LABELS
from glider.report.wording import counted, name_of, say
from glider.sysid.result import Estimate

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


class ErrorRow(NamedTuple):
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
    """Errors on held-out flights, of each model in both reports."""
    found = []
    for (error, name), model in itertools.product(
        _ERRORS.items(), models_of(comparison)
    ):
        values = error_values(comparison, error, model)
        unit = unit_of(comparison, error, *values)
        first, second = map(unit.digits, values)
        gain = numbers.format_gain(*values)
        found.append(ErrorRow(name, LABELS[model], unit.name, first, second, gain))
    return found


def unit_of(comparison: Comparison, error: str, *values: float) -> numbers.Unit:
    """The unit in which an error of both reports reads best."""
    if error.endswith("_rad"):
        return numbers.DEGREE
    noises = (comparison.first.noise.position_m, comparison.second.noise.position_m)
    return numbers.length_unit(*(v for v in (*values, *noises) if math.isfinite(v)))


def facts(comparison: Comparison) -> list[tuple[str, str, str]]:
    """Further facts by name, of both reports."""
    both = map(_facts, (comparison.first, comparison.second))
    return [(name, one, other) for (name, one), (_, other) in zip(*both, strict=True)]


def _facts(report: SavedReport) -> list[tuple[str, str]]:
    air = numbers.MISSING
    if math.isfinite(report.air.std_m_s):
        air = f"{report.air.std_m_s:.2g} m/s" if report.air.std_m_s else "still"
    fit, held_out = len(report.flights.fit), len(report.flights.held_out)
    position = numbers.format_length(report.noise.position_m)
    pitch = numbers.format_angle(report.noise.pitch_rad)
    return [
        ("verdict", name_of(report.verdict)),
        ("flights", f"{fit} + {held_out} held out"),
        ("noise", f"{position}, {pitch}"),
        ("turbulence σ", air),
    ]


def title(comparison: Comparison) -> str:
    """The two campaigns that are compared."""
    a, b = comparison.first, comparison.second
    flights = [counted(r.flights.fit, "fitted flight") for r in (a, b)]
    return f"A: {a.campaign} ({flights[0]}); B: {b.campaign} ({flights[1]})"
