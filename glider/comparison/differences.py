"""Two saved reports: what differs, and whether by more than their errors allow.

A number θ with standard errors s₁, s₂ in two independent campaigns has changed by
θ₂ - θ₁ ± √(s₁² + s₂²). With n numbers compared, one change counts where it is beyond
what the largest of n standard normal ones exceeds in one comparison of a hundred.
"""

import contextlib
import dataclasses
import math
from pathlib import Path

from scipy.special import ndtri  # scipy.stats takes 0.4 s to import.

from glider.errors import InputError
from glider.files.schema import read_text
from glider.physics.effects import KINDS
from glider.physics.model import parse_model
from glider.physics.parameters import GliderParameters
from glider.report.wording import join, name_of, say
from glider.sysid.report import Estimate, Report, Spread, read_report

FALSE_ALARM = 0.01
"""Probability that any change is reported between campaigns of one glider."""

GROUPS = EFFECTS, SPREADS, VEHICLE = "effects", "from flight to flight", "vehicle"
"""Groups of differences."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class SavedReport(Report):
    """A report as it was saved."""

    path: Path  #: Of its report.json.
    given: GliderParameters | None  #: Specified ones, where a model.yaml has them.


def load_report(path: Path) -> SavedReport:
    """Reads a report: its folder, or its report.json.

    Raises:
        InputError: it is no report, or one of another version.
    """
    report, file = read_report(path)
    given, model = None, file.with_name("model.yaml")
    if not report.vehicle and model.exists():
        # With user effects it cannot be read: they compare without it.
        with contextlib.suppress(InputError):
            text = read_text(model, "a glider model")
            given = parse_model(text, str(model))[0].parameters
    return SavedReport(**vars(report), path=file, given=given)


@dataclasses.dataclass(frozen=True)
class Difference:
    """A number in two reports."""

    group: str  #: EFFECTS, SPREADS or VEHICLE.
    kind: str  #: Of the effect; of the vehicle its number, of a spread what differs.
    name: str  #: Of the coefficient; empty where the kind says all.
    first: Estimate | None  #: In the first report, None where it has none.
    second: Estimate | None
    note: str  #: What else to know, or nothing.

    @property
    def unit(self) -> str:
        """Unit of all its numbers."""
        [unit, *_] = self.units
        return unit

    @property
    def units(self) -> list[str]:
        """Units in the reports that have the number."""
        return [e.unit for e in (self.first, self.second) if e is not None]

    @property
    def change(self) -> Estimate | None:
        """Second less first with its standard error; None where one is missing."""
        if self.first is None or self.second is None or len(set(self.units)) > 1:
            return None
        std = math.hypot(self.first.std, self.second.std)
        return Estimate(self.second.value - self.first.value, std, self.unit)

    @property
    def z(self) -> float:
        """Change over its standard error; NaN where that is not known."""
        change = self.change
        return change.value / change.std if change and change.std > 0.0 else math.nan

    @property
    def words(self) -> str:
        """Short phrase for the kind; of the user's own its name."""
        return KINDS[self.kind].words if self.kind in KINDS else name_of(self.kind)

    @property
    def label(self) -> str:
        """Name as of a correlation in report.json: "wind.x"."""
        return f"{self.kind}.{self.name}" if self.name else self.kind


@dataclasses.dataclass(frozen=True, kw_only=True)
class Comparison:
    """Two reports and what differs between them."""

    first: SavedReport
    second: SavedReport
    differences: tuple[Difference, ...]  #: Of all numbers that either has.
    z_significant: float  #: Threshold above which a change counts.
    notes: tuple[str, ...]  #: On how far the two may be compared.

    @property
    def reports(self) -> tuple[SavedReport, SavedReport]:
        """Both reports."""
        return self.first, self.second

    @property
    def lacks_effects(self) -> bool:
        """Whether one report has an effect that the other lacks."""
        effects = [d for d in self.differences if d.group == EFFECTS]
        return any(d.first is None or d.second is None for d in effects)

    def is_significant(self, difference: Difference) -> bool:
        """Whether a number changed by more than its standard errors allow."""
        return abs(difference.z) > self.z_significant  # False for NaN.


def compare(first: SavedReport, second: SavedReport) -> Comparison:
    """Compares two reports."""
    a, b = _values(first), _values(second)
    keys = dict.fromkeys((*a, *b))
    kinds = list(dict.fromkeys(key[:2] for key in keys))
    order = sorted(keys, key=lambda key: (GROUPS.index(key[0]), kinds.index(key[:2])))
    differences = []
    for key in order:
        note = _absence(key[1], first, second) if key[0] == EFFECTS else ""
        found = Difference(*key, a.get(key), b.get(key), note)
        if len(set(found.units)) > 1:
            note = f"units differ: {' and '.join(found.units)}"
            found = dataclasses.replace(found, note=note)
        differences.append(found)
    count = sum(math.isfinite(d.z) for d in differences)
    return Comparison(
        first=first,
        second=second,
        differences=tuple(differences),
        z_significant=-float(ndtri(0.5 * FALSE_ALARM / max(count, 1))),
        notes=tuple(say("notes", first, second)),
    )


Key = tuple[str, str, str]
"""Group, kind and name of a difference."""


def _values(report: Report) -> dict[Key, Estimate]:
    values = {
        (EFFECTS, effect.kind, name): coefficient
        for effect in report.effects
        for name, coefficient in effect.coefficients.items()
    }
    values |= {(SPREADS, name, ""): _spread(s) for name, s in report.spreads.items()}
    return values | {(VEHICLE, name, ""): c for name, c in report.vehicle.items()}


def _spread(spread: Spread) -> Estimate:
    """A standard deviation with its own standard error, s / √(2 (n - 1))."""
    count = sum(math.isfinite(v) for v in spread.values.values())
    std = spread.std / math.sqrt(2.0 * (count - 1)) if count > 1 else math.nan
    return Estimate(spread.std, std, spread.unit)


def _absence(kind: str, first: Report, second: Report) -> str:
    """A note on an effect of one report that the other lacks."""
    effects = {e.kind: e for e in first.effects}
    if kind not in effects:
        return _absence(kind, second, first)
    others = [e.kind for e in second.effects]
    if kind in others:
        return ""
    rivals = effects[kind].indistinguishable_from
    if instead := [other for other in others if other in rivals]:
        return f"may be its {join(instead, ' or ')}: indistinguishable on these flights"
    return "" if kind in second.candidates else "not tried there"
