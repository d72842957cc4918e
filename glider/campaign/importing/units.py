"""Units that logs come in, and their way to SI."""

import dataclasses
import math

from glider.errors import InputError, show

_DEGREE = math.pi / 180.0
_FACTORS: dict[str, dict[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "length": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254, "ft": 0.3048},
    "angle": {"rad": 1.0, "deg": _DEGREE},
    "rate": {"rad/s": 1.0, "deg/s": _DEGREE},
}
_WORDS = {
    "sec": "s",
    "second": "s",
    "millisecond": "ms",
    "msec": "ms",
    "µs": "us",
    "μs": "us",
    "usec": "us",
    "microsecond": "us",
    "nsec": "ns",
    "nanosecond": "ns",
    "meter": "m",
    "metre": "m",
    "centimeter": "cm",
    "millimeter": "mm",
    "millimetre": "mm",
    "inch": "in",
    "feet": "ft",
    "foot": "ft",
    "radian": "rad",
    "degree": "deg",
    "°": "deg",
    "°/s": "deg/s",
    "dps": "deg/s",
}

KINDS = tuple(_FACTORS)
"""Kinds of quantities; `units:` of a mapping may name a unit for all of a kind."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Scale:
    """SI value = gain (logged value - zero)."""

    gain: float = 1.0
    zero: float = 0.0


def spell(text: str) -> str | None:
    """Returns the usual spelling of a unit, e.g. "mm" of "[Millimeters]"; else None."""
    word = text.strip(" []()").lower()
    for spelling in (word, word.removesuffix("s")):
        unit = _WORDS.get(spelling, spelling)
        if any(unit in units for units in _FACTORS.values()):
            return unit
    return None


def scale_of(unit: object, kind: str, source: str) -> Scale:
    """Returns the scale of a unit, or of a calibration {gain, zero}.

    Args:
        unit: from a mapping or a file.
        kind: one of KINDS.
        source: file and field, for the message.

    Raises:
        InputError: it is no unit of that kind.
    """
    if isinstance(unit, dict) and set(unit) <= {"gain", "zero"} and "gain" in unit:
        numbers = [unit["gain"], unit.get("zero", 0.0)]
        fits = all(
            isinstance(v, (int, float)) and math.isfinite(v) and not isinstance(v, bool)
            for v in numbers
        )
        if fits and numbers[0] != 0:
            return Scale(gain=float(numbers[0]), zero=float(numbers[1]))
    spelled = spell(unit) if isinstance(unit, str) else None
    if spelled is None or spelled not in _FACTORS[kind]:
        raise InputError(
            f"{source}: found {show(unit)}; one of {', '.join(_FACTORS[kind])} is "
            "needed, "
            "or {gain: ..., zero: ...} for gain * (logged - zero)."
        )
    return Scale(gain=_FACTORS[kind][spelled])
