"""The table of errors, before and after the correction, as text."""

import dataclasses
import math

from glider.report.numbers import (
    format_angle,
    format_gain,
    format_in,
    format_length,
)
from glider.sysid.result import (
    MODELS,
    Result,
)


@dataclasses.dataclass(frozen=True, kw_only=True)
class ErrorRow:
    """A row of the table of errors, as text."""

    group: str
    name: str
    cells: dict[str, str]
    gain: str


def error_rows(result: Result) -> list[ErrorRow]:
    """Returns the errors of each model with units, and how much smaller they got."""
    rows = []
    for group, name, field, show in (
        ("Acceleration, RMS", "tangential", "tangential", format_in("m/s²")),
        ("Acceleration, RMS", "normal", "normal", format_in("m/s²")),
        ("Acceleration, RMS", "pitch", "pitch", format_in("rad/s²")),
        ("Free rollout", "position, RMS", "position_rms_m", format_length),
        ("Free rollout", "position, at the end", "position_end_m", format_length),
        ("Free rollout", "pitch, RMS", "pitch_rms_rad", format_angle),
        (
            "Along the measured pitch",
            "position, RMS",
            "measured_pitch_position_rms_m",
            format_length,
        ),
    ):
        errors = {m: result.errors.get(m) for m in MODELS}
        values = {m: getattr(e, field) for m, e in errors.items() if e is not None}
        rows.append(
            ErrorRow(
                group=group,
                name=name,
                cells={m: show(v) for m, v in values.items()},
                gain=format_gain(
                    values.get(baseline(result), math.nan),
                    values.get("corrected", math.nan),
                ),
            )
        )
    return rows


def baseline(result: Result) -> str:
    """Returns the model that the correction is compared with."""
    return "as_drawn" if result.errors.get("as_drawn") is not None else "refitted"
