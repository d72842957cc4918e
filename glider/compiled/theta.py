"""The layout of the vector theta: the parameters and coefficients of a model.

While flights are simulated or fitted, a model is one vector theta: the nominal
parameters, then the coefficients of every effect that the compiled dynamics hold (the
whole library's and the user's; at their defaults they do nothing), and last those of
the effects on the log's signals, which are replayed instead.
"""

import functools
import itertools

import numpy as np

from glider.compiled import filter_error, replay
from glider.compiled.user_effects import check_user_effects
from glider.physics.compose import compose, initial_extra
from glider.physics.effects import (
    LIBRARY,
    NO_FIELD,
    Coefficient,
    EffectKind,
    Field,
    Replay,
)
from glider.physics.model import GliderModel
from glider.physics.parameters import (
    NUM_PARAMETERS,
    PARAMETER_NAMES,
    GliderParameters,
    Parameters,
)
from glider.physics.state import NUM_STATES

OFFSET = 3
"""Index of the elevator's state: where a log is flown, x[OFFSET] is its constant offset
from its replayed path [rad]."""


def _replay_log(before: Replay, poses: float, commands: float, _: float) -> Replay:
    latency, delay = before.latency + poses, before.delay + commands
    return before._replace(latency=latency, delay=delay)


def _no_change(flow, poses, commands, pitch_rate):
    return 0.0, 0.0, 0.0  # Logs are replayed through it; no model has it.


SERVO_LOG = EffectKind(
    kind="servo_log",
    stage="sensor",
    adds_to=("pose_x", "pose_z", "pose_pitch"),
    coefficients=(
        Coefficient("poses", "s", scale=0.02, lower=-0.3, upper=0.3),
        Coefficient("commands", "s", scale=0.02, lower=-0.3, upper=0.3),
        Coefficient("pitch_rate", "rad/s", scale=0.05, lower=-1.0, upper=1.0),
    ),
    formula=_no_change,
    words="a servo's log with other clocks",
    replay=_replay_log,
)
"""Times of poses against those of the servo's log, of commands against those of the
elevator, and the bias of a gyro: no effect of the glider, but unknowns of logs that do
not show them."""


