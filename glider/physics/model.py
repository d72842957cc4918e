"""A glider model as a file: the drawing, the effects, the residual field.

parameters: {mass: 0.08, ...}
effects:
  - {kind: wind, coefficients: {x: -0.6, z: 0.1}}
field: {kind: unexplained, variables: [x], ...}      # optional
"""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from glider.errors import InputError
from glider.physics.effects import (
    KINDS,
    NO_FIELD,
    Effect,
    EffectKind,
    Field,
)
from glider.physics.effects.field import (
    FieldData,
    make_field,
)
from glider.physics.parameters import (
    GliderParameters,
    check_parameters,
)
from glider.physics.typed_yaml import (
    load_typed,
    save_typed,
)


@dataclasses.dataclass(frozen=True, kw_only=True)
class GliderModel:
    """A glider: its drawing and what the drawing lacks.

    Attributes:
        parameters: the drawing.
        effects: from the library or the user's own.
        field: the residual field as data, or None.
    """

    parameters: GliderParameters = dataclasses.field(default_factory=GliderParameters)
    effects: tuple[Effect, ...] = ()
    field: FieldData | None = None

    @property
    def coefficients(self) -> np.ndarray:
        """Those of the effects, one effect after the other."""
        return np.array([value for effect in self.effects for value in effect.values])

    @property
    def residual_field(self) -> Field:
        """The arrays of the residual field."""
        return NO_FIELD if self.field is None else make_field(self.field)


@dataclasses.dataclass(kw_only=True)
class _EffectFile:
    kind: str = ""
    coefficients: dict[str, float] = dataclasses.field(default_factory=dict)


@dataclasses.dataclass(kw_only=True)
class _ModelFile:
    parameters: GliderParameters = dataclasses.field(default_factory=GliderParameters)
    effects: list[_EffectFile] = dataclasses.field(default_factory=list)
    field: FieldData | None = None


def save_model(path: Path | str, model: GliderModel) -> None:
    """Writes a model; `load_model` gives it back unchanged."""
    data = _ModelFile(
        parameters=model.parameters,
        effects=[
            _EffectFile(kind=e.kind.kind, coefficients=e.to_dict())
            for e in model.effects
        ],
        field=model.field,
    )
    save_typed(_ModelFile, path, data)


def load_model(path: Path | str, own_effects: Sequence[EffectKind] = ()) -> GliderModel:
    """Loads a model; anything unknown in the file is an InputError.

    Args:
        path: of the file.
        own_effects: kinds that the library lacks and the file may name.
    """
    kinds = {**KINDS, **{e.kind: e for e in own_effects}}
    data = load_typed(_ModelFile, path, "a glider model")
    check_parameters(dataclasses.asdict(data.parameters), source=str(path))
    effects: list[Effect] = []
    for entry in data.effects:
        if entry.kind not in kinds:
            raise InputError(
                f"{path}: unknown effect '{entry.kind}'; known are {', '.join(kinds)} "
                "(an effect of your own must be given in own_effects)."
            )
        if any(entry.kind == effect.kind.kind for effect in effects):
            raise InputError(f"{path}: effect '{entry.kind}' is given twice.")
        try:
            effects.append(kinds[entry.kind](**entry.coefficients))
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
    if data.field is not None:
        try:
            make_field(data.field)
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
    return GliderModel(
        parameters=data.parameters, effects=tuple(effects), field=data.field
    )


def as_model(model: GliderModel | Path | str) -> GliderModel:
    """Returns a model as it is, or loaded where the path of its file is given.

    Raises:
        InputError: it is neither, or the file holds no model.
    """
    if isinstance(model, (str, Path)):
        return load_model(model)
    if not isinstance(model, GliderModel):
        raise InputError(
            f"a glider model: found {type(model).__name__}; a GliderModel or the "
            "path of its file is needed."
        )
    return model
