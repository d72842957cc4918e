"""Effects on the forces of the surfaces: coefficients that a flat plate lacks."""

import numpy as np

from glider.physics.aerodynamics import angle_of_attack, attached_share, gaussian
from glider.physics.effects.effect import (
    LIFT_BY_RATE,
    TAIL_LINKS,
    Coefficient,
    EffectKind,
    constant,
    lag,
    stalling,
)
from glider.physics.formulas import exp, scalar

_ROUNDING = 1e-8
"""Rounds roots at zero: of the separation point, and of the height above the floor over
its depth."""


@scalar
def _attached_lift(flow, slope, stall_angle, fade):
    alpha = angle_of_attack(flow.sin_alpha, flow.cos_alpha)
    return slope * flow.sin_alpha * attached_share(alpha, stall_angle, fade)


@scalar
def _camber(flow, zero_lift_angle):
    sine = np.sin(zero_lift_angle)
    cosine = np.cos(zero_lift_angle)
    return 2.0 * (flow.sin_alpha * (cosine - 1.0) - flow.cos_alpha * sine)


@scalar
def _pitch_rate_lift(flow, arm):
    return -arm * flow.pitchdot / flow.speed


@scalar
def _dynamic_stall(flow, lagged, strength, time_constant):
    return strength * (flow.sin_alpha - lagged)


@scalar
def _dynamic_stall_rate(flow, lagged, strength, time_constant):
    return (flow.sin_alpha - lagged) / time_constant


@scalar
def _dynamic_stall_steady(flow, strength, time_constant):
    return flow.sin_alpha


@scalar
def _airspeed_dependence(flow, gradient, reference_speed):
    return gradient * (flow.speed / reference_speed - 1.0)


@scalar
def _lagged_separation(flow, point, slope, stall_angle, fade, relaxation, delay):
    attached = 0.5 * (point + np.sqrt(point * point + _ROUNDING))
    return slope * flow.sin_alpha * (2.0 * np.sqrt(attached) + attached) / 3.0


@scalar
def _lagged_separation_rate(
    flow, alphadot, point, slope, stall_angle, fade, relaxation, delay
):
    alpha = angle_of_attack(flow.sin_alpha, flow.cos_alpha) - delay * alphadot
    return (attached_share(alpha, stall_angle, fade) - point) / relaxation


@scalar
def _lagged_separation_steady(flow, slope, stall_angle, fade, relaxation, delay):
    alpha = angle_of_attack(flow.sin_alpha, flow.cos_alpha)
    return attached_share(alpha, stall_angle, fade)


@scalar
def _ground_effect(flow, strength, height, inverse_depth):
    above = 1.0 + inverse_depth * flow.z
    over = 0.5 * (above + np.sqrt(above * above + _ROUNDING))
    z = flow.z / (1.0 + over - above)  # Of the floor, where it lies above.
    root = np.sqrt(np.sqrt(over))
    bend = (1.0 + root + root * root) / (1.0 + root) / (1.0 + root * root)
    return strength * exp(-4.0 / 3.0 * bend * z / height)


@scalar
def _tail_wake(flow, loss, angle, width):
    alpha = angle_of_attack(flow.sin_alpha, flow.cos_alpha)
    return -loss * gaussian(alpha, angle, width)


ATTACHED_LIFT = EffectKind(
    kind="attached_lift",
    stage="surface",
    adds_to=("wing_normal",),
    coefficients=(
        Coefficient("slope", "1/rad", scale=2.0, lower=-6.0, upper=12.0),
        *stalling(0.04, 0.15, 0.26, 0.4),
    ),
    formula=_attached_lift,
    words="attached flow: extra lift slope below stall",
    depends_on=("alpha", "V"),
    is_common=True,
    families=("lift over alpha",),
    is_likely=True,
)
"""Attached lift: C_n increases by slope · sin α below the stall angle.

ΔC_n = slope sin α / (1 + exp((|α| - stall_angle) / fade)). A thin airfoil has a slope
of 2π, compared with 2 for the plate (Anderson, Fundamentals of Aerodynamics).
"""

