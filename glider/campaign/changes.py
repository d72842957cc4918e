"""The order of a session's flights, and changes at one of them."""

import dataclasses
import math
import re

from glider.files.schema import Number

LEAST_SIDE = 2
"""Flights on either side of a change: one alone is an outlier."""
SERVO = "servo"
"""Kind of a change of a servo: of a stop, its rate limit, delay or lag."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Change:
    """A change of the glider, of its servo or of its log during the session."""

    kind: str  #: Of the effect of which a coefficient changes, or SERVO.
    coefficient: str
    unit: str
    value: Number  #: By how much: from the flight on, or from the first to the last.
    std: Number = math.nan  #: Its standard error, NaN of a servo.
    flight: str  #: From which on it is changed; empty where it drifts.
    #: What it was and is, of a servo; infinite where no flight reaches the limit.
    before: Number = math.nan
    since: Number = math.nan

    @property
    def sentence(self) -> str:
        """What changes, by how much and when."""
        unit = "" if self.unit == "-" else f" {self.unit}"
        if self.kind == SERVO:
            old, new = (
                f"{number:z.3f}{unit}" if math.isfinite(number) else "not reached"
                for number in (self.before, self.since)
            )
            return (
                f"At {self.flight} the servo changes: its {self.coefficient} is {new}, "
                f"before {old}."
            )
        size = f"{self.value:+.3g} ± {self.std:.1g}{unit}"
        what = f"'{self.coefficient}' of {self.kind}"
        if self.flight:
            return f"At {self.flight} {what} jumps by {size}."
        return f"{what} drifts by {size} from the first flight to the last."


def by_number(name: str) -> list[tuple[int, str]]:
    """Returns the key by which flight_2 comes before flight_10."""
    parts = re.split(r"(\d+)", name)
    return [(int(part) if part.isdecimal() else -1, part) for part in parts]
