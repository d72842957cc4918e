"""Effects of the air: how it moves."""

from glider.physics.effects.effect import Coefficient, EffectKind
from glider.physics.formulas import scalar


@scalar
def _wind(motion, x, z):
    return x, z


@scalar
def _wind_shear(motion, gradient):
    return gradient * motion.z


WIND = EffectKind(
    kind="wind",
    stage="air",
    adds_to=("wind_x", "wind_z"),
    coefficients=(
        Coefficient(name="x", unit="m/s", scale=0.5, lower=-5.0, upper=5.0),
        Coefficient(name="z", unit="m/s", scale=0.05, lower=-5.0, upper=5.0),
    ),
    formula=_wind,
    words="a steady wind",
    depends_on=("V", "alpha"),
)
"""Steady wind: the air moves with velocity w = (x, z) in the world, so that the
velocity through the air is v - w."""

WIND_SHEAR = EffectKind(
    kind="wind_shear",
    stage="air",
    adds_to=("wind_x",),
    coefficients=(
        Coefficient(name="gradient", unit="1/s", scale=0.5, lower=-10.0, upper=10.0),
    ),
    formula=_wind_shear,
    words="wind shear: a wind that changes with height",
    depends_on=("z", "V"),
)
"""Wind shear: the air moves along x with gradient · z and is at rest at z = 0, the
height of the perch; a wind there is `wind`. This is the linear profile of Etkin,
Dynamics of Atmospheric Flight."""
