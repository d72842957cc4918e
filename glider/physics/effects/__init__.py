"""The library of effects: what a flat-plate glider may lack."""

from glider.physics.effects.actuator import (
    COMMAND_DELAY,
    SERVO_LAG,
)
from glider.physics.effects.air import WIND
from glider.physics.effects.effect import (
    STAGES,
    Coefficient,
    Effect,
    EffectKind,
    Flow,
    Motion,
    Replay,
)
from glider.physics.effects.field import (
    FIELD_TERMS,
    FIELD_VARIABLES,
    NO_FIELD,
    Field,
)
from glider.physics.effects.geometry import (
    CENTER_OF_PRESSURE,
    DOWNWASH,
    ELEVATOR_TRIM,
    WING_INCIDENCE,
)
from glider.physics.effects.inertia import (
    ADDED_MASS,
    INERTIA,
    MASS,
)
from glider.physics.effects.sensor import (
    ANGLE_SIGN,
    FRAME_TILT,
    MARKER_OFFSET,
    PITCH_OFFSET,
    POSE_LATENCY,
)
from glider.physics.effects.surface import (
    AIRSPEED_DEPENDENCE,
    ATTACHED_LIFT,
    DYNAMIC_STALL,
    ELEVATOR_AREA,
    GROUND_EFFECT,
    TAIL_WAKE,
)
from glider.physics.effects.wrench import (
    PITCH_DAMPING,
    PITCH_MOMENT,
    PROFILE_DRAG,
    THRUST,
)

LIBRARY: tuple[EffectKind, ...] = (
    SERVO_LAG,
    COMMAND_DELAY,
    WIND,
    WING_INCIDENCE,
    ELEVATOR_TRIM,
    CENTER_OF_PRESSURE,
    DOWNWASH,
    ATTACHED_LIFT,
    DYNAMIC_STALL,
    AIRSPEED_DEPENDENCE,
    GROUND_EFFECT,
    TAIL_WAKE,
    ELEVATOR_AREA,
    PROFILE_DRAG,
    PITCH_DAMPING,
    PITCH_MOMENT,
    THRUST,
    MASS,
    INERTIA,
    ADDED_MASS,
    MARKER_OFFSET,
    POSE_LATENCY,
    FRAME_TILT,
    PITCH_OFFSET,
    ANGLE_SIGN,
)
"""Every effect that the tracer tries; a new one is one line here."""

KINDS = {effect.kind: effect for effect in LIBRARY}
