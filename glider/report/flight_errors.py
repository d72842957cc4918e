"""Errors of single held-out flights, and those that stand out."""

import math
from typing import NamedTuple

import numpy as np

from glider.report.error_table import baseline, unit_beside_noise
from glider.report.numbers import DIVERGED, format_factor
from glider.sysid.result import HeldOutFlight, Result

STANDS_OUT = 2.5
"""A flight stands out where its error is so many times the median. Of errors like a
half-normal's, one in eleven would; of RMS over a flight, fewer."""

MOST = 5
"""Flights that the table shows, the worst."""


class FlightRow(NamedTuple):
    """A held-out flight's position RMS before and after, as text in one unit.

    `times` is the latter over the median of all flights; `planarity` is a sentence,
    empty where the log does not show it.
    """

    name: str
    before: str
    after: str
    unit: str
    times: str
    stands_out: bool
    planarity: str


def worst_flights(result: Result) -> list[FlightRow]:
    """Held-out flights with the largest errors of the corrected model."""
    ranked = rank_flights(result)[::-1]
    after = [position_rms(f, "corrected") for f in ranked]
    finite = [e for e in after if math.isfinite(e)]
    median = float(np.median(finite)) if finite else math.nan
    pairs = [
        (position_rms(f, baseline(result)), e)
        for f, e in zip(ranked, after, strict=True)
    ][:MOST]
    unit = unit_beside_noise(result, *(e for pair in pairs for e in pair))
    return [
        FlightRow(
            name=flight.name,
            before=unit.digits(old),
            after=unit.digits(new),
            unit=unit.name,
            times=format_factor(new / median if median > 0.0 else math.nan),
            stands_out=new > STANDS_OUT * median,
            planarity=result.planarity.get(flight.name, ""),
        )
        for flight, (old, new) in zip(ranked[:MOST], pairs, strict=True)
    ]


def rank_flights(result: Result) -> list[HeldOutFlight]:
    """Held-out flights, from the best corrected to the worst."""
    return sorted(result.held_out, key=lambda f: position_rms(f, "corrected"))


def position_rms(flight: HeldOutFlight, model: str) -> float:
    """A model's distance from a flight, RMS [m]; infinity where it diverged."""
    flown = flight.flown.get(model)
    if flown is None:
        return math.inf
    rms = float(np.sqrt(np.mean(distance(bounded(flown), flight.measured) ** 2)))
    return rms if math.isfinite(rms) else math.inf  # NaN where it diverged.


def distance(pose: np.ndarray, measured: np.ndarray) -> np.ndarray:
    """Distance between poses, row by row [m]."""
    return np.linalg.norm(pose[:, :2] - measured[:, :2], axis=1)


def bounded(values):
    """The values, NaN where a model diverged."""
    return np.where(np.abs(values) < DIVERGED, values, math.nan)
