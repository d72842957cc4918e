"""What the figures show, as numbers: the PNG files and the page draw the same."""

import dataclasses

import numpy as np

from glider.physics.effects import FIELD_TERMS, FIELD_VARIABLES
from glider.physics.effects.field import FieldData, gaussians, make_field
from glider.report.error_table import baseline, unit_beside_noise
from glider.report.flight_errors import bounded, rank_flights
from glider.report.numbers import DEGREE, MILLIMETRE, Unit
from glider.sysid.result import HeldOutFlight, ResidualTable, Result

MOST_FLIGHTS = 4
"""Held-out flights that are shown without being asked for."""

RESIDUALS = {
    "along the wing": Unit(name="m/s²"),
    "normal to it": Unit(name="m/s²"),
    "in pitch": Unit(name="rad/s²"),
}
"""Columns of a residual, with their units."""

COEFFICIENTS = {"c_lift": "C_L", "c_drag": "C_D", "c_moment": "C_M"}
"""Coefficient to its letter; C_M is without a chord [m]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ErrorPanel:
    """Errors of one unit, side by side.

    Attributes:
        title: of the panel.
        fields: fields of `Errors` to their names for people.
        unit: of all of them.
    """

    title: str
    fields: dict[str, str]
    unit: Unit


ERROR_PANELS = (
    ErrorPanel(
        title="acceleration",
        fields={"tangential": "along wing", "normal": "normal"},
        unit=Unit(name="m/s²"),
    ),
    ErrorPanel(
        title="acceleration", fields={"pitch": "in pitch"}, unit=Unit(name="rad/s²")
    ),
    ErrorPanel(
        title="position",
        fields={
            "position_rms_m": "RMS",
            "position_end_m": "at the end",
            "measured_pitch_position_rms_m": "measured\npitch, RMS",
        },
        unit=MILLIMETRE,
    ),
    ErrorPanel(title="pitch", fields={"pitch_rms_rad": "RMS"}, unit=DEGREE),
)

_FOLD_PANELS = {
    "position, free rollout": "position_rms_m",
    "position, along the measured pitch": "measured_pitch_position_rms_m",
    "pitch, free rollout": "pitch_rms_rad",
}


@dataclasses.dataclass(frozen=True, kw_only=True)
class FoldPanel:
    """One error in each fold, (n,) of both models, in a unit."""

    title: str
    unit: Unit
    refitted: np.ndarray
    corrected: np.ndarray


def fold_panels(result: Result) -> list[FoldPanel]:
    """Returns the errors of the folds, NaN where a model left all bounds."""
    panels = []
    for title, field in _FOLD_PANELS.items():
        before, after = (
            bounded(np.array([getattr(e, field) for e in errors], dtype=float))
            for errors in (
                [f.refitted for f in result.folds],
                [f.corrected for f in result.folds],
            )
        )
        unit = DEGREE
        if field != "pitch_rms_rad":
            unit = unit_beside_noise(result, *before, *after)
        panels.append(
            FoldPanel(
                title=title,
                unit=unit,
                refitted=before / unit.size,
                corrected=after / unit.size,
            )
        )
    return panels


@dataclasses.dataclass(frozen=True, kw_only=True)
class SpreadPanel:
    """Each flight's own value of something, and their standard deviation, in a unit."""

    title: str
    unit: Unit
    values: dict[str, float]
    std: float


def spread_panels(result: Result) -> list[SpreadPanel]:
    """Returns what differs from flight to flight, angles in degrees."""
    panels = []
    for name, spread in result.spreads.items():
        if spread.values:
            unit = DEGREE if spread.unit == "rad" else Unit(name=spread.unit)
            panels.append(
                SpreadPanel(
                    title=name.replace("_", " "),
                    unit=unit,
                    values={f: v / unit.size for f, v in spread.values.items()},
                    std=spread.std / unit.size,
                )
            )
    return panels


def residual_tables(result: Result) -> dict[str, ResidualTable]:
    """Returns the residual of the model before and of the corrected one."""
    return {
        baseline(result): result.residual_before,
        "corrected": result.residual_after,
    }


def residual_variables(result: Result) -> list[str]:
    """Returns up to three variables, those of the strongest effects first."""
    wanted = [name for e in result.effects for name in e.depends_on]
    if len(set(wanted)) < 2:
        wanted += ["alpha", "V"]
    tables = residual_tables(result).values()
    there = [n for n in dict.fromkeys(wanted) if all(_varies(t, n) for t in tables)]
    return there[: max(2, min(3, len(there)))]


def _varies(table: ResidualTable, name: str) -> bool:
    values = table.variables.get(name, np.zeros(0))
    values = values[np.isfinite(values)]
    return values.size > 0 and float(np.ptp(values)) > 0.0


def has_coefficients(result: Result) -> bool:
    """Whether both residuals tell the coefficients over the angle of attack."""
    return all(
        "alpha" in t.variables and COEFFICIENTS.keys() <= t.coefficients.keys()
        for t in residual_tables(result).values()
    )


def shown_flights(result: Result) -> list[HeldOutFlight]:
    """Returns up to four held-out flights, from the best corrected to the worst."""
    ranked = rank_flights(result)
    count = min(MOST_FLIGHTS, len(ranked))
    ranks = np.linspace(0, len(ranked) - 1, count).round().astype(int)
    return [ranked[i] for i in ranks]


@dataclasses.dataclass(frozen=True, kw_only=True)
class CarriedCurve:
    """One term of what a model carries without a name, over its variable."""

    term: str
    variable: str
    place: np.ndarray
    value: np.ndarray


def carried_curves(result: Result) -> list[CarriedCurve]:
    """Returns the residual field of a corrected model, term by term, as curves.

    A part over two variables or more has no curve: it is in model.yaml only.
    """
    field = result.model.field
    parts = [] if field is None else [field, *field.more]
    return [
        curve
        for part in parts
        if len(part.variables) == 1 and part.centers
        for curve in _curves_of_part(part)
    ]


def _curves_of_part(part: FieldData) -> list[CarriedCurve]:
    field = make_field(dataclasses.replace(part, more=[]))
    (variable,) = part.variables
    column = [FIELD_VARIABLES.index(variable)]
    centers = field.centers[: len(part.centers), column[0]]
    place = np.linspace(centers.min(), centers.max(), 121)
    values = gaussians(field, column, place[:, None]) @ field.weights
    return [
        CarriedCurve(term=term, variable=variable, place=place, value=values[:, k])
        for k, term in enumerate(FIELD_TERMS)
        if np.any(values[:, k] != 0.0)
    ]
