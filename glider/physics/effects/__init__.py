"""The library of effects: what a flat-plate glider may lack."""

from glider.physics.effects.effect import (
    STAGES,
    Coefficient,
    Effect,
    EffectKind,
    Flow,
    Motion,
    Replay,
)
from glider.physics.effects.field import FIELD_TERMS, FIELD_VARIABLES, NO_FIELD, Field
from glider.physics.effects.geometry import (
    CENTER_OF_PRESSURE,
    DOWNWASH,
    ELEVATOR_BLOWBACK,
    ELEVATOR_TRIM,
    STALLED_DOWNWASH,
    WIND,
    WIND_SHEAR,
    WING_INCIDENCE,
)
from glider.physics.effects.signals import (
    ANGLE_SIGN,
    COMMAND_DELAY,
    FRAME_TILT,
    MARKER_OFFSET,
    PITCH_OFFSET,
    POSE_LATENCY,
    POSITION_SCALE,
    SERVO_LAG,
)
from glider.physics.effects.surface import (
    AIRSPEED_DEPENDENCE,
    ATTACHED_LIFT,
    CAMBER,
    DYNAMIC_STALL,
    ELEVATOR_AREA,
    GROUND_EFFECT,
    PITCH_RATE_LIFT,
    TAIL_WAKE,
)
from glider.physics.effects.wrench import (
    ADDED_MASS,
    AXIAL_DRAG,
    INDUCED_DRAG,
    INERTIA,
    MASS,
    PITCH_DAMPING,
    PITCH_MOMENT,
    PROFILE_DRAG,
    THRUST,
)
from glider.physics.formulas import scalar

LIBRARY: tuple[EffectKind, ...] = (
    SERVO_LAG,
    COMMAND_DELAY,
    WIND,
    WIND_SHEAR,
    WING_INCIDENCE,
    ELEVATOR_TRIM,
    ELEVATOR_BLOWBACK,
    CENTER_OF_PRESSURE,
    DOWNWASH,
    STALLED_DOWNWASH,
    ATTACHED_LIFT,
    CAMBER,
    PITCH_RATE_LIFT,
    DYNAMIC_STALL,
    AIRSPEED_DEPENDENCE,
    GROUND_EFFECT,
    TAIL_WAKE,
    ELEVATOR_AREA,
    PROFILE_DRAG,
    INDUCED_DRAG,
    AXIAL_DRAG,
    PITCH_DAMPING,
    PITCH_MOMENT,
    THRUST,
    MASS,
    INERTIA,
    ADDED_MASS,
    MARKER_OFFSET,
    POSE_LATENCY,
    FRAME_TILT,
    POSITION_SCALE,
    PITCH_OFFSET,
    ANGLE_SIGN,
)
"""All effects that the tracer tries. A new effect is one line here."""

KINDS = {effect.kind: effect for effect in LIBRARY}