CAMBER = EffectKind(
    kind="camber",
    stage="surface",
    adds_to=("wing_normal",),
    coefficients=(
        Coefficient("zero_lift_angle", "rad", scale=0.03, lower=-0.5, upper=0.5),
    ),
    formula=_camber,
    words="a cambered wing, whose zero-lift angle of attack is not zero",
    depends_on=("alpha", "V"),
    is_common=True,
    families=("lift over alpha",),
)
"""Camber: C_n is that of the plate at α - zero_lift_angle, in an unchanged direction.

ΔC_n = 2 sin(α - zero_lift_angle) - 2 sin α, so that a wing cambered upward
(zero_lift_angle < 0) has lift at α = 0. In contrast, `wing_incidence` also rotates the
force. (Thin-airfoil theory: Anderson, Fundamentals of Aerodynamics; the accompanying
moment is `pitch_moment`.)
"""

PITCH_RATE_LIFT = EffectKind(
    kind="pitch_rate_lift",
    stage="surface",
    adds_to=("wing_normal",),
    coefficients=(Coefficient("arm", "m", scale=0.05, lower=-1.0, upper=1.0),),
    formula=_pitch_rate_lift,
    words="lift due to pitch rate: more normal force while the nose comes up",
    depends_on=("pitchdot", "V"),
    is_common=True,
    families=LIFT_BY_RATE,
)
"""Pitch-rate lift: ΔC_n = -arm · pitch rate / V, positive nose up.

The force is proportional to V · pitch rate and vanishes at rest. It equals that of a
plate whose force is determined by the flow `arm` / 2 behind its center. For a thin
airfoil about its half chord arm = π c / 2, without the contribution of added mass
(Etkin and Reid, Dynamics of Flight, C_Lq).
"""

DYNAMIC_STALL = EffectKind(
    kind="dynamic_stall",
    stage="surface",
    adds_to=("wing_normal",),
    coefficients=(
        Coefficient("strength", "-", scale=1.0, lower=-5.0, upper=20.0),
        lag("time_constant", 0.03, 0.08, 0.2),
    ),
    formula=_dynamic_stall,
    words="dynamic stall: lift that lags a changing angle of attack",
    depends_on=("alphadot", "V"),
    families=LIFT_BY_RATE,
    bent_by=("lift",),
    states=("lagged_sin_alpha",),
    state_rate=_dynamic_stall_rate,
    steady_state=_dynamic_stall_steady,
)
"""Dynamic stall: ΔC_n = strength (sin α - s), with τ ṡ = sin α - s.

While α changes, the normal force leads (strength > 0) or lags (strength < 0) its steady
value: the first-order hysteresis of Goman and Khrabrov (J. Aircraft 31, 1994), linear
in the lag.
"""

LAGGED_SEPARATION = EffectKind(
    kind="lagged_separation",
    stage="surface",
    adds_to=("wing_normal",),
    coefficients=(
        Coefficient("slope", "1/rad", scale=2.0, lower=-6.0, upper=12.0),
        *stalling(0.06, 0.28),
        lag("relaxation", 0.08),
        Coefficient("delay", "s", scale=0.01, lower=0.0, upper=0.3, grid=(0.03,)),
    ),
    formula=_lagged_separation,
    words="attached flow that separates and reattaches late",
    depends_on=("alpha", "alphadot", "V"),
    families=LIFT_BY_RATE,
    bent_by=("lift",),
    states=("separation_point",),
    state_rate=_lagged_separation_rate,
    steady_state=_lagged_separation_steady,
    rate_by_alphadot=True,
)
"""Lagged separation: `attached_lift` whose point of separation x has a memory.

ΔC_n = slope sin α (2 √x + x) / 3 with relaxation · ẋ = x₀(α - delay · α̇) - x and
x₀(α) = 1 / (1 + exp((|α| - stall_angle) / fade)). The flow is attached over the share x
of the chord: at x = 1 the slope of C_n is 2 + slope (2π for a thin airfoil), at x = 0
there is the plate's 2 sin α; between, Kirchhoff's (1 + √x)² / 4, whose range from 1/4
to 1 is scaled to that of 0 to slope. `relaxation` is the time in which the separation
settles, `delay` that by which a changing α shifts it quasi-steadily (Goman and
Khrabrov, J. Aircraft 31, 1994: about 0.5 and 4.5 chords over V for NACA 0015). α̇ is
that of the model; the acceleration of the air itself is neglected. Valid for
separation from the trailing edge while |α| < π/2; a vortex shed from the leading edge
has no part in it. `dynamic_stall` is another effect: a lag of the whole force, the same
below and above stall.
"""

