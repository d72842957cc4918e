"""A glider model as a file: the parameters, the effects, the free functions.

For example:

    parameters: {mass: 0.08, ...}
    effects:
      - {kind: wind, coefficients: {x: -0.6, z: 0.1}}
    free_functions:                                       # optional
      - {kind: unexplained, variables: [x], ...}
    flown: {x: [-3.5, 0.6], V: [2.1, 7.9]}                # where traced, optional
    covariance: {names: [wind.x, wind.z], matrix: [[1e-6, 0], [0, 1e-6]]}     # optional
    origin: {source: throws, date: ..., version: ..., standard_errors: {wind.x: 0.001}}
"""

import dataclasses
import functools
import math
import types
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Never

import numpy as np
from numpy.typing import ArrayLike

from glider.errors import InputError, expect, show
from glider.files import schema
from glider.files.writing import write_text
from glider.paths import shipped_path
from glider.physics.chain import theta_of
from glider.physics.compose import compose, initial_extra
from glider.physics.covariance import Covariance, check_names
from glider.physics.effects import FREE_FUNCTIONS, KINDS, Effect, EffectKind, Gaussians
from glider.physics.effects.free_functions import FLOW_UNITS, FreeFunction, gaussians_of
from glider.physics.parameter_space import ParameterSpace, space_of
from glider.physics.parameters import (
    NUM_PARAMETERS,
    GliderParameters,
    Theta,
    check_units,
)
from glider.physics.state import NUM_STATES

_TINY = 1e-30
"""Length of a complex step."""

_IN_MOTION = (-1.0, 0.3, -0.2, 0.1, 6.0, -1.0, 0.5)
"""A state of STATE_NAMES in which nothing is divided by zero."""

STABLE = {1: 1.0, 4: 2.0}
"""Longest step times the largest rate |λ| of the effects' own states, by the order of
the integrator: 1 for explicit Euler, 4 for the classical Runge-Kutta.

Within it a state that forgets does so: with Runge-Kutta at any damping, with Euler at
one above a half. For a real λ they are stable to 2 and to 2.79."""

SHORTEST = 2e-5
"""Shortest step that is worth its time [s]: 1000 of them to a command."""


