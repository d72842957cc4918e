"""Effects of inertia: how hard the glider is to accelerate."""

from glider.physics.effects.effect import (
    Coefficient,
    EffectKind,
    constant,
)

MASS = EffectKind(
    kind="mass",
    stage="inertia",
    adds_to=("mass",),
    coefficients=(
        Coefficient(name="change", unit="-", scale=0.1, lower=-0.9, upper=5.0),
    ),
    formula=constant,
    words="a mass off its nominal value",
    depends_on=("V", "alpha"),
)
"""Mass: (1 + change) times the nominal one, weight included."""

INERTIA = EffectKind(
    kind="inertia",
    stage="inertia",
    adds_to=("inertia",),
    coefficients=(
        Coefficient(name="change", unit="-", scale=0.15, lower=-0.9, upper=5.0),
    ),
    formula=constant,
    words="a pitch inertia off its nominal value",
    depends_on=("V", "elevator"),
)
"""Pitch inertia: (1 + change) times the nominal one."""

ADDED_MASS = EffectKind(
    kind="added_mass",
    stage="inertia",
    adds_to=("added_mass",),
    coefficients=(
        Coefficient(name="mass", unit="kg", scale=0.01, lower=-0.05, upper=1.0),
    ),
    formula=constant,
    words="added mass: air that the wing must push along its normal",
    depends_on=("alphadot", "alpha"),
)
"""Added mass: the air that a plate carries resists acceleration along its
normal, F = -mass · (n·a) n (for a thin plate about ρ π c² b / 4; Katz and
Plotkin, Low-Speed Aerodynamics)."""
