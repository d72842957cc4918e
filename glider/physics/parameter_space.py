"""The numbers of a glider as one vector: their names, places, bounds and units.

A vector holds the parameters of the vehicle and then the coefficients of some effects,
one effect after the other. Whatever changes, fits or draws numbers of a glider finds
them here by name: "wing_area" or "wind.x".
"""

import dataclasses
import functools
from collections.abc import Iterable

import numpy as np

from glider.physics.effects import KINDS, Coefficient, Effect, EffectKind, Replay
from glider.physics.parameters import NUM_PARAMETERS, PARAMETER_NAMES, GliderParameters
from glider.physics.state import NUM_STATES, STATE_NAMES

OF_VEHICLE = "parameters"
"""Owner of the numbers that no effect has."""


def _parameter(
    name: str, unit: str, lower: float = 1e-6, upper: float = 1e4
) -> Coefficient:
    return Coefficient(name, unit, scale=0.01, lower=lower, upper=upper)


_PARAMETERS = (
    _parameter("mass", "kg"),
    _parameter("pitch_inertia", "kg m²"),
    _parameter("wing_area", "m²"),
    _parameter("elevator_area", "m²"),
    _parameter("wing_offset", "m", lower=-0.1, upper=0.1),
    _parameter("hinge_offset", "m"),
    _parameter("elevator_offset", "m"),
    _parameter("air_density", "kg/m³"),
    _parameter("gravity", "m/s²"),
)