_Ranges = Mapping[str, tuple[float, float]]
"""Maps one of FLOW_UNITS to its least and largest value in the flights, in its unit."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class GliderModel:
    """A glider: the flat-plate vehicle and what it lacks.

    Attributes:
        parameters: the vehicle.
        effects: from the library, or custom ones. One with states whose
            coefficients are all zero, as a servo_lag of no duration, does not act.
        free_functions: effects whose coefficient is a function, as data.
        flown: range of each variable that effects and free functions depend on, in
            the flights that they were traced on; empty where they were not. It does
            not change how the glider flies.

    Raises:
        InputError: a field is not of its type, or an effect is given twice.
    """

    parameters: GliderParameters = dataclasses.field(default_factory=GliderParameters)
    effects: tuple[Effect, ...] = ()
    free_functions: tuple[FreeFunction, ...] = ()
    flown: _Ranges = dataclasses.field(default_factory=dict, compare=False, repr=False)

    def __init__(
        self,
        *,
        parameters: GliderParameters | None = None,
        effects: Sequence[Effect] = (),
        free_functions: Sequence[FreeFunction] = (),
        flown: _Ranges | None = None,
        **unknown: Never,
    ):
        """Sets the fields; whatever else is given is an InputError."""
        if unknown:
            raise InputError(
                f"GliderModel: unknown field '{next(iter(unknown))}'; expected "
                "parameters=GliderParameters(mass=..., ...), effects=(WIND(x=...), ...)"
                " or free_functions."
            )
        parameters = GliderParameters() if parameters is None else parameters
        good = isinstance(parameters, GliderParameters)
        expected = "GliderParameters(mass=..., ...)"
        expect(good, "GliderModel: 'parameters'", parameters, expected)
        _check_effects(effects)
        what = "GliderModel: 'free_functions'"
        good = isinstance(free_functions, (tuple, list))
        good = good and all(isinstance(own, FreeFunction) for own in free_functions)
        expected = "free functions such as (FreeFunction(variables=['x'], ...),)"
        expect(good, what, free_functions, expected)
        object.__setattr__(self, "parameters", parameters)
        object.__setattr__(self, "effects", tuple(effects))
        object.__setattr__(self, "free_functions", tuple(free_functions))
        ranges = dict(flown or {})
        _check_ranges(ranges)
        object.__setattr__(self, "flown", ranges)

    def __getstate__(self) -> dict[str, object]:
        """Returns the fields alone: composed functions do not pickle."""
        return {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}

    @functools.cached_property
    def kinds(self) -> tuple[EffectKind, ...]:
        """Kinds of the effects that act, all free functions where there is one."""
        acting = [
            effect.kind
            for effect in self.effects
            if not effect.kind.states or effect.values != effect.kind.defaults
        ]
        # All of them: what is compiled for one serves any other.
        return (*acting, *(FREE_FUNCTIONS.values() if self.free_functions else ()))

    @functools.cached_property
    def space(self) -> ParameterSpace:
        """Names, places and bounds of the numbers of the dynamics."""
        return space_of(self.kinds)

    @functools.cached_property
    def vector(self) -> np.ndarray:
        """All numbers of the dynamics, in the order of `space`; read-only."""
        vector = self.space.pack(self.parameters, self.effects)
        vector.setflags(write=False)
        return vector

    @property
    def state_names(self) -> tuple[str, ...]:
        """STATE_NAMES, then the effects' own states."""
        return self.space.state_names

    @property
    def num_states(self) -> int:
        """Number of states n, the effects' own included."""
        return self.space.num_states

    @property
    def numbers(self) -> Theta:
        """All parameters of the dynamics; its arrays are read-only."""
        # Floats are faster than NumPy's; compiled code takes an array.
        theta = theta_of(self.vector.tolist(), self.gaussians)
        return theta._replace(c=self.vector[NUM_PARAMETERS:].copy())

    @functools.cached_property
    def gaussians(self) -> Gaussians:
        """The arrays of the free functions, read-only."""
        return gaussians_of(self.free_functions)

    @property
    def chain(self) -> types.SimpleNamespace:
        """The dynamics as functions of scalars, see `compose`."""
        return compose(self.kinds)

    @functools.cached_property
    def is_time_varying(self) -> bool:
        """Whether the same state flies differently at another time.

        A time that is no number reaches all that is computed from it.
        """
        x = self.initial_state(_IN_MOTION)
        rates = self.chain.derivatives(math.nan, x, 1.0, 0.0, 0.0, self.numbers)
        return bool(np.any(np.isnan(rates)))

    @functools.cached_property
    def settling_rate(self) -> float:
        """Largest rate |λ| at which the effects' own states settle [1/s]; 0 for none.

        λ are the eigenvalues of the slopes of the states' rates by these states.
        """
        x = self.initial_state(_IN_MOTION).astype(complex)
        own = slice(NUM_STATES, len(x))
        slopes = []
        for unit in np.eye(len(x))[own]:
            moved = x + 1j * _TINY * unit
            theta = self.numbers
            rates = self.chain.derivatives(0.0, moved, 0.0, 0.0, 0.0, theta)
            slopes.append(np.imag(rates[own]) / _TINY)
        return float(max(np.abs(np.linalg.eigvals(slopes)))) if slopes else 0.0

    def longest_step(self, order: int = 4) -> float:
        """Longest integration step that the effects' own states allow [s].

        Such a state may be far quicker than the glider: a servo that follows its
        command with a lag τ forgets at the rate 1/τ. Explicit steps must be short
        beside that, or they swing up without bound. Infinite without such a state. The
        integrator's order is 1 or 4.

        Raises:
            InputError: it is so short that the effect should be omitted.
        """
        if not self.settling_rate > 0.0:
            return math.inf
        step = STABLE[order] / self.settling_rate
        if step < SHORTEST:
            states = ", ".join(self.state_names[NUM_STATES:])
            raise InputError(
                f"the model's effects have states ({states}) of which one settles "
                f"within {show(1.0 / self.settling_rate)} s; expected at least "
                f"{SHORTEST / STABLE[order]:g} s, or a model without that effect, "
                "which flies the same."
            )
        return step

    def count_laps(self, step: float, order: int = 4) -> int:
        """Number of equal parts into which `longest_step` divides a step [s]."""
        return max(math.ceil(step / self.longest_step(order) - 1e-9), 1)

    def initial_state(self, state: ArrayLike) -> np.ndarray:
        """Returns the full state in still air with the effects' own states at rest.

        Args:
            state: (7,) of STATE_NAMES, or already the full one (n,); or many of them,
                the columns of (7, B) or (n, B).

        Raises:
            InputError: where the length is neither.
        """
        x = np.asarray(state, dtype=float)
        n = self.num_states
        if len(x) == n:
            return x
        sizes = " or ".join(map(str, sorted({NUM_STATES, n})))
        what = "initial_state: the length of the state"
        expect(len(x) == NUM_STATES, what, len(x), sizes)
        theta = self.numbers
        # The flow of the plates depends on no effect's states.
        full = np.concatenate([x, np.zeros((n - NUM_STATES, *x.shape[1:]))])
        flow, _ = self.chain.meet_air(0.0, full, 0.0, 0.0, 0.0, theta)
        for k, value in enumerate(initial_extra(self.space, flow, 0.0, theta.c)):
            full[NUM_STATES + k] = value
        return full

    @classmethod
    def load(
        cls, path: Path | str, own_effects: Sequence[EffectKind] = ()
    ) -> "GliderModel":
        """Loads a model; anything unknown in the file is an InputError.

        A vehicle's file is a model without effects. What the file's origin warns of,
        such as a verdict, is a UserWarning.

        Args:
            path: of the file, or the name of one in models/truths.
            own_effects: custom kinds that the file may name.
        """
        model, file = _load(path, own_effects)
        for warning in file.origin.warnings if file.origin else ():
            warnings.warn(f"{path}: {warning}", stacklevel=2)
        return model

    def save(
        self,
        path: Path | str,
        origin: "Origin | None" = None,
        covariance: Covariance | None = None,
    ) -> None:
        """Writes a model; `load` gives it back unchanged."""
        write_text(Path(path), model_text(self, origin, covariance))


