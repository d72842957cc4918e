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
from glider.physics.effects import KINDS
from glider.physics.model import GliderModel
from glider.physics.parameters import GliderParameters
from glider.report.wording import join, name_of, say
from glider.sysid.report_file import read_report
from glider.sysid.result import Estimate, Report, ReportedEffect, Spread

FALSE_ALARM = 0.01
"""Probability that any change is reported between campaigns of one glider."""

EFFECTS, SPREADS, VEHICLE = "effects", "from flight to flight", "vehicle"
"""Groups of differences."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class SavedReport(Report):
    """A report as it was saved.

    Attributes:
        path: of its report.json.
        given: parameters of the vehicle that were specified, if model.yaml is beside
            it; None where they are unknown.
    """

    path: Path
    given: GliderParameters | None


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
            given = GliderModel.load(model).parameters
    return SavedReport(**vars(report), path=file, given=given)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Difference:
    """A number in two reports.

    Attributes:
        group: EFFECTS, SPREADS or VEHICLE.
        kind: of the effect; of the vehicle its number, of a spread what differs.
        name: of the coefficient; empty where the kind says all.
        unit: of all its numbers.
        first: in the first report, None where it has none.
        second: in the second.
        change: second less first with its standard error, None where one is missing.
        z: change over its standard error; NaN where that is not known.
        note: what else to know, or nothing.
    """

    group: str
    kind: str
    name: str
    unit: str
    first: Estimate | None
    second: Estimate | None
    change: Estimate | None
    z: float
    note: str = ""

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
    """Two reports and what differs between them.

    Attributes:
        differences: of all numbers that either has.
        z_significant: threshold above which a change counts.
        notes: sentences on how far the two may be compared.
    """

    first: SavedReport
    second: SavedReport
    differences: tuple[Difference, ...]
    z_significant: float
    notes: tuple[str, ...]

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
    differences = (
        *_effects(first, second),
        *_spreads(first, second),
        *_numbers(VEHICLE, "", first.vehicle, second.vehicle),
    )
    count = sum(math.isfinite(d.z) for d in differences)
    return Comparison(
        first=first,
        second=second,
        differences=differences,
        z_significant=-float(ndtri(0.5 * FALSE_ALARM / max(count, 1))),
        notes=tuple(say("notes", first, second)),
    )


def _effects(first: SavedReport, second: SavedReport) -> list[Difference]:
    both = [{e.kind: e for e in report.effects} for report in (first, second)]
    found = []
    for kind in dict.fromkeys((*both[0], *both[1])):
        effects = [report.get(kind) for report in both]
        old, new = (effect.coefficients if effect else {} for effect in effects)
        note = ""
        for effect, other in zip(effects, (second, first), strict=True):
            if effect and kind not in {e.kind for e in other.effects}:
                note = _absence(effect, other)
        found += _numbers(EFFECTS, kind, old, new, note)
    return found


def _absence(effect: ReportedEffect, report: SavedReport) -> str:
    """A note on an effect that only the other report has."""
    rivals = effect.indistinguishable_from
    if instead := [e.kind for e in report.effects if e.kind in rivals]:
        return f"may be its {join(instead, ' or ')}: indistinguishable on these flights"
    return "" if effect.kind in report.candidates else "not tried there"


def _spreads(first: SavedReport, second: SavedReport) -> list[Difference]:
    old, new = (
        {name: _spread(s) for name, s in report.spreads.items()}
        for report in (first, second)
    )
    return _numbers(SPREADS, "", old, new)


def _spread(spread: Spread) -> Estimate:
    """A standard deviation with its own standard error, s / √(2 (n - 1))."""
    count = sum(math.isfinite(v) for v in spread.values.values())
    std = spread.std / math.sqrt(2.0 * (count - 1)) if count > 1 else math.nan
    return Estimate(value=spread.std, std=std, unit=spread.unit)


def _numbers(
    group: str,
    kind: str,
    first: dict[str, Estimate],
    second: dict[str, Estimate],
    note: str = "",
) -> list[Difference]:
    found = []
    for name in dict.fromkeys((*first, *second)):
        one, other = first.get(name), second.get(name)
        some = one or other
        assert some is not None
        change, z, said = None, math.nan, note
        if one and other and one.unit != other.unit:
            said = f"units differ: {one.unit} and {other.unit}"
        elif one and other:
            std = math.hypot(one.std, other.std)
            change = Estimate(value=other.value - one.value, std=std, unit=one.unit)
            z = change.value / std if std > 0.0 else math.nan
        found.append(
            Difference(
                group=group,
                kind=kind or name,
                name=name if kind else "",
                unit=some.unit,
                first=one,
                second=other,
                change=change,
                z=z,
                note=said,
            )
        )
    return found