class ParameterSpace:
    """The numbers of a glider with some effects, and the states of these effects.

    Where logs are replayed, the effects that change the replay come last in the vector,
    and the dynamics that fly the log do not read them.
    """

    def __init__(self, kinds: tuple[EffectKind, ...], replays_logs: bool) -> None:
        """Takes effects in the order of their coefficients; see `space_of`."""
        self._replays_logs = replays_logs
        self._all = kinds
        #: By name; without free functions, which have no numbers here.
        self.kinds = {kind.kind: kind for kind in kinds if not kind.is_free}
        #: Effects on the signals of a log that is replayed.
        self.replayed: tuple[EffectKind, ...] = ()
        if replays_logs:
            self.replayed = tuple(kind for kind in kinds if kind.is_replayed)
        #: Effects that the dynamics hold.
        self.flown = tuple(kind for kind in kinds if kind not in self.replayed)
        entries = [*_PARAMETERS]
        owners = [OF_VEHICLE] * NUM_PARAMETERS
        names = [*PARAMETER_NAMES]
        self._slots: dict[str, tuple[int, ...]] = {}
        for kind in (*self.flown, *self.replayed):
            if kind.is_free:
                continue
            first = len(entries)
            entries += kind.coefficients
            owners += [kind.kind] * len(kind.coefficients)
            names += [f"{kind.kind}.{c.name}" for c in kind.coefficients]
            self._slots[kind.kind] = tuple(range(first, len(entries)))
        #: Name of each number: a parameter's, or "kind.coefficient".
        self.names = tuple(names)
        self.index = {name: i for i, name in enumerate(names)}  #: Place of a name.
        self.entries = tuple(entries)  #: Unit, bounds and scale of each number.
        self.owners = tuple(owners)  #: Effect of each number, or OF_VEHICLE.
        #: Smallest and largest physical values, and typical sizes.
        bounds = [(entry.lower, entry.upper, entry.scale) for entry in entries]
        self.lower, self.upper, self.scale = np.array(bounds).T.copy()
        self._defaults = np.array([entry.default for entry in entries])
        #: Number of leading entries that the dynamics read.
        self.num_flown = len(names)
        for kind in self.replayed:
            self.num_flown -= len(kind.coefficients)

        state_names = [*STATE_NAMES]
        scales = [1.0] * NUM_STATES
        #: Places of an effect's own states; those of actuators come first.
        self.states: dict[str, range] = {}
        for kind in sorted(self.flown, key=lambda k: k.stage != "actuator"):
            if not kind.states:
                continue
            first = len(state_names)
            state_names += [f"{kind.kind}.{name}" for name in kind.states]
            scales += kind.state_scales or [1.0] * len(kind.states)
            self.states[kind.kind] = range(first, len(state_names))
        #: STATE_NAMES, then "kind.state" of the effects' own.
        self.state_names = tuple(state_names)
        self.state_scale = np.array(scales)  #: Typical sizes of the states.
        self.num_states = len(state_names)

    def __reduce__(self):
        """Another process makes it once, of its own library."""
        sent = tuple(
            kind.kind if KINDS.get(kind.kind) is kind else kind for kind in self._all
        )
        return space_of, (sent, self._replays_logs)

    def slots_of(self, kind: str) -> tuple[int, ...]:
        """Returns the places of an effect's coefficients."""
        return self._slots.get(kind, ())

    def places(self, names: Iterable[str]) -> list[int]:
        """Returns the places of numbers by their names."""
        return [self.index[name] for name in names]

    @functools.cached_property
    def shapes(self) -> frozenset[int]:
        """Places of numbers that only shape an effect, whose size is another's."""
        found = set[int]()
        for slots in self._slots.values():
            shapes = {slot for slot in slots if self.entries[slot].is_shape}
            if len(shapes) < len(slots):
                found |= shapes
        return frozenset(found)

    def pack(
        self, parameters: GliderParameters, effects: Iterable[Effect] = ()
    ) -> np.ndarray:
        """Returns the vector of a vehicle and some effects; others do nothing.

        Effects that are not of the space are left out.
        """
        vector = self._defaults.copy()
        own = [getattr(parameters, name) for name in PARAMETER_NAMES]
        vector[:NUM_PARAMETERS] = own
        for effect in effects:
            if effect.kind.kind in self.kinds:
                vector[[*self.slots_of(effect.kind.kind)]] = effect.values
        return vector

    def unpack(
        self, vector: np.ndarray, like: GliderParameters
    ) -> tuple[GliderParameters, tuple[Effect, ...]]:
        """Returns the vehicle and the effects of a vector.

        Args:
            vector: of the space.
            like: a vehicle with the limits of the servo.

        Raises:
            InputError: a number is not physical.
        """
        values = vector.tolist()
        found = dict(zip(PARAMETER_NAMES, values, strict=False))
        effects = []
        for name, kind in self.kinds.items():
            slots = self.slots_of(name)
            own = {self.entries[slot].name: values[slot] for slot in slots}
            effects.append(kind(**own))
        return dataclasses.replace(like, **found), tuple(effects)

    def replay(self, vector: np.ndarray) -> Replay:
        """Returns how a log's signals are replayed."""
        found = Replay()
        values = vector.tolist()
        for kind in self.replayed:
            own = tuple(values[slot] for slot in self.slots_of(kind.kind))
            found = kind.replayed(found, own)
        return found

    def acting_states(self, vector: np.ndarray) -> list[int]:
        """Returns the places of the states that move a glider.

        Those of an effect do where any of its coefficients is not at its default.
        """
        found = [*range(NUM_STATES)]
        values = vector.tolist()
        for kind, states in self.states.items():
            slots = self.slots_of(kind)
            if any(values[i] != self.entries[i].default for i in slots):
                found += states
        return found

    @functools.cached_property
    def sensor_slots(self) -> tuple[int, ...]:
        """Places of what the sensors add to the pose."""
        found: tuple[int, ...] = ()
        for kind in self.flown:
            if kind.stage == "sensor":
                found += self.slots_of(kind.kind)
        return found


def space_of(
    kinds: tuple[EffectKind | str, ...], replays_logs: bool = False
) -> ParameterSpace:
    """Returns the space of some effects, the same object each time.

    Args:
        kinds: in the order of their coefficients; those of the library may be names.
        replays_logs: whether the vector is of a glider that replays logs, where
            actuators and clocks act on the log and are no part of the dynamics.
    """
    own = tuple(KINDS[kind] if isinstance(kind, str) else kind for kind in kinds)
    return _make_space(own, replays_logs)


_make_space = functools.cache(ParameterSpace)
