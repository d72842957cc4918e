"""Effects of air and geometry: how the air moves, and where the surfaces meet it."""

from glider.physics.aerodynamics import (
    angle_of_attack,
    attached_share,
    elevator_velocity,
    tail_load,
    turned,
)
from glider.physics.effects.effect import (
    TAIL_LINKS,
    Coefficient,
    EffectKind,
    constant,
    lag,
    stalling,
)
from glider.physics.formulas import scalar, sin

_STREAMS = (
    "stream at the tail over alpha",
    "stream at the tail over alpha and reduced_rate",
)


@scalar
def _wind(motion, x, z):
    return x, z


@scalar
def _wind_shear(motion, gradient):
    return gradient * motion.z


@scalar
def _center_of_pressure(flow, shift, travel):
    return shift + travel * flow.sin_alpha * flow.sin_alpha


@scalar
def _downwash(flow, gradient):
    return gradient * flow.speed * flow.sin_alpha * flow.cos_alpha


@scalar
def _stalled_downwash(flow, gradient, stall_angle, fade):
    alpha = angle_of_attack(flow.sin_alpha, flow.cos_alpha)
    return _downwash(flow, gradient) * attached_share(alpha, stall_angle, fade)


@scalar
def _lagged_downwash(flow, lagged, gradient, time_constant):
    return gradient * flow.speed * lagged


@scalar
def _lagged_downwash_rate(flow, lagged, gradient, time_constant):
    return (flow.sin_alpha * flow.cos_alpha - lagged) / time_constant


@scalar
def _lagged_downwash_steady(flow, gradient, time_constant):
    return flow.sin_alpha * flow.cos_alpha


@scalar
def _elevator_blowback(flow, compliance, deflection, relief):
    velocity = elevator_velocity(flow, turned(flow, flow.elevator), 0.0)
    square = velocity[0] * velocity[0] + velocity[1] * velocity[1]
    pressure = flow.air_density * square  # Twice the dynamic pressure.
    turn = compliance * tail_load(flow) - deflection * pressure * sin(flow.elevator)
    return turn / (1.0 + relief * (compliance + deflection) * pressure)


@scalar
def _elevator_scale(flow, change):
    return change * flow.elevator, change * flow.elevator_offset * flow.elevator_rate


WIND = EffectKind(
    kind="wind",
    stage="air",
    adds_to=("wind_x", "wind_z"),
    coefficients=(
        Coefficient("x", "m/s", scale=0.5, lower=-5.0, upper=5.0),
        Coefficient("z", "m/s", scale=0.05, lower=-5.0, upper=5.0),
    ),
    formula=_wind,
    words="a steady wind",
    depends_on=("V", "alpha"),
    needs=("mass", "wing_area"),  # All flights share one like their camber and drag.
    varies_by="wind",
    is_likely=True,
)
"""Steady wind: the air moves with velocity w = (x, z) in the world, so that the
velocity through the air is v - w."""

WIND_SHEAR = EffectKind(
    kind="wind_shear",
    stage="air",
    adds_to=("wind_x",),
    coefficients=(Coefficient("gradient", "1/s", scale=0.5, lower=-10.0, upper=10.0),),
    formula=_wind_shear,
    words="wind shear: a wind that changes with height",
    depends_on=("z", "V"),
    needs=("mass", "wing_area"),
    families=("air along x over z",),
)
"""Wind shear: the air moves along x with gradient · z and is at rest at z = 0, the
height of the perch; a wind there is `wind`. This is the linear profile of Etkin,
Dynamics of Atmospheric Flight."""

WING_INCIDENCE = EffectKind(
    kind="wing_incidence",
    stage="geometry",
    adds_to=("wing_incidence",),
    coefficients=(Coefficient("angle", "rad", scale=0.03, lower=-0.5, upper=0.5),),
    formula=constant,
    words="a wing set at an angle to the body axis (positive nose down)",
    depends_on=("alpha", "V"),
    is_likely=True,
)
"""Wing incidence: the wing's plate lies at pitch + angle."""

ELEVATOR_TRIM = EffectKind(
    kind="elevator_trim",
    stage="geometry",
    adds_to=("elevator_trim",),
    coefficients=(Coefficient("angle", "rad", scale=0.03, lower=-0.6, upper=0.6),),
    formula=constant,
    words="an elevator whose true angle differs from its reading by a constant",
    depends_on=("V", "elevator"),
    needs=("servo",),
    unknown_without=("elevator_angle", 0.09),
    varies_by="trim",
    is_likely=True,
)
"""Elevator trim: the elevator's plate lies at pitch + elevator + angle."""

ELEVATOR_SCALE = EffectKind(
    kind="elevator_scale",
    stage="geometry",
    adds_to=("elevator_trim", "downwash"),
    coefficients=(Coefficient("change", "-", scale=0.1, lower=-0.8, upper=4.0),),
    formula=_elevator_scale,
    words="an elevator that turns farther than its log says, by a factor",
    depends_on=("elevator", "V"),
    needs=("servo", "elevator_area"),
    is_rare=True,
)
"""Elevator scale: the elevator's plate turns 1 + change times as far and as fast as the
elevator does. Where angles and commands agree, only the glider's motion reveals it."""

