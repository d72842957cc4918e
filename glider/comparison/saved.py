"""A report.json, read back: what of it a comparison needs."""

import dataclasses
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from glider.errors import InputError
from glider.files.reports import find_report
from glider.physics.model import load_model
from glider.physics.parameters import GliderParameters
from glider.sysid.result import Curve, Estimate, Spread


@dataclasses.dataclass(frozen=True, kw_only=True)
class SavedEffect:
    """An effect of a report; its attributes are those of `FoundEffect`."""

    kind: str
    coefficients: dict[str, Estimate]
    evidence: float
    inclusion: float
    rivals: tuple[str, ...]


@dataclasses.dataclass(frozen=True, kw_only=True)
class SavedReport:
    """A report as it was saved; its attributes are those of `Result`.

    Attributes:
        path: of its report.json.
        candidates: kinds that were tried.
        errors: model to name of an error ("rollout.position_rms_m") to the error.
        given: parameters of the vehicle that were told, if model.yaml is beside it.
    """

    path: Path
    campaign: str
    verdict: str
    reason: str
    fit_flights: tuple[str, ...]
    held_out_flights: tuple[str, ...]
    effects: tuple[SavedEffect, ...]
    errors: dict[str, dict[str, float]]
    candidates: tuple[str, ...]
    spreads: dict[str, Spread]
    vehicle: dict[str, Estimate]
    curves: tuple[Curve, ...]
    noise_position_m: float
    noise_pitch_rad: float
    air_std_m_s: float
    version: str
    given: GliderParameters | None


def load_report(path: Path) -> SavedReport:
    """Reads a report: its folder, or its report.json.

    Raises:
        InputError: it is no report, or one that lacks what is needed.
    """
    file = find_report(path)
    try:
        data = json.loads(file.read_text(encoding="utf-8"))
    except ValueError as error:  # Of JSON and of UTF-8.
        raise InputError(
            f"{file}: is no JSON ({error}); the report.json of a campaign is needed."
        ) from None
    fields = _Fields(file, data, "")
    flights, noise = fields.child("flights"), fields.child("noise")
    return SavedReport(
        path=file,
        campaign=fields.text("campaign"),
        verdict=fields.text("verdict"),
        reason=fields.text("reason"),
        fit_flights=tuple(map(str, flights.items("fit"))),
        held_out_flights=tuple(map(str, flights.items("held_out"))),
        effects=tuple(_effect(e) for e in fields.children("effects")),
        errors={
            _RENAMED.get(model, model): _errors(fields.child("errors").child(model))
            for model, value in fields.child("errors").data.items()
            if value is not None
        },
        candidates=tuple(fields.child("candidates").data),
        spreads={
            name: Spread(
                std=spread.number("std"),
                unit=spread.text("unit"),
                values={f: _number(v) for f, v in spread.child("values").data.items()},
            )
            for name, spread in fields.named("spreads")
        },
        vehicle=_estimates(fields.named("vehicle")),
        curves=tuple(_curve(c) for c in fields.children("curves")),
        noise_position_m=noise.number("position_m"),
        noise_pitch_rad=noise.number("pitch_rad"),
        air_std_m_s=fields.child("air").number("std_m_s"),
        version=fields.text("version"),
        given=_given(file.with_name("model.yaml"), fields.named("vehicle")),
    )


class _Fields:
    """An object of a JSON file that says which of its fields is not as it should be."""

    def __init__(self, file: Path, data: Any, place: str):
        self.file, self.place = file, place
        self.data: Mapping[str, Any] = self._is(data, dict, "an object", place)

    def _is(self, value: Any, kind: type, words: str, place: str) -> Any:
        if not isinstance(value, kind):
            where = f"'{place}' is" if place else "it holds"
            raise InputError(
                f"{self.file}: {where} {_shown(value)}; {words} is needed, as "
                "close-the-loop of this version writes."
            )
        return value

    def _at(self, name: str) -> tuple[Any, str]:
        place = f"{self.place}.{name}" if self.place else name
        if name not in self.data:
            raise InputError(
                f"{self.file}: '{place}' is missing; a report.json as close-the-loop "
                "of this version writes is needed: run it again."
            )
        return self.data[name], place

    def text(self, name: str) -> str:
        value, place = self._at(name)
        return self._is(value, str, "a text", place)

    def number(self, name: str) -> float:
        value, place = self._at(name)
        if value is not None and (
            isinstance(value, bool) or not isinstance(value, (int, float))
        ):
            self._is(value, float, "a number", place)
        return _number(value)

    def items(self, name: str) -> list[Any]:
        value, place = self._at(name)
        return self._is(value, list, "a list", place)

    def numbers(self, name: str) -> np.ndarray:
        values = self.items(name)
        for value in values:
            if value is not None and not isinstance(value, (int, float)):
                self._is(value, float, "a list of numbers", self._at(name)[1])
        return np.array([_number(v) for v in values])

    def child(self, name: str) -> "_Fields":
        return _Fields(self.file, *self._at(name))

    def children(self, name: str) -> list["_Fields"]:
        _, place = self._at(name)
        return [
            _Fields(self.file, item, f"{place}[{i}]")
            for i, item in enumerate(self.items(name))
        ]

    def named_children(self) -> list[tuple[str, "_Fields"]]:
        return [(name, self.child(name)) for name in self.data]

    def named(self, name: str) -> list[tuple[str, "_Fields"]]:
        return self.child(name).named_children()


def _shown(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 40 else text[:37] + "..."


def _number(value: Any) -> float:
    return math.nan if value is None else float(value)


def _effect(fields: _Fields) -> SavedEffect:
    return SavedEffect(
        kind=fields.text("kind"),
        coefficients=_estimates(fields.named("coefficients")),
        evidence=fields.number("evidence"),
        inclusion=fields.number("inclusion"),
        rivals=tuple(map(str, fields.items("indistinguishable_from"))),
    )


def _estimates(named: list[tuple[str, _Fields]]) -> dict[str, Estimate]:
    return {
        name: Estimate(
            value=fields.number("value"),
            std=fields.number("std"),
            unit=fields.text("unit"),
        )
        for name, fields in named
    }


_RENAMED = {"as_drawn": "nominal"}
"""Models that older reports call otherwise."""


def _errors(model: _Fields) -> dict[str, float]:
    return {
        f"{group}.{name}": errors.number(name)
        for group, errors in model.named_children()
        for name in errors.data
    }


def _curve(fields: _Fields) -> Curve:
    columns = {name: fields.numbers(name) for name in ("alpha", "lack", "std", "named")}
    if len({len(column) for column in columns.values()}) != 1:
        raise InputError(
            f"{fields.file}: '{fields.place}' has columns of different lengths; "
            "alpha, lack, std and named of one length are needed."
        )
    try:
        return Curve(term=fields.text("term"), **columns)
    except InputError as error:
        raise InputError(f"{fields.file}: '{fields.place}': {error}") from None


def _given(path: Path, fitted: list[tuple[str, _Fields]]) -> GliderParameters | None:
    """Returns the vehicle that was told; None where it was not, or is not known."""
    if fitted or not path.exists():
        return None
    try:
        return load_model(path).parameters
    except InputError:  # With effects of the user's own: they compare without it.
        return None
