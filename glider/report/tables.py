"""Tables of a report beside that of errors, as text."""

import dataclasses
import math

from glider.report.numbers import (
    MISSING,
    format_estimate,
    format_evidence,
    format_spread,
    in_degrees,
)
from glider.report.wording import words_of
from glider.sysid.result import Result

_MOST_PAIRS = 8
_WORTH_TELLING = 0.5
"""Least |correlation| of a pair that is shown."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class CombinationRow:
    """A set of effects that was fitted in full."""

    words: list[str]
    evidence: str
    behind: str
    """Evidence less than the best set's [nats], empty for the best."""

    is_chosen: bool


def combination_rows(result: Result) -> list[CombinationRow]:
    """Returns the best sets of effects that were fitted."""
    tried = {kind for c in result.combinations for kind in c.kinds}
    chosen = tried & {e.kind for e in result.effects}  # A wrong sign is in no set.
    best = result.combinations[0].evidence if result.combinations else math.nan
    return [
        CombinationRow(
            words=[words_of(k, result) for k in c.kinds],
            evidence=format_evidence(c.evidence),
            behind=format_evidence(c.evidence - best) if i else "",
            is_chosen=set(c.kinds) == chosen,
        )
        for i, c in enumerate(result.combinations)
    ]


def correlation_rows(result: Result) -> list[tuple[str, str, str]]:
    """Returns pairs of coefficients whose errors go together, the closest first."""
    pairs = {
        tuple(sorted((a, b))): value
        for a, row in result.correlations.items()
        for b, value in row.items()
        if a != b and abs(value) >= _WORTH_TELLING  # False for NaN.
    }
    ranked = sorted(pairs.items(), key=lambda pair: -abs(pair[1]))
    return [(a, b, f"{value:+.2f}") for (a, b), value in ranked[:_MOST_PAIRS]]


def vehicle_rows(result: Result) -> list[tuple[str, str]]:
    """Returns what the flights tell of the vehicle itself."""
    return [
        (name.replace("_", " "), format_estimate(c) + in_degrees(c))
        for name, c in result.vehicle.items()
    ]


def spread_rows(result: Result) -> list[tuple[str, str, str]]:
    """Returns what differs from flight to flight, how much, and where most."""
    rows = []
    for name, spread in result.spreads.items():
        known = {f: v for f, v in spread.values.items() if math.isfinite(v)}
        most = max(known, key=lambda f: abs(known[f]), default="")
        there = (
            f"{most}: {format_spread(known[most], spread.unit)}" if most else MISSING
        )
        rows.append(
            (name.replace("_", " "), format_spread(spread.std, spread.unit), there)
        )
    return rows


def spread_values(result: Result) -> list[tuple[str, list[str]]]:
    """Returns each fitted flight's own values, in the order of the spreads."""
    flights = dict.fromkeys(f for s in result.spreads.values() for f in s.values)
    return [
        (
            flight,
            [
                format_spread(s.values.get(flight, math.nan), s.unit)
                for s in result.spreads.values()
            ],
        )
        for flight in flights
    ]