ELEVATOR_BLOWBACK = EffectKind(
    kind="elevator_blowback",
    stage="geometry",
    adds_to=("elevator_trim",),
    coefficients=(
        Coefficient("compliance", "rad/Pa", scale=0.002, lower=0.0, upper=0.02),
        Coefficient("deflection", "rad/Pa", scale=0.002, lower=0.0, upper=0.02),
        Coefficient("relief", "-", scale=0.5, lower=0.0, upper=1.0, grid=(0.0,)),
    ),
    formula=_elevator_blowback,
    words="an elevator that deflects under its load (blowback)",
    depends_on=("elevator", "V", "alpha"),
    needs=("servo",),
    families=("tail's angle over tail_load",),
    bent_by=TAIL_LINKS,
)
"""Elevator blowback: the linkage is a spring that turns under the hinge moment.

The elevator's plate turns by
[compliance · ρ W² sin α_e - deflection · ρ W² sin φ] / (1 + relief · k ρ W²),
k = compliance + deflection, with W and α_e the airspeed and the angle of attack at the
plate's center at the logged deflection φ. The first load is the plate's force per area,
½ ρ W² · 2 sin α_e: from below, it pushes the trailing edge up. A hinged flap's moment
b₁ α + b₂ φ depends more on φ than on the stream (b₂ about twice b₁: Etkin and Reid,
Dynamics of Flight, chapter 2), which `deflection` adds. The turn relieves its own load;
a linear spring is in equilibrium at relief 1, at 0 the load is that of φ itself. Valid
for small turns, within about 0.2 rad, and a linkage quicker than the glider.
"""

CENTER_OF_PRESSURE = EffectKind(
    kind="center_of_pressure",
    stage="geometry",
    adds_to=("wing_shift",),
    coefficients=(
        Coefficient("shift", "m", scale=0.006, lower=-0.2, upper=0.2),
        Coefficient("travel", "m", scale=0.006, lower=-0.2, upper=0.2),
    ),
    formula=_center_of_pressure,
    words="a wing center of pressure away from its nominal position",
    depends_on=("alpha", "V"),
    like=("wing_offset",),
    families=("moment over alpha",),
    is_likely=True,
)
"""Center of pressure: l_w + shift + travel sin² α, ahead of the center of mass.

A thin plate's center of pressure moves from the quarter chord (attached flow) to
the half chord (broadside flow), hence the travel (Winkler 1936; Hoerner, Fluid
Dynamic Lift).
"""

DOWNWASH = EffectKind(
    kind="downwash",
    stage="geometry",
    adds_to=("downwash",),
    coefficients=(Coefficient("gradient", "-", scale=0.3, lower=-3.0, upper=3.0),),
    formula=_downwash,
    words="the wing's downwash on the tail",
    depends_on=("alpha", "V"),
    needs=("servo or elevator_area",),
    families=_STREAMS,
    bent_by=TAIL_LINKS,
    is_likely=True,
)
"""Downwash: at the tail the air moves down along the body's normal with
gradient · V sin α cos α, in proportion to the plate's lift. For small α the
tail's angle of attack is reduced by ε = gradient · α (Etkin and Reid, Dynamics of
Flight)."""

STALLED_DOWNWASH = EffectKind(
    kind="stalled_downwash",
    stage="geometry",
    adds_to=("downwash",),
    coefficients=(
        Coefficient("gradient", "-", scale=0.3, lower=-3.0, upper=3.0),
        *stalling(0.05, 0.2, 0.35),
    ),
    formula=_stalled_downwash,
    words="the wing's downwash on the tail, up to stall",
    depends_on=("alpha", "V"),
    needs=("servo or elevator_area",),
    families=_STREAMS,
    bent_by=TAIL_LINKS,
)
"""Stalled downwash: `downwash` times 1 / (1 + exp((|α| - stall_angle) / fade)).

With attached flow the wing deflects the stream down; once it stalls, the stream reaches
the tail undeflected (Etkin and Reid, Dynamics of Flight; faded like `attached_lift`).
"""

LAGGED_DOWNWASH = EffectKind(
    kind="lagged_downwash",
    stage="geometry",
    adds_to=("downwash",),
    coefficients=(
        Coefficient("gradient", "-", scale=0.3, lower=-3.0, upper=3.0),
        lag("time_constant", 0.04, 0.1),
    ),
    formula=_lagged_downwash,
    words="the wing's downwash, which reaches the tail late",
    depends_on=("alpha", "alphadot", "V"),
    needs=("servo or elevator_area",),
    families=("stream at the tail over alpha and reduced_rate",),
    bent_by=TAIL_LINKS,
    states=("lagged_downwash",),
    state_rate=_lagged_downwash_rate,
    steady_state=_lagged_downwash_steady,
)
"""Lagged downwash: gradient · V s for `downwash`, with τ ṡ = sin α cos α - s.

The stream that the wing deflects takes l_t / V to reach the tail: at 7 m/s and 0.3 m
behind the wing 0.04 s, and longer where the wake rolls up slowly. A first-order lag has
the delay's effect on slow motions, that of C_m_α̇ (Etkin and Reid, Dynamics of Flight);
valid where α changes little within τ.
"""
