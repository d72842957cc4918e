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
MILLIMETRE = Unit(name="mm", size=1e-3)
"""The unit of all lengths: errors of models are compared at a glance."""


def format_length(value: float) -> str:
    """A length [m] in mm."""
    return MILLIMETRE.text(value)


def format_angle(value: float) -> str:
    """An angle [rad] in degrees."""
    return DEGREE.text(value)


def format_estimate(c: Estimate) -> str:
    """Returns "-0.600 ± 0.001 m/s": as many digits as the standard error allows.

    Three where that is not known.
    """
    if not math.isfinite(c.value):
        return MISSING

    if not (math.isfinite(c.std) and c.std > 0.0):
        return Unit(name=c.unit).text(c.value)

    unit = "" if c.unit in ("", "-") else f" {c.unit}"
    digits = -math.floor(math.log10(c.std))
    if f"{c.std:e}"[0] == "1":  # 0.0014, not 0.001.
        digits += 1

    if digits > 6:
        return f"{c.value:.3g} ± {c.std:.1g}{unit}"

    value = round(c.value, digits) + 0.0  # Not -0.000.
    std = round(c.std, digits)
    digits = max(digits, 0)

    return f"{value:.{digits}f} ± {std:.{digits}f}{unit}"


def format_value(c: Estimate) -> str:
    """An estimate, an angle in degrees too: "0.05 ± 0.01 rad (2.9°)"."""
    text = format_estimate(c)
    if c.unit != "rad" or not math.isfinite(c.value):
        return text

    return f"{text} ({format_angle(c.value)})"


def format_share(share: float) -> str:
    """A share of one in percent."""
    return f"{100.0 * share:.0f} %" if math.isfinite(share) else MISSING


def format_evidence(evidence: float) -> str:
    """Evidence [nats], with its sign."""
    return f"{evidence:+,.0f}" if math.isfinite(evidence) else MISSING


def format_gain(before: float, after: float) -> str:
    """The factor by which an error fell: "1,000×", "2.50×" or "0.310×"."""
    if before >= DIVERGED > after:
        return "∞"

    if not (0.0 < before < DIVERGED and 0.0 < after < DIVERGED):
        return MISSING

    return f"{_three_digits(before / after)}×"


def _three_digits(value):
    """Digits of a number, three that count."""
    size = abs(value)
    if size >= 100.0:
        return f"{value:,.0f}"

    if value == 0.0 or size < 1e-4:
        return f"{value:.2g}"

    digits = 2 - math.floor(math.log10(size))

    return f"{value:.{max(digits, 0)}f}"
