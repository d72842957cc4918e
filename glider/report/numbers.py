"""Numbers as text for people: as many digits as they deserve, in a unit that fits."""

import math
from collections.abc import Callable

from glider.sysid.result import Estimate

MISSING = "–"

DIVERGED = 1e5
"""An error above this [SI] only says that the model left all bounds."""


def finite_or_none(value: float) -> float | None:
    """Returns a number as a float, or None where JSON has none."""
    number = float(value)
    return number if math.isfinite(number) else None


def format_estimate(c: Estimate) -> str:
    """Returns "-0.600 ± 0.001 m/s": as many digits as the standard error allows."""
    unit = "" if c.unit in ("", "-") else f" {c.unit}"
    if not math.isfinite(c.value):
        return MISSING
    if not (math.isfinite(c.std) and c.std > 0.0):
        return f"{c.value:.4g}{unit}"
    digits = -math.floor(math.log10(c.std))
    if f"{c.std:e}"[0] == "1":  # 0.0014, not 0.001.
        digits += 1
    if digits > 6:
        power = math.floor(math.log10(max(abs(c.value), c.std)))
        scale, digits = 10.0**power, max(digits + power, 0)
        number = f"({c.value / scale:.{digits}f} ± {c.std / scale:.{digits}f})"
        return f"{number}e{power}{unit}"
    value, std = round(c.value, digits), round(c.std, digits)
    digits = max(digits, 0)
    return f"{value:.{digits}f} ± {std:.{digits}f}{unit}"


def in_degrees(c: Estimate) -> str:
    """Returns " (3.0°)" for an angle, else nothing."""
    if c.unit != "rad" or not math.isfinite(c.value):
        return ""
    return f" ({math.degrees(c.value):.1f}°)"


def format_length(value: float) -> str:
    """Returns a length [m] in m, cm or mm."""
    for scale, unit in ((1.0, "m"), (1e-2, "cm"), (1e-3, "mm")):
        if abs(value) >= 0.0995 * scale if unit == "m" else abs(value) >= 0.995 * scale:
            return format_number(value / scale, unit)
    return format_number(value * 1e3, "mm")


def format_angle(value: float) -> str:
    """Returns an angle [rad] in degrees."""
    return format_number(math.degrees(value), "°")


def format_in(unit: str) -> Callable[[float], str]:
    """Returns a function that shows numbers of a unit."""
    return lambda value: format_number(value, unit)


def format_number(value: float, unit: str) -> str:
    """Returns a number of three digits with its unit."""
    if math.isnan(value):
        return MISSING
    if abs(value) >= DIVERGED:
        return "diverges"
    if abs(value) >= 100.0:
        text = f"{value:,.0f}"
    elif value == 0.0 or abs(value) < 1e-4:
        text = f"{value:.2g}"
    else:  # Three digits.
        text = f"{value:.{max(2 - math.floor(math.log10(abs(value))), 0)}f}"
    return text + unit if unit == "°" else f"{text} {unit}"


def format_gain(before: float, after: float) -> str:
    """Returns by what factor an error fell."""
    if before >= DIVERGED > after:
        return "∞"
    if not (0.0 < before < DIVERGED and 0.0 < after < DIVERGED):
        return MISSING
    factor = before / after
    if factor >= 10.0:
        return f"{factor:,.0f}×"
    return f"{factor:.1f}×" if factor >= 0.95 else f"{factor:.2f}×"
