"""The table of errors, before and after the correction, as text."""

import dataclasses
import math

import numpy as np

from glider.report.numbers import DEGREE, Unit, format_gain, length_unit
from glider.sysid.result import CALIBRATED, Result

COLUMNS = ("nominal", "refitted", CALIBRATED, "corrected")
"""Models in the order in which they are shown; not every result has all."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ErrorRow:
    """A row of the table of errors, as text, all of it in one unit.

    Attributes:
        group: heading that it stands under.
        name: of the error.
        unit: of all its numbers.
        cells: model to its error.
        noise: what noise of the measurement alone would give.
        gain: by what factor the correction made it smaller.
    """

    group: str
    name: str
    unit: str
    cells: dict[str, str]
    noise: str
    gain: str


def error_rows(result: Result) -> list[ErrorRow]:
    """Returns the errors of each model, and how much smaller they got."""
    errors = {m: e for m in columns_of(result) if (e := result.errors[m]) is not None}
    rows = []
    for group, name, field, unit in (
        ("Acceleration, RMS", "tangential", "tangential", Unit(name="m/s²")),
        ("Acceleration, RMS", "normal", "normal", Unit(name="m/s²")),
        ("Acceleration, RMS", "pitch", "pitch", Unit(name="rad/s²")),
        ("Free rollout", "position, RMS", "position_rms_m", None),
        ("Free rollout", "position, end", "position_end_m", None),
        ("Free rollout", "pitch, RMS", "pitch_rms_rad", DEGREE),
        (
            "Along measured pitch",
            "position, RMS",
            "measured_pitch_position_rms_m",
            None,
        ),
    ):
        values = {m: float(getattr(e, field)) for m, e in errors.items()}
        noise = noise_floor(result, field)
        of_row = unit or unit_beside_noise(result, *values.values())
        rows.append(
            ErrorRow(
                group=group,
                name=name,
                unit=of_row.name,
                cells={m: of_row.digits(v) for m, v in values.items()},
                noise=of_row.digits(noise),
                gain=format_gain(
                    values.get(baseline(result), math.nan),
                    values.get("corrected", math.nan),
                ),
            )
        )
    return rows


def unit_beside_noise(result: Result, *lengths: float) -> Unit:
    """Returns the one unit in which lengths [m] and the noise beside them read best."""
    return length_unit(*lengths, noise_floor(result, "position_rms_m"))


def columns_of(result: Result) -> list[str]:
    """Returns the models of which there are errors, as COLUMNS orders them."""
    return [m for m in COLUMNS if result.errors.get(m) is not None]


def baseline(result: Result) -> str:
    """Returns the model that the correction is compared with."""
    return "nominal" if result.errors.get("nominal") is not None else "refitted"


def noise_floor(result: Result, field: str) -> float:
    """Returns an error that a perfect model would show, by noise of the poses alone.

    A distance has two noisy coordinates: its RMS is √2 of the noise, its mean (at the
    end of a flight) √(π/2). That of an acceleration is what the smoothing lets
    through, on the held-out flights.
    """
    if field in _ACCELERATIONS:
        table = result.residual_after
        unseen = [n in result.held_out_flights for n in table.names]
        std = table.noise[np.array(unseen, dtype=bool)[table.flight]]
        column = std[:, _ACCELERATIONS.index(field)]
        return float(np.sqrt(np.mean(column**2))) if column.size else math.nan
    return {
        "position_rms_m": math.sqrt(2.0) * result.noise_position_m,
        "measured_pitch_position_rms_m": math.sqrt(2.0) * result.noise_position_m,
        "position_end_m": math.sqrt(math.pi / 2.0) * result.noise_position_m,
        "pitch_rms_rad": result.noise_pitch_rad,
    }.get(field, math.nan)


_ACCELERATIONS = ("tangential", "normal", "pitch")
"""Fields of `Errors` that are RMS of the columns of a residual."""
