"""Numbers as text for people: as many digits as they deserve, in a unit that fits."""

import dataclasses
import math

from glider.sysid.result import Estimate

MISSING = "–"

_DIVERGES = "diverges"

DIVERGED = 1e5  # An error above this [SI] only means that the model diverged.


@dataclasses.dataclass(frozen=True, kw_only=True)
class Unit:
    """A unit for people: its name and its size [SI]."""

    name: str
    size: float = 1.0

    def digits(self, value: float) -> str:
        """A number [SI] of three digits in this unit, without its name."""
        if math.isnan(value):
            return MISSING

        return _DIVERGES if abs(value) >= DIVERGED else _three_digits(value / self.size)

    def text(self, value: float) -> str:
        """A number [SI] of three digits with this unit."""
        digits = self.digits(value)
        if digits in (MISSING, _DIVERGES) or self.name in ("", "-"):
            return digits

        return digits + self.name if self.name == "°" else f"{digits} {self.name}"


DEGREE = Unit(name="°", size=math.radians(1.0))
_METRE = Unit(name="m")
_CENTIMETRE = Unit(name="cm", size=1e-2)
_MILLIMETRE = Unit(name="mm", size=1e-3)


def length_unit(*values: float) -> Unit:
    """The one unit in which lengths [m] read best.

    It is that of the smallest; metres where one is ten or more.
    """
    sizes = [abs(v) for v in values if 0.0 < abs(v) < DIVERGED] or [1.0]
    if min(sizes) >= 0.0995 or max(sizes) >= 10.0:
        return _METRE

    return _CENTIMETRE if min(sizes) >= 0.00995 else _MILLIMETRE


def format_length(value: float) -> str:
    """A length [m] in m, cm or mm."""
    return length_unit(value).text(value)


def format_angle(value: float) -> str:
    """An angle [rad] in degrees."""
    return DEGREE.text(value)


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
        scale = 10.0**power
        digits = max(digits + power, 0)
        number = f"({c.value / scale:.{digits}f} ± {c.std / scale:.{digits}f})"
        return f"{number}e{power}{unit}"

    value = round(c.value, digits)
    std = round(c.std, digits)
    digits = max(digits, 0)

    return f"{value:.{digits}f} ± {std:.{digits}f}{unit}"


def in_degrees(c: Estimate) -> str:
    """An angle as " (3.0°)", else nothing."""
    if c.unit != "rad" or not math.isfinite(c.value):
        return ""

    return f" ({math.degrees(c.value):.1f}°)"


def format_spread(std: float, unit: str, error: float = math.nan) -> str:
    """A standard deviation, with its error if known, also in degrees for an angle."""
    text = format_estimate(Estimate(std, error, unit))
    if not math.isfinite(error):
        text = Unit(name=unit).text(std)

    if unit != "rad" or not math.isfinite(std):
        return text

    return f"{text} ({format_angle(std)})"


def format_share(share: float) -> str:
    """A share of one in percent."""
    return f"{100.0 * share:.0f} %" if math.isfinite(share) else MISSING


def format_evidence(evidence: float) -> str:
    """Evidence [nats], with its sign."""
    return f"{evidence:+,.0f}" if math.isfinite(evidence) else MISSING


def format_gain(before: float, after: float) -> str:
    """The factor by which an error fell: "1,000×", "2.5×" or "0.31×"."""
    if before >= DIVERGED > after:
        return "∞"

    if not (0.0 < before < DIVERGED and 0.0 < after < DIVERGED):
        return MISSING

    factor = before / after
    if factor >= 10.0:
        return f"{factor:,.0f}×"

    return f"{factor:.1f}×" if factor >= 0.95 else f"{factor:.2f}×"


def _three_digits(value):
    """Digits of a number, three that count."""
    size = abs(value)
    if size >= 100.0:
        return f"{value:,.0f}"

    if value == 0.0 or size < 1e-4:
        return f"{value:.2g}"

    digits = 2 - math.floor(math.log10(size))

    return f"{value:.{max(digits, 0)}f}"
