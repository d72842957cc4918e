"""Effects of geometry: where the surfaces sit and what flow meets the tail."""

from glider.physics.effects.effect import (
    Coefficient,
    EffectKind,
    constant,
)
from glider.physics.formulas import scalar


@scalar
def _center_of_pressure(flow, shift, travel):
    return shift + travel * flow.sin_alpha * flow.sin_alpha


@scalar
def _downwash(flow, gradient):
    return gradient * flow.speed * flow.sin_alpha * flow.cos_alpha


WING_INCIDENCE = EffectKind(
    kind="wing_incidence",
    stage="geometry",
    adds_to=("wing_incidence",),
    coefficients=(
        Coefficient(name="angle", unit="rad", scale=0.03, lower=-0.5, upper=0.5),
    ),
    formula=constant,
    words="the wing set at an angle to the body axis (positive nose down)",
    depends_on=("alpha", "V"),
)
"""Wing incidence: the wing's plate lies at pitch + angle."""

ELEVATOR_TRIM = EffectKind(
    kind="elevator_trim",
    stage="geometry",
    adds_to=("elevator_trim",),
    coefficients=(
        Coefficient(name="angle", unit="rad", scale=0.03, lower=-0.6, upper=0.6),
    ),
    formula=constant,
    words="an elevator that stands off its reading",
    depends_on=("V", "elevator"),
)
"""Elevator trim: the elevator's plate lies at pitch + elevator + angle."""

CENTER_OF_PRESSURE = EffectKind(
    kind="center_of_pressure",
    stage="geometry",
    adds_to=("wing_shift",),
    coefficients=(
        Coefficient(name="shift", unit="m", scale=0.006, lower=-0.2, upper=0.2),
        Coefficient(name="travel", unit="m", scale=0.006, lower=-0.2, upper=0.2),
    ),
    formula=_center_of_pressure,
    words="a wing center of pressure off its nominal place",
    depends_on=("alpha", "V"),
)
"""Center of pressure: l_w + shift + travel sin² α, ahead of the center of mass.

A thin plate's center of pressure moves from the quarter chord (attached) to
the half chord (broadside), hence the travel (Winkler 1936; Hoerner, Fluid
Dynamic Lift).
"""

DOWNWASH = EffectKind(
    kind="downwash",
    stage="geometry",
    adds_to=("downwash",),
    coefficients=(
        Coefficient(name="gradient", unit="-", scale=0.3, lower=-3.0, upper=3.0),
    ),
    formula=_downwash,
    words="the wing's downwash on the tail",
    depends_on=("alpha", "V"),
)
"""Downwash: at the tail the air moves down along the body's normal with
gradient · V sin α cos α, in proportion to the plate's lift: for small α the
tail's angle falls by ε = gradient · α (Etkin and Reid, Dynamics of Flight)."""