class Layout:
    """Meaning of each entry of theta and of a flown state; see the module."""

    def __init__(self, user_kinds: tuple[EffectKind, ...]) -> None:
        check_user_effects(user_kinds)
        kinds = (*LIBRARY, *user_kinds, SERVO_LOG)
        flown = [e for e in kinds if e.stage != "log"]
        self.user_kinds = user_kinds  #: User effects, beside the library's.
        self.kinds = {e.kind: e for e in kinds}  #: By name.
        #: Effects that the compiled dynamics hold.
        self.compiled_kinds = tuple(e for e in flown if not e.is_replayed)
        #: Effects on clocks and paths of the log's signals.
        self.replayed_kinds = tuple(e for e in flown if e.is_replayed)
        entries = [
            (e.kind, c)
            for e in (*self.compiled_kinds, *self.replayed_kinds)
            for c in e.coefficients
        ]
        #: Kind and coefficient of each entry; a vehicle's are of the kind "parameters".
        self.slots = (
            *(("parameters", name) for name in PARAMETER_NAMES),
            *((kind, c.name) for kind, c in entries),
        )
        self.index = {slot: i for i, slot in enumerate(self.slots)}
        self.coefficients = {self.index[kind, c.name]: c for kind, c in entries}
        sized = {kind for kind, c in entries if not c.is_shape}
        #: Entries that only shape an effect that has another for its size.
        self.shapes = {
            i
            for i, c in self.coefficients.items()
            if c.is_shape and self.slots[i][0] in sized
        }
        self._places: dict[str, tuple[int, ...]] = {}
        for i, (kind, _) in enumerate(self.slots):
            self._places[kind] = (*self._places.get(kind, ()), i)
        bounds = [
            (-0.1, 0.1, 0.01) if name == "wing_offset" else (1e-6, 1e4, 0.01)
            for name in PARAMETER_NAMES
        ] + [(c.lower, c.upper, c.scale) for _, c in entries]
        #: Smallest and largest physical values, and typical sizes.
        self.lower, self.upper, self.scale = np.array(bounds).T.copy()
        held = self.compiled_kinds
        #: Entries of theta that the compiled dynamics take, the first.
        self.num_compiled = NUM_PARAMETERS + sum(len(e.coefficients) for e in held)
        #: States of the effects that have some, by their names; and typical sizes.
        self.states, scales = dict[str, list[int]](), [1.0] * NUM_STATES
        for e in held:
            if e.states:
                self.states[e.kind] = [len(scales) + k for k in range(len(e.states))]
                scales += e.state_scales or [1.0] * len(e.states)
        self.state_scale, self.num_states = np.array(scales), len(scales)
        sensors = (e.kind for e in held if e.stage == "sensor")
        #: Entries of the compiled sensor effects.
        self.sensor_slots = tuple(i for kind in sensors for i in self.slots_of(kind))

    def __reduce__(self):
        """Another process makes it from the user effects, once."""
        return layout_of, (self.user_kinds,)

    def slots_of(self, kind: str) -> tuple[int, ...]:
        """Indices of a kind's coefficients in theta."""
        return self._places.get(kind, ())

    def label(self, slot: int) -> str:
        """Name of an entry of theta: of a parameter, or "kind.coefficient"."""
        return ".".join(self.slots[slot]).removeprefix("parameters.")

    def default_theta(self, parameters: GliderParameters) -> np.ndarray:
        """Returns theta of a nominal model: parameters, and effects that do nothing."""
        defaults = [c.default for c in self.coefficients.values()]
        return np.concatenate([parameters.numbers, defaults])

    def active_states(self, theta: np.ndarray) -> list[int]:
        """Indices of the states that move a glider: of effects that do something."""
        found = list(range(NUM_STATES))
        for kind, states in self.states.items():
            slots = self.slots_of(kind)
            if any(theta[i] != self.coefficients[i].default for i in slots):
                found += states
        return found

    def dynamics(self, theta: np.ndarray) -> np.ndarray:
        """Returns the part of theta that the compiled dynamics take."""
        return theta[: self.num_compiled]

    def sensed(
        self, nodes: np.ndarray, theta: np.ndarray, field: Field = NO_FIELD
    ) -> np.ndarray:
        """Returns the pose (n, 3) that the sensors show of states (n, num_states)."""
        dynamics = self.dynamics(theta)
        return replay.measure_nodes(
            self.compiled_kinds, nodes, dynamics, field, with_slopes=False
        )[0]

    def replay(self, theta: np.ndarray) -> Replay:
        """Settings for the replay of a log's signals, of the last entries."""
        values, found = iter(theta[self.num_compiled :].tolist()), Replay()
        for kind in self.replayed_kinds:
            own = itertools.islice(values, len(kind.coefficients))
            found = kind.replayed(found, tuple(own))
        return found

    def steady_states(
        self, time: float, state: np.ndarray, rate: float, theta: np.ndarray
    ) -> np.ndarray:
        """Returns the effects' states at rest in still air."""
        plate = compose()
        motion = plate.motion_of(time, state.tolist(), rate)
        parameters = Parameters(*theta[:NUM_PARAMETERS].tolist())
        flow = plate.flow_of(motion, 0.0, 0.0, parameters)
        c = theta[NUM_PARAMETERS : self.num_compiled].tolist()
        return np.array(initial_extra(self.compiled_kinds, flow, rate, c))


@functools.cache
def layout_of(user_kinds: tuple[EffectKind, ...]) -> Layout:
    """Returns the layout of the library and of user effects.

    Raises:
        InputError: a user effect cannot be used.
    """
    return Layout(user_kinds)


LIBRARY_LAYOUT = layout_of(())  # Layout without user effects.


def layout_for(model: GliderModel) -> Layout:
    """Returns the layout of the library and of a model's user effects."""
    return layout_of(tuple(e.kind for e in model.effects if e.kind not in LIBRARY))


def theta_of(model: GliderModel) -> np.ndarray:
    """Returns a model's parameters and coefficients as its layout has them."""
    layout = layout_for(model)
    theta = layout.default_theta(model.parameters)
    for effect in model.effects:
        if effect.kind.stage != "log":
            theta[list(layout.slots_of(effect.kind.kind))] = effect.values
    return theta


def warm_up(layout: Layout = LIBRARY_LAYOUT) -> None:
    """Compiles the loops, or loads them where they have been compiled before."""
    filter_error.filter_flight(*filter_error.no_flight())
    filter_error.smooth_flight(np.zeros(0), *filter_error.no_flight())
    filter_error.score_flight(*np.zeros((4, 0)), *filter_error.no_flight())
    kinds, none = layout.compiled_kinds, np.zeros(3)
    theta = layout.dynamics(layout.default_theta(GliderParameters()))
    nodes = np.zeros((3, layout.num_states))
    nodes[:, 4] = 7.0
    path = replay.log_path(0.01 * np.arange(3.0), np.zeros((2, 3)), np.zeros(2))
    replay.with_extras(kinds, path, nodes[None], theta[None], NO_FIELD)
    replay.advance_nodes(kinds, [path], [nodes], [theta], NO_FIELD)
    replay.measure_nodes(kinds, nodes, theta)
    replay.roll_out(kinds, path, nodes[0], theta, NO_FIELD)
    replay.flow_at(kinds, path.times, nodes, none, none, theta, NO_FIELD)
