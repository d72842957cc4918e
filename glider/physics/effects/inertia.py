"""Effects of inertia: how hard the glider is to accelerate."""

from glider.physics.effects.effect import Coefficient, EffectKind, constant
from glider.physics.formulas import scalar


@scalar
def _added_mass(flow, mass, inertia):
    return mass, inertia


MASS = EffectKind(
    kind="mass",
    stage="inertia",
    adds_to=("mass",),
    coefficients=(
        Coefficient(name="change", unit="-", scale=0.1, lower=-0.9, upper=5.0),
    ),
    formula=constant,
    words="a mass that differs from its nominal value",
    depends_on=("V", "alpha"),
)
"""Mass: (1 + change) times the nominal mass, in both inertia and weight."""

INERTIA = EffectKind(
    kind="inertia",
    stage="inertia",
    adds_to=("inertia",),
    coefficients=(
        Coefficient(name="change", unit="-", scale=0.15, lower=-0.9, upper=5.0),
    ),
    formula=constant,
    words="a pitch inertia that differs from its nominal value",
    depends_on=("V", "elevator"),
)
"""Pitch inertia: (1 + change) times the nominal pitch inertia."""

ADDED_MASS = EffectKind(
    kind="added_mass",
    stage="inertia",
    adds_to=("added_mass", "added_inertia"),
    coefficients=(
        Coefficient(name="mass", unit="kg", scale=0.01, lower=-0.05, upper=1.0),
        Coefficient(name="inertia", unit="kg m²", scale=1e-4, lower=0.0, upper=0.1),
    ),
    formula=_added_mass,
    words="added mass: air that moves with the wing along its normal",
    depends_on=("alphadot", "alpha", "pitchdot"),
)
"""Added mass: air that moves and turns with a plate, along its normal n.

The impulse of this air is mass (n·v) n. The normal turns (ṅ = θ̇ t), so it reacts with
F = -d/dt [mass (n·v) n] = -mass [(n·a) n + θ̇ ((v·t) n + (v·n) t)], M = -inertia · θ̈.
Here v is the velocity of the center of mass through the air; the acceleration of the
air itself is neglected. For a thin plate mass is about ρ π c² b / 4 and inertia about
ρ π c⁴ b / 128 (Lamb, Hydrodynamics, chapters IV and VI; Katz and Plotkin, Low-Speed
Aerodynamics).

Kirchhoff's equations also contain a moment that depends on neither acceleration nor
rate, the Munk moment mass (v·t)(v·n). It is omitted: it is part of the steady moment,
which follows from the point where the plate's force acts (`center_of_pressure`). For a
thin wing, whose lift acts at the quarter chord, it is the entire steady moment about
the half chord.
"""
