"""Effects of the air: how it moves."""

from glider.physics.effects.effect import (
    Coefficient,
    EffectKind,
)
from glider.physics.formulas import scalar


@scalar
def _wind(motion, x, z):
    return x, z


WIND = EffectKind(
    kind="wind",
    stage="air",
    adds_to=("wind_x", "wind_z"),
    coefficients=(
        Coefficient(name="x", unit="m/s", scale=0.5, lower=-5.0, upper=5.0),
        Coefficient(name="z", unit="m/s", scale=0.2, lower=-5.0, upper=5.0),
    ),
    formula=_wind,
    words="a steady wind",
    depends_on=("V", "alpha"),
)
"""Steady wind: the air moves with (x, z) in the world, v_air = v - w."""