def _check_ranges(ranges: _Ranges) -> None:
    """Raises InputError where ranges are none."""
    expected = "the least and the largest value of one of " + ", ".join(FLOW_UNITS)
    for name, ends in ranges.items():
        numbers = np.array(ends, dtype=float) if np.size(ends) == 2 else np.array([])
        fits = len(numbers) == 2 and -np.inf < numbers[0] <= numbers[1] < np.inf
        expect(name in FLOW_UNITS and fits, f"flown: '{name}'", ends, expected)


def _check_effects(effects: Any) -> None:
    """Raises InputError where effects are not some, or one is given twice."""
    what = "GliderModel: 'effects'"
    expected = "effects such as (WIND(x=-0.5),)"
    expect(isinstance(effects, (tuple, list)), what, effects, expected)
    for effect in effects:
        if isinstance(effect, EffectKind):
            expected = f"it with coefficients, ({effect}(...),)"
        expect(isinstance(effect, Effect), f"{what}: one of them", effect, expected)
    names = [effect.kind.kind for effect in effects]
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise InputError(f"GliderModel: effect '{twice[0]}' is given twice.")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Origin:
    """Where a model comes from, for people: it does not change how it flies."""

    source: str = ""  #: What it was made of: a campaign's folder.
    date: str = ""  #: When, as ISO 8601.
    version: str = ""  #: Of this package.
    #: Of what was fitted: "kind.coefficient" or a parameter's name, in its unit.
    standard_errors: dict[str, float] = dataclasses.field(default_factory=dict)
    #: What was assumed, as sentences.
    notes: list[str] = dataclasses.field(default_factory=list)
    #: What whoever flies the model should know, as sentences.
    warnings: list[str] = dataclasses.field(default_factory=list)


