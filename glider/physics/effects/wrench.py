"""Effects on the whole body: forces and moments, mass and inertia."""

import numpy as np

from glider.physics.effects.effect import (
    LIFT_BY_RATE,
    MOMENT_BY_RATE,
    Coefficient,
    EffectKind,
    constant,
)
from glider.physics.formulas import scalar

_DRAGS = ("drag over alpha", "axial force over alpha")

_TURN = 0.01
"""Smooths the sign of cos α where the stream comes from below or above, over about
0.1 rad."""


@scalar
def dynamic_pressure_area(flow):
    """½ ρ V S_w, so that times a velocity it is a force [N s/m]."""
    return 0.5 * flow.air_density * flow.speed * flow.wing_area


@scalar
def _profile_drag(flow, cd0):
    size = -cd0 * dynamic_pressure_area(flow)
    return size * flow.air_x, size * flow.air_z


@scalar
def _induced_drag(flow, k):
    lift = 2.0 * flow.sin_alpha * flow.cos_alpha
    return _profile_drag(flow, k * lift * lift)


@scalar
def _axial_drag(flow, ca0, backward):
    cosine = flow.cos_alpha
    ahead = 0.5 + 0.5 * cosine / np.sqrt(cosine * cosine + _TURN)
    share = np.sqrt(1.0 + _TURN) * (ahead - backward * (1.0 - ahead))
    size = -ca0 * dynamic_pressure_area(flow) * flow.speed * share
    return size * flow.cos_pitch, -size * flow.sin_pitch


@scalar
def _pitch_damping(flow, coefficient):
    return -coefficient * dynamic_pressure_area(flow) * flow.pitchdot


@scalar
def _pitch_moment(flow, coefficient):
    return coefficient * dynamic_pressure_area(flow) * flow.speed


@scalar
def _thrust(flow, force):
    return force * flow.cos_pitch, -force * flow.sin_pitch


@scalar
def _added_mass(flow, mass, inertia, coupling):
    return mass, inertia, coupling


PROFILE_DRAG = EffectKind(
    kind="profile_drag",
    stage="wrench",
    adds_to=("force_x", "force_z"),
    coefficients=(Coefficient("cd0", "-", scale=0.05, lower=0.0, upper=2.0),),
    formula=_profile_drag,
    words="profile drag of wing, fuselage and tail",
    depends_on=("V",),
    like=("angle_sign",),
    is_common=True,
    families=_DRAGS,
    bent_by=("drag", "axial force"),
    is_likely=True,
)
"""Profile drag: D = ½ ρ V² S_w cd0 against the velocity through the air."""

INDUCED_DRAG = EffectKind(
    kind="induced_drag",
    stage="wrench",
    adds_to=("force_x", "force_z"),
    coefficients=(Coefficient("k", "-", scale=0.05, lower=0.0, upper=2.0),),
    formula=_induced_drag,
    words="induced drag: drag that grows with the square of lift",
    depends_on=("alpha", "V"),
    is_common=True,
    families=_DRAGS,
    bent_by=("drag", "axial force"),
)
"""Induced drag: D = ½ ρ V² S_w k C_L² against the velocity through the air, with the
plate's C_L = 2 sin α cos α. It adds to the plate's own drag due to lift, 2 sin² α. For
a finite wing k is about 1 / (π e AR) (Anderson, Fundamentals of Aerodynamics)."""

AXIAL_DRAG = EffectKind(
    kind="axial_drag",
    stage="wrench",
    adds_to=("force_x", "force_z"),
    coefficients=(
        Coefficient("ca0", "-", scale=0.05, lower=0.0, upper=2.0),
        Coefficient(
            "backward", "-", 1.0, scale=0.3, lower=-2.0, upper=2.0, grid=(1.0, -1.0)
        ),
    ),
    formula=_axial_drag,
    words="drag along the body axis, the same at all angles of attack",
    depends_on=("V", "alpha"),
    is_common=True,
    families=_DRAGS,
    bent_by=("drag", "axial force"),
)
"""Axial drag: ½ ρ V² S_w ca0, aft along the body axis.

With a = ½ (1 + cos α / √(cos² α + 0.01)), the share of the flow that comes from ahead,
the axial coefficient is ca0 √1.01 (a - backward (1 - a)). It is ca0 at α = 0, within
half a percent of it up to 45° and within a tenth up to 76° (the axial coefficient of a
body changes little below stall: Hoerner, Fluid-Dynamic Drag). In backward flight it
opposes the motion if `backward` is 1; at -1 the coefficient is constant and propels the
glider.
"""