AIRSPEED_DEPENDENCE = EffectKind(
    kind="airspeed_dependence",
    stage="surface",
    adds_to=("wing_factor",),
    coefficients=(
        Coefficient("gradient", "-", scale=0.3, lower=-3.0, upper=3.0),
        Coefficient(
            "reference_speed", "m/s", 7.0, scale=1.0, lower=1.0, upper=30.0, grid=(7.0,)
        ),
    ),
    formula=_airspeed_dependence,
    words="a wing coefficient that changes with airspeed (Reynolds number)",
    depends_on=("V",),
    families=("wing's force over V",),
)
"""Airspeed dependence: the wing's force changes by the factor
1 + gradient (V/V_ref - 1). V_ref is by default the launch speed of the article."""

GROUND_EFFECT = EffectKind(
    kind="ground_effect",
    stage="surface",
    adds_to=("wing_factor",),
    coefficients=(
        Coefficient("strength", "-", scale=0.02, lower=0.0, upper=3.0),
        Coefficient(
            "height", "m", 0.5, scale=0.1, lower=0.05, upper=10.0, grid=(0.2, 0.5, 1.2)
        ),
        Coefficient(
            "inverse_depth", "1/m", scale=0.3, lower=0.0, upper=20.0, grid=(0.0,)
        ),
    ),
    formula=_ground_effect,
    words="ground effect: more wing force closer to the ground",
    depends_on=("z", "alpha"),
    families=("wing's force over z",),
)
"""Ground effect: the wing's force increases by strength · σ(h) / σ(d).

σ(h) is exp(-(h / λ)^¾) at the height h above a floor that lies d = 1 / inverse_depth
below z = 0, the height of the perch. There the share is `strength` and falls by 1/e in
`height` = 4/3 λ^¾ d^¼, if it falls as steeply on. For a wing of span b,
σ = exp(-2.48 (2 h / b)^0.768) (Wieselsberger 1921, in the form of Torenbeek, Synthesis
of Subsonic Airplane Design). A floor far below (inverse_depth 0) leaves
strength · exp(-z / height) (Staufenbiel and Schlichting, J. Aircraft 25, 1988), whose
floor cannot be identified. Valid above a tenth of the span; constant below the floor.
"""

TAIL_WAKE = EffectKind(
    kind="tail_wake",
    stage="surface",
    adds_to=("elevator_factor",),
    coefficients=(
        Coefficient("loss", "-", scale=0.4, lower=0.0, upper=1.0),
        Coefficient(
            name="angle",
            unit="rad",
            default=0.5,
            scale=0.05,
            lower=0.0,
            upper=2.0,
            grid=(0.2, 0.4, 0.7, 1.1),
        ),
        Coefficient(
            "width", "rad", 0.2, scale=0.04, lower=0.03, upper=1.5, grid=(0.1, 0.25)
        ),
    ),
    formula=_tail_wake,
    words="the tail in the wing's wake at some angles of attack",
    depends_on=("alpha", "elevator"),
    needs=("servo or elevator_area",),
    families=("tail's force over alpha", "tail's force over alpha and elevator"),
    bent_by=TAIL_LINKS,
)
"""Tail wake: the elevator's force decreases by the share loss · exp(-(α - angle)²/(2
width²)) while the separated wake of the wing washes over the tail (deep stall; Etkin
and Reid, Dynamics of Flight)."""

ELEVATOR_AREA = EffectKind(
    kind="elevator_area",
    stage="surface",
    adds_to=("elevator_factor",),
    coefficients=(Coefficient("change", "-", scale=0.2, lower=-0.95, upper=5.0),),
    formula=constant,
    words="an effective elevator area that differs from its nominal value",
    depends_on=("elevator", "V"),
    needs=("elevator_area",),
    like=("elevator_area",),
    bent_by=TAIL_LINKS,
)
"""Elevator area: the elevator's force is (1 + change) times the nominal force."""
