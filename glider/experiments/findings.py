"""What an analysis found of a campaign, as far as the next throw depends on it."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

from glider.physics.effects import EffectKind
from glider.physics.model import GliderModel
from glider.sysid.report_file import read_report
from glider.sysid.result import Report, Result


@dataclasses.dataclass(frozen=True, kw_only=True)
class Findings:
    """A model, and sets of effects that may be the right ones in its place.

    Attributes:
        model: the corrected glider.
        kinds: of the effects that were identified.
        rivals: kind to those that would do as well in its place.
        combinations: further sets that were fitted.
        flights: names that were used; None for all.
        grades: grades that were used; None for all.
        own: user effects.
        campaign: name of the campaign that was analysed; None where unspecified.
    """

    model: GliderModel
    kinds: tuple[str, ...]
    rivals: dict[str, tuple[str, ...]]
    combinations: tuple[tuple[str, ...], ...]
    flights: tuple[str, ...] | None = None
    grades: tuple[str, ...] | None = None
    own: tuple[EffectKind, ...] = ()
    campaign: str | None = None

    @property
    def swapped(self) -> list[frozenset[str]]:
        """The chosen set with each rival in the place of what it rivals."""
        return [
            frozenset({*self.kinds} - {kind} | {other})
            for kind, others in self.rivals.items()
            for other in others
        ]


def load_findings(folder: Path, own_effects: Sequence[EffectKind] = ()) -> Findings:
    """Reads what close-the-loop wrote: report.json, and model.yaml beside it.

    Raises:
        InputError: they are not there, or of another version.
    """
    report, path = read_report(folder)
    model = GliderModel.load(path.with_name("model.yaml"), own_effects)
    return _findings(report, model, own_effects)


def findings_of(result: Result) -> Findings:
    """Findings of a result of `close_the_loop`."""
    return _findings(result, result.model, result.own_effects)


def _findings(
    report: Report, model: GliderModel, own_effects: Sequence[EffectKind]
) -> Findings:
    carried = {e.kind.kind for e in model.effects if e.kind.stage != "log"}
    effects = [e for e in report.effects if e.kind in carried]
    flights, grades = report.settings.get("flights"), report.settings.get("grades")
    return Findings(
        model=model,
        kinds=tuple(e.kind for e in effects),
        rivals={e.kind: tuple(e.indistinguishable_from) for e in effects},
        combinations=tuple(c.kinds for c in report.combinations),
        flights=None if flights is None else tuple(flights),
        grades=None if grades is None else tuple(grades),
        own=tuple(own_effects),
        campaign=report.campaign,
    )
