"""The library of effects: what a flat-plate glider may lack."""

from glider.physics.effects import geometry, signals, surface, wrench
from glider.physics.effects.effect import (
    STAGES,
    Coefficient,
    Effect,
    EffectKind,
    Flow,
    Motion,
    Replay,
)
from glider.physics.effects.free_functions import (
    FLOW_VARIABLES,
    FREE_FUNCTIONS,
    NO_GAUSSIANS,
    Gaussians,
)
from glider.physics.effects.geometry import (
    CENTER_OF_PRESSURE,
    DOWNWASH,
    ELEVATOR_BLOWBACK,
    ELEVATOR_SCALE,
    ELEVATOR_TRIM,
    LAGGED_DOWNWASH,
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
    LAGGED_SEPARATION,
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

_KINDS = [
    kind
    for module in (signals, geometry, surface, wrench)
    for kind in vars(module).values()
    if isinstance(kind, EffectKind)
]
LIBRARY = tuple(sorted(_KINDS, key=lambda kind: [*STAGES].index(kind.stage)))
"""All effects that the tracer tries, by stage: those of the modules here."""

KINDS = {effect.kind: effect for effect in LIBRARY}