@dataclasses.dataclass(frozen=True, kw_only=True)
class _EffectFile:
    kind: str
    coefficients: dict[str, float] = dataclasses.field(default_factory=dict)


@dataclasses.dataclass(frozen=True, kw_only=True)
class _ModelFile:
    parameters: GliderParameters = dataclasses.field(default_factory=GliderParameters)
    effects: list[_EffectFile] = dataclasses.field(default_factory=list)
    free_functions: list[FreeFunction] = dataclasses.field(default_factory=list)
    flown: dict[str, tuple[float, float]] | None = None
    covariance: Covariance | None = None
    origin: Origin | None = None


def model_text(
    model: GliderModel,
    origin: Origin | None = None,
    covariance: Covariance | None = None,
) -> str:
    """Returns the text of a model's file."""
    effects = [
        _EffectFile(kind=e.kind.kind, coefficients=e.to_dict()) for e in model.effects
    ]
    return schema.yaml_text(
        _ModelFile(
            parameters=model.parameters,
            effects=effects,
            free_functions=[*model.free_functions],
            flown=dict(model.flown) or None,
            covariance=covariance,
            origin=origin,
        )
    )


def load_covariance(
    path: Path | str, own_effects: Sequence[EffectKind] = ()
) -> Covariance | None:
    """Loads the covariance in a model's file, or None; see `GliderModel.load`."""
    return _load(path, own_effects)[1].covariance


def _load(
    path: Path | str, own_effects: Sequence[EffectKind]
) -> tuple[GliderModel, _ModelFile]:
    path = shipped_path(path, "truths")
    text = schema.read_text(path, "a glider model")
    return _parse(text, str(path), own_effects)


def parse_model(text: str, source: str) -> GliderModel:
    """Returns the model in a text.

    Raises:
        InputError: the text is no model's, with the source before it.
    """
    return _parse(text, source, ())[0]


def _parse(
    text: str, source: str, own_effects: Sequence[EffectKind]
) -> tuple[GliderModel, _ModelFile]:
    """Returns the model in a text, and all of the text."""
    data = schema.parse_yaml(text, source)
    fields = [field.name for field in dataclasses.fields(GliderParameters)]
    if isinstance(data, dict) and not data.keys().isdisjoint(fields):
        parameters = schema.convert(data, GliderParameters, source)
        file = _ModelFile(parameters=parameters)
        given = data
    else:
        file = schema.convert(data, _ModelFile, source)
        given = data.get("parameters", {}) if isinstance(data, dict) else {}
    kinds = KINDS | {e.kind: e for e in own_effects}
    try:
        check_units(given)
        for entry in file.effects:
            if entry.kind not in kinds:
                raise InputError(
                    f"unknown effect '{entry.kind}'; expected one of "
                    f"{', '.join(kinds)}, or a custom effect given in own_effects."
                )
        effects = [kinds[entry.kind](**entry.coefficients) for entry in file.effects]
        gaussians_of(file.free_functions)  # It refuses what is malformed.
        model = GliderModel(
            parameters=file.parameters,
            effects=effects,
            free_functions=file.free_functions,
            flown=file.flown,
        )
        if file.covariance is not None:
            check_names(file.covariance.names, effects)
    except InputError as error:
        raise InputError(f"{source}: {error}") from None
    if missing := [name for name in fields if name not in given]:
        warnings.warn(
            f"{source}: {', '.join(missing)} not given; the values of the article's "
            "glider are taken.",
            stacklevel=4,  # Where a model is loaded.
        )
    return model, file


def as_model(model: GliderModel | Path | str) -> GliderModel:
    """Returns a model as it is, or loaded where the path of its file is given.

    Raises:
        InputError: it is neither, or the file holds no model.
    """
    if isinstance(model, (str, Path)):
        return GliderModel.load(model)
    if not isinstance(model, GliderModel):
        raise InputError(
            f"a glider model: found {type(model).__name__}; expected a GliderModel or "
            "the path of its file, or the name of one in models/truths."
        )
    return model
