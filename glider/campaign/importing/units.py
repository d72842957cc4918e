"""Units that logs come in, and their scale to SI.

pint knows more units, but takes 0.7 s to import: longer than most imports.
"""

import dataclasses
import math

from glider.errors import InputError, expect, show

_DEGREE = math.pi / 180.0
_FACTORS: dict[str, dict[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "length": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254, "ft": 0.3048},
    "angle": {"rad": 1.0, "deg": _DEGREE},
    "rate": {"rad/s": 1.0, "deg/s": _DEGREE},
}
_SPELLINGS = {
    "s": "sec second",
    "ms": "msec millisecond",
    "us": "µs μs usec microsecond",
    "ns": "nsec nanosecond",
    "m": "meter metre",
    "cm": "centimeter centimetre",
    "mm": "millimeter millimetre",
    "in": "inch inche",
    "ft": "feet foot",
    "rad": "radian",
    "deg": "° degree",
    "deg/s": "°/s dps",
}
_UNITS = {word: unit for unit, words in _SPELLINGS.items() for word in words.split()}
_UNITS |= {unit: unit for units in _FACTORS.values() for unit in units}


@dataclasses.dataclass(frozen=True, kw_only=True)
class Scale:
    """SI value = gain (logged value - zero)."""

    gain: float = 1.0
    zero: float = 0.0

    def __post_init__(self):
        """Raises InputError where a logged value would be lost."""
        finite = math.isfinite(self.gain) and math.isfinite(self.zero)
        numbers = "finite numbers, and a gain other than 0"
        expect(
            self.gain and finite, "units: [gain, zero]", [self.gain, self.zero], numbers
        )


Unit = str | Scale
"""A unit's name, or a calibration."""


def spell(text: str) -> str | None:
    """Usual spelling of a unit, e.g. "mm" of "[Millimeters]"; None of other words."""
    word = text.strip(" []()").lower()
    return _UNITS.get(word) or _UNITS.get(word.removesuffix("s"))


def scale_of(unit: Unit, kind: str, source: str) -> Scale:
    """Scale of a unit of a kind; the source is for the message."""
    if isinstance(unit, Scale):
        return unit
    factors, spelled = _FACTORS[kind], spell(unit)
    if spelled not in factors:
        raise InputError(
            f"{source}: found {show(unit)}; expected one of {', '.join(factors)}, "
            "or {gain: ..., zero: ...} for gain * (logged - zero)."
        )
    return Scale(gain=factors[spelled])
