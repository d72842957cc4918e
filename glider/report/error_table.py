"""Errors before and after the correction: of models, of single flights."""

import math
from operator import attrgetter
from typing import NamedTuple

import numpy as np

from glider.report import numbers
from glider.report.numbers import DEGREE, DIVERGED, MILLIMETRE, Unit
from glider.sysid.result import (
    MODELS,
    PERFECT,
    HeldOutFlight,
    Report,
    Result,
    UnlikeFlights,
)

FREE = "rollout.position_rms_m"
"""Field of `Errors`, as in report.json: the RMS distance of a free rollout."""


class _ErrorRow(NamedTuple):
    """A row of the table of errors, all of it text in one unit.

    `cells` has the error of each model, `floor` what a perfect model would leave,
    `gain` the factor by which the correction made it smaller.
    """

    group: str
    name: str
    unit: str
    cells: dict[str, str]
    floor: str
    gain: str


_ROWS = (
    ("Acceleration, RMS", "tangential", "equation.tangential", Unit(name="m/s²")),
    ("Acceleration, RMS", "normal", "equation.normal", Unit(name="m/s²")),
    ("Acceleration, RMS", "pitch", "equation.pitch", Unit(name="rad/s²")),
    ("Free rollout", "position, RMS", FREE, MILLIMETRE),
    ("Free rollout", "position, end", "rollout.position_end_m", MILLIMETRE),
    ("Free rollout", "pitch, RMS", "rollout.pitch_rms_rad", DEGREE),
    (
        "Along measured pitch",
        "position, RMS",
        "rollout_measured_pitch.position_rms_m",
        MILLIMETRE,
    ),
)
"""Group, name and field of `Errors`, and its unit."""


def error_rows(result: Result) -> list[_ErrorRow]:
    """Errors of each model, and how much smaller they got."""
    rows = []
    for group, name, field, unit in _ROWS:
        values = {m: error_of(result, m, field) for m in columns_of(result)}
        floor = error_of(result, PERFECT, field)
        before = values.get(baseline(result), math.nan)
        rows.append(
            _ErrorRow(
                group=group,
                name=name,
                unit=unit.name,
                cells={m: unit.digits(v) for m, v in values.items()},
                floor=unit.digits(floor),
                gain=numbers.format_gain(before, values.get("corrected", math.nan)),
            )
        )
    return rows


def error_of(report: Report | UnlikeFlights, model: str, field: str) -> float:
    """An error of a model by its field of `Errors`; NaN where it has none."""
    errors = report.errors.get(model)
    return math.nan if errors is None else float(attrgetter(field)(errors))


def columns_of(report: Report) -> list[str]:
    """Models of which a report has errors, as MODELS orders them."""
    return [model for model in MODELS if report.errors.get(model)]


def baseline(result: Result) -> str:
    """Model that the correction is compared with."""
    return "nominal" if result.errors.get("nominal") is not None else "refitted"


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
