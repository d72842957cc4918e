"""The numbers of a glider whose logs are replayed: of the library and user effects."""

import functools

import numpy as np

from glider.compiled.replay import measure_nodes
from glider.compiled.user_effects import check_user_effects
from glider.physics.compose import compose, initial_extra
from glider.physics.effects import (
    FREE_FUNCTIONS,
    LIBRARY,
    NO_GAUSSIANS,
    Coefficient,
    EffectKind,
    Gaussians,
    Replay,
)
from glider.physics.model import GliderModel
from glider.physics.parameter_space import ParameterSpace, space_of


def _replay_log(before: Replay, poses: float, commands: float, drift: float) -> Replay:
    return before._replace(
        latency=before.latency + poses, delay=before.delay + commands, drift=drift
    )


def _no_change(flow, poses, commands, drift):
    return 0.0, 0.0, 0.0  # Logs are replayed through it; no model has it.


SERVO_LOG = EffectKind(
    kind="servo_log",
    stage="sensor",
    adds_to=("pose_x", "pose_z", "pose_pitch"),
    coefficients=tuple(
        Coefficient(name, "s", scale=0.02, lower=-0.3, upper=0.3)
        for name in ("poses", "commands", "drift")
    ),
    formula=_no_change,
    words="a servo's log with other clocks",
    replay=_replay_log,
)
"""Offset of the poses' clock from that of the servo's log, offset of the commands'
clock from that of the elevator, and drift of the first offset from a session's begin to
its end: no effects of the glider, but unknowns of its logs."""


@functools.cache
def log_space(user_kinds: tuple[EffectKind, ...]) -> ParameterSpace:
    """Returns the space of the library, user effects and SERVO_LOG.

    Raises:
        InputError: a user effect cannot be used.
    """
    check_user_effects(user_kinds)
    kinds = (*LIBRARY, *FREE_FUNCTIONS.values(), *user_kinds, SERVO_LOG)
    # A fault of the "log" stage is corrected before a log is replayed.
    return space_of(tuple(kind for kind in kinds if kind.stage != "log"), True)


LIBRARY_SPACE = log_space(())  # The space without user effects.


def log_space_of(model: GliderModel) -> ParameterSpace:
    """Returns the space of the library and of a model's user effects."""
    kinds = [effect.kind for effect in model.effects]
    return log_space(tuple(kind for kind in kinds if kind not in LIBRARY))


def vector_of(model: GliderModel) -> np.ndarray:
    """Returns the numbers of a model in its log space."""
    return log_space_of(model).pack(model.parameters, model.effects)


def sensed(
    space: ParameterSpace,
    nodes: np.ndarray,
    theta: np.ndarray,
    gaussians: Gaussians = NO_GAUSSIANS,
) -> np.ndarray:
    """Returns the pose (n, 3) that the sensors show of states (n, num_states)."""
    return measure_nodes(space.flown, nodes, theta, gaussians, with_slopes=False)[0]


def resting_states(
    space: ParameterSpace,
    time: float,
    state: np.ndarray,
    rate: float,
    theta: np.ndarray,
) -> np.ndarray:
    """Returns the effects' own states at rest in still air."""
    plate = compose()
    numbers = plate.theta_of(theta.tolist(), NO_GAUSSIANS)
    motion = plate.motion_of(time, state.tolist(), rate)
    flow = plate.flow_of(motion, 0.0, 0.0, numbers.p)
    return np.array(initial_extra(space, flow, rate, numbers.c))
