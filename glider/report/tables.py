"""Tables of a report beside that of errors, as text."""

import math
from typing import NamedTuple

from glider.report import numbers
from glider.report.wording import name_of, words_of
from glider.sysid.result import Result

_MOST_PAIRS = 8
_WORTH_SHOWING = 0.5
"""Least |correlation| of a pair that is shown."""


class CombinationRow(NamedTuple):
    """A set of effects; `behind` is its evidence less that of the best set."""

    words: list[str]
    evidence: str
    behind: str
    is_chosen: bool


def combination_rows(result: Result) -> list[CombinationRow]:
    """The best sets of effects that were fitted."""
    tried = {kind for c in result.combinations for kind in c.kinds}
    # A wrong sign is in no set; a variation over flights alone has no evidence.
    effects = {e.kind for e in result.effects if not math.isnan(e.evidence)}
    chosen = tried & effects
    best = result.combinations[0].evidence if result.combinations else math.nan
    return [
        CombinationRow(
            words_of(result, c.kinds),
            numbers.format_evidence(c.evidence),
            numbers.format_evidence(c.evidence - best) if i else "",
            set(c.kinds) == chosen,
        )
        for i, c in enumerate(result.combinations)
    ]


def correlation_rows(result: Result) -> list[tuple[str, str, str]]:
    """Pairs of coefficients with correlated errors, the closest first."""
    pairs = {
        tuple(sorted((a, b))): value
        for a, row in result.correlations.items()
        for b, value in row.items()
        if a != b and abs(value) >= _WORTH_SHOWING  # False for NaN.
    }
    ranked = sorted(pairs.items(), key=lambda pair: -abs(pair[1]))
    return [(a, b, f"{value:+.2f}") for (a, b), value in ranked[:_MOST_PAIRS]]


def vehicle_rows(result: Result) -> list[tuple[str, str]]:
    """Estimated parameters of the vehicle."""
    return [
        (name_of(name), numbers.format_estimate(c) + numbers.in_degrees(c))
        for name, c in result.vehicle.items()
    ]


def spread_rows(result: Result) -> list[tuple[str, str, str]]:
    """Flight-to-flight variations: name, standard deviation, the largest value."""
    rows = []
    for name, spread in result.spreads.items():
        known = {f: v for f, v in spread.values.items() if math.isfinite(v)}
        most = max(known, key=lambda f: abs(known[f]), default=None)
        largest = numbers.MISSING
        if most is not None:
            largest = f"{most}: {numbers.format_spread(known[most], spread.unit)}"
        rows.append(
            (name_of(name), numbers.format_spread(spread.std, spread.unit), largest)
        )
    return rows


def spread_values(result: Result) -> list[tuple[str, list[str]]]:
    """Values of each fitted flight, in the order of the variations."""
    spreads = result.spreads.values()
    flights = dict.fromkeys(flight for s in spreads for flight in s.values)
    return [
        (f, [numbers.format_spread(s.values.get(f, math.nan), s.unit) for s in spreads])
        for f in flights
    ]
