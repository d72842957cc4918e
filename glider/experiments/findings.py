"""What an analysis said of a campaign, as far as the next throw depends on it."""

import dataclasses
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from glider.errors import InputError
from glider.files.reports import find_report
from glider.physics.effects import EffectKind
from glider.physics.model import GliderModel, load_model
from glider.sysid.result import Result


@dataclasses.dataclass(frozen=True, kw_only=True)
class Findings:
    """A model, and sets of effects that may be the right ones in its place.

    Attributes:
        model: the corrected glider.
        kinds: of the effects that it has a name for.
        rivals: kind to those that would do as well in its place.
        combinations: further sets that were fitted.
        flights: names that were used; None for all.
        grades: grades that were used; None for all.
        own: kinds of the caller's own.
        campaign: name of the campaign that was analysed; None where nobody tells.
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

    @property
    def sets(self) -> list[frozenset[str]]:
        """The chosen set, each with a rival swapped in, then the combinations."""
        combinations = map(frozenset, self.combinations)
        every = [frozenset(self.kinds), *self.swapped, *combinations]
        return list(dict.fromkeys(every))


def findings_of(result: Result) -> Findings:
    """Returns what a result of `close_the_loop` found."""
    return _findings(
        result.model,
        {e.kind: e.indistinguishable_from for e in result.effects},
        [c.kinds for c in result.combinations],
        result.settings,
        result.own_effects,
        result.campaign,
    )


def load_findings(folder: Path, own_effects: Sequence[EffectKind] = ()) -> Findings:
    """Reads what close-the-loop wrote: report.json, and model.yaml beside it.

    Raises:
        InputError: they are not there, or lack what is needed.
    """
    path = find_report(folder)
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        rivals = {
            str(e["kind"]): tuple(map(str, e["indistinguishable_from"]))
            for e in data["effects"]
        }
        combinations = [tuple(map(str, c["kinds"])) for c in data["combinations"]]
        settings, name = dict(data["settings"]), str(data["campaign"])
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(
            f"{path}: is no report ({type(error).__name__}: {error}); one that "
            "close-the-loop of this version wrote is needed."
        ) from None
    model = load_model(path.with_name("model.yaml"), own_effects)
    return _findings(model, rivals, combinations, settings, tuple(own_effects), name)


def _findings(
    model: GliderModel,
    rivals: dict[str, tuple[str, ...]],
    combinations: Sequence[tuple[str, ...]],
    settings: Mapping[str, Any],
    own: tuple[EffectKind, ...],
    campaign: str,
) -> Findings:
    carried = {e.kind.kind for e in model.effects if e.kind.stage != "log"}
    kinds = tuple(kind for kind in rivals if kind in carried)
    flights, grades = settings.get("flights"), settings.get("grades")
    return Findings(
        model=model,
        kinds=kinds,
        rivals={kind: rivals[kind] for kind in kinds},
        combinations=tuple(combinations),
        flights=None if flights is None else tuple(flights),
        grades=None if grades is None else tuple(grades),
        own=own,
        campaign=campaign,
    )