PITCH_DAMPING = EffectKind(
    kind="pitch_damping",
    stage="wrench",
    adds_to=("moment",),
    coefficients=(
        Coefficient("coefficient", "m²", scale=0.004, lower=-1.0, upper=1.0),
    ),
    formula=_pitch_damping,
    words="pitch damping in addition to the tail's",
    depends_on=("pitchdot", "V"),
    needs=("pitch_inertia",),
    unknown_without=("pitch_inertia", 0.016),
    families=MOMENT_BY_RATE,
    is_likely=True,
)
"""Pitch damping: M = -½ ρ V S_w · coefficient · pitch rate. No chord is given, so the
coefficient has the unit m²."""

PITCH_MOMENT = EffectKind(
    kind="pitch_moment",
    stage="wrench",
    adds_to=("moment",),
    coefficients=(Coefficient("coefficient", "m", scale=0.001, lower=-1.0, upper=1.0),),
    formula=_pitch_moment,
    words="a constant pitching-moment coefficient (camber)",
    depends_on=("V",),
    needs=("tail",),
    unknown_without=("tail", 0.02),
    families=("moment over alpha",),
)
"""Pitch moment: M = ½ ρ V² S_w · coefficient, positive nose down."""

THRUST = EffectKind(
    kind="thrust",
    stage="wrench",
    adds_to=("force_x", "force_z"),
    coefficients=(Coefficient("force", "N", scale=0.05, lower=-20.0, upper=20.0),),
    formula=_thrust,
    words="a constant force along the body axis",
    depends_on=("pitch",),
    families=("push over x", "push over t"),
)
"""Thrust: a constant force along the body axis, (cos pitch, -sin pitch)."""

MASS = EffectKind(
    kind="mass",
    stage="inertia",
    adds_to=("mass",),
    coefficients=(Coefficient("change", "-", scale=0.1, lower=-0.9, upper=5.0),),
    formula=constant,
    words="a mass that differs from its nominal value",
    depends_on=("V", "alpha"),
    needs=("mass", "wing_area"),
    like=("mass",),
    is_likely=True,
)
"""Mass: (1 + change) times the nominal mass, in both inertia and weight."""

INERTIA = EffectKind(
    kind="inertia",
    stage="inertia",
    adds_to=("inertia",),
    coefficients=(Coefficient("change", "-", scale=0.15, lower=-0.9, upper=5.0),),
    formula=constant,
    words="a pitch inertia that differs from its nominal value",
    depends_on=("V", "elevator"),
    needs=("pitch_inertia",),
    like=("pitch_inertia",),
    families=("added inertia over alpha",),
)
"""Pitch inertia: (1 + change) times the nominal pitch inertia."""

ADDED_MASS = EffectKind(
    kind="added_mass",
    stage="inertia",
    adds_to=("added_mass", "added_inertia", "added_coupling"),
    coefficients=(
        Coefficient("mass", "kg", scale=0.01, lower=-0.05, upper=1.0),
        Coefficient("inertia", "kg m²", scale=1e-4, lower=0.0, upper=0.1),
        Coefficient("coupling", "kg m", scale=3e-4, lower=-0.005, upper=0.005),
    ),
    formula=_added_mass,
    words="added mass: air that moves with the wing along its normal",
    depends_on=("alphadot", "alpha", "pitchdot"),
    needs=("mass", "wing_area"),  # Air that moves with the wing is like its area.
    families=("added mass over alpha", "added inertia over alpha"),
    bent_by=(*LIFT_BY_RATE, *MOMENT_BY_RATE),
)
"""Added mass: air that moves and turns with a plate, along its normal n.

With w = n·v, the impulse of this air is (mass · w - coupling · θ̇) n, its angular
impulse inertia · θ̇ - coupling · w. The normal turns (ṅ = θ̇ t), so the air reacts with
F = -(mass · n·a - coupling · θ̈) n - θ̇ [mass (v·t) n + (mass · w - coupling · θ̇) t],
M = coupling · n·a - inertia · θ̈.
Here v is the velocity of the center of mass through the air; the acceleration of the
air itself is neglected. For a thin plate mass is about m = ρ π c² b / 4. With its
half chord e ahead of the center of mass, coupling is m e and inertia
ρ π c⁴ b / 128 + m e² (Lamb, Hydrodynamics, chapters IV and VI; Katz and Plotkin,
Low-Speed Aerodynamics). Valid for thin plates of high aspect ratio, attached or not,
that are slower than their wake: a finite wing carries less.

Kirchhoff's equations also contain a moment that depends on neither acceleration nor
rate, the Munk moment mass (v·t)(v·n). It is omitted: it is part of the steady moment,
which follows from the point where the plate's force acts (`center_of_pressure`). For a
thin wing, whose lift acts at the quarter chord, it is the entire steady moment about
the half chord.
"""
