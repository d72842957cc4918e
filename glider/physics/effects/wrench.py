"""Effects that add a force or a moment."""

from glider.physics.effects.effect import (
    Coefficient,
    EffectKind,
)
from glider.physics.formulas import scalar


@scalar
def dynamic_pressure_area(flow):
    """½ ρ V S_w, so that times a velocity it is a force [N s/m]."""
    return 0.5 * flow.air_density * flow.speed * flow.wing_area


@scalar
def _profile_drag(flow, cd0):
    size = -cd0 * dynamic_pressure_area(flow)
    return size * flow.air_x, size * flow.air_z


@scalar
def _pitch_damping(flow, coefficient):
    return -coefficient * dynamic_pressure_area(flow) * flow.pitchdot


@scalar
def _pitch_moment(flow, coefficient):
    return coefficient * dynamic_pressure_area(flow) * flow.speed


@scalar
def _thrust(flow, force):
    return force * flow.cos_pitch, -force * flow.sin_pitch


PROFILE_DRAG = EffectKind(
    kind="profile_drag",
    stage="wrench",
    adds_to=("force_x", "force_z"),
    coefficients=(Coefficient(name="cd0", unit="-", scale=0.05, lower=0.0, upper=2.0),),
    formula=_profile_drag,
    words="profile drag of wing, fuselage and tail",
    depends_on=("V",),
)
"""Profile drag: D = ½ ρ V² S_w cd0 against the velocity through the air."""

PITCH_DAMPING = EffectKind(
    kind="pitch_damping",
    stage="wrench",
    adds_to=("moment",),
    coefficients=(
        Coefficient(name="coefficient", unit="m²", scale=0.004, lower=-1.0, upper=1.0),
    ),
    formula=_pitch_damping,
    words="pitch damping beyond the tail's",
    depends_on=("pitchdot", "V"),
)
"""Pitch damping: M = -½ ρ V S_w · coefficient · pitch rate (no chord is known,
so the coefficient carries m²)."""

PITCH_MOMENT = EffectKind(
    kind="pitch_moment",
    stage="wrench",
    adds_to=("moment",),
    coefficients=(
        Coefficient(name="coefficient", unit="m", scale=0.001, lower=-1.0, upper=1.0),
    ),
    formula=_pitch_moment,
    words="a constant pitching-moment coefficient (camber)",
    depends_on=("V",),
)
"""Pitch moment: M = ½ ρ V² S_w · coefficient, positive nose down."""

THRUST = EffectKind(
    kind="thrust",
    stage="wrench",
    adds_to=("force_x", "force_z"),
    coefficients=(
        Coefficient(name="force", unit="N", scale=0.05, lower=-20.0, upper=20.0),
    ),
    formula=_thrust,
    words="a constant force along the body axis",
    depends_on=("pitch",),
)
"""Thrust: a constant force along the body axis (cos pitch, -sin pitch)."""
