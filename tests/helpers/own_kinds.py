"""Effects that the library lacks, one a stage, as a user would write them."""

from glider.physics.effects import Coefficient, EffectKind
from glider.physics.formulas import scalar


@scalar
def _flap(flow, gain):
    force = gain * flow.elevator_rate
    return force * flow.sin_pitch, force * flow.cos_pitch


FLAP = EffectKind(
    kind="flap",
    stage="wrench",
    adds_to=("force_x", "force_z"),
    coefficients=(
        Coefficient(name="gain", unit="N s", scale=0.02, lower=-1.0, upper=1.0),
    ),
    formula=_flap,
    words="a force of the elevator's motion, as of a fish's tail",
    depends_on=("elevator_rate",),
)
"""Flap: a force along the body's normal, gain · elevator rate."""


@scalar
def _boom(flow, lagged, gain, time_constant):
    return gain * lagged


@scalar
def _boom_rate(flow, lagged, gain, time_constant):
    return (flow.elevator_rate - lagged) / time_constant


@scalar
def _boom_steady(flow, gain, time_constant):
    return flow.elevator_rate


BOOM = EffectKind(
    kind="boom",
    stage="wrench",
    adds_to=("moment",),
    coefficients=(
        Coefficient(name="gain", unit="N m s", scale=0.002, lower=-0.1, upper=0.1),
        Coefficient(
            name="time_constant",
            unit="s",
            default=0.1,
            scale=0.02,
            lower=0.02,
            upper=1.0,
            grid=(0.03, 0.1, 0.3),
        ),
    ),
    formula=_boom,
    words="a boom that bends after the elevator",
    depends_on=("elevator_rate",),
    states=("lagged_rate",),
    state_rate=_boom_rate,
    steady_state=_boom_steady,
    state_scales=(5.0,),
)
"""Boom: a moment gain · s, with τ ṡ = elevator rate - s."""


@scalar
def _inflow(motion, first, second, gain):
    return gain * second


@scalar
def _inflow_rate(flow, first, second, gain):
    sink = flow.speed * flow.sin_alpha
    return (sink - first) / 0.05, (first - second) / 0.05


@scalar
def _inflow_steady(flow, gain):
    sink = flow.speed * flow.sin_alpha
    return sink, sink


INFLOW = EffectKind(
    kind="inflow",
    stage="air",
    adds_to=("wind_z",),
    coefficients=(
        Coefficient(name="gain", unit="-", scale=0.1, lower=-0.9, upper=0.9),
    ),
    formula=_inflow,
    words="air that the glider drags along, late",
    states=("first", "second"),
    state_rate=_inflow_rate,
    steady_state=_inflow_steady,
    state_scales=(2.0, 2.0),
)
"""Inflow: the air moves up with the sink relative to it, two lags of 50 ms late."""


@scalar
def _twist(flow, compliance):
    return compliance * flow.speed * flow.speed * flow.sin_alpha


TWIST = EffectKind(
    kind="twist",
    stage="geometry",
    adds_to=("wing_incidence",),
    coefficients=(
        Coefficient(
            name="compliance", unit="rad s²/m²", scale=0.003, lower=-0.1, upper=0.1
        ),
    ),
    formula=_twist,
    words="a wing that twists under its load",
)


@scalar
def _bleed(flow, loss):
    return -loss * flow.pitchdot * flow.pitchdot


BLEED = EffectKind(
    kind="bleed",
    stage="surface",
    adds_to=("elevator_factor",),
    coefficients=(
        Coefficient(name="loss", unit="s²", scale=0.005, lower=-1.0, upper=1.0),
    ),
    formula=_bleed,
    words="an elevator that loses force while the body turns",
)


@scalar
def _leak(flow, rate):
    return -rate * flow.t


LEAK = EffectKind(
    kind="leak",
    stage="inertia",
    adds_to=("mass",),
    coefficients=(
        Coefficient(name="rate", unit="1/s", scale=0.2, lower=-1.0, upper=1.0),
    ),
    formula=_leak,
    words="a mass that shrinks in flight",
)


@scalar
def _sticky(rate, lagged, gain, time_constant):
    return rate + gain * (lagged - rate)


@scalar
def _sticky_rate(rate, lagged, gain, time_constant):
    return (rate - lagged) / time_constant


@scalar
def _sticky_pending(lagged, gain, time_constant):
    return gain * time_constant * lagged


@scalar
def _sticky_steady(rate, gain, time_constant):
    return rate


STICKY = EffectKind(
    kind="sticky",
    stage="actuator",
    adds_to=(),
    coefficients=(
        Coefficient(name="gain", unit="-", scale=0.3, lower=-0.5, upper=1.0),
        Coefficient(
            name="time_constant",
            unit="s",
            default=0.05,
            scale=0.01,
            lower=0.01,
            upper=0.3,
            grid=(0.05,),
        ),
    ),
    formula=_sticky,
    words="a servo that gives a part of its rate late",
    states=("late_rate",),
    state_rate=_sticky_rate,
    steady_state=_sticky_steady,
    pending=_sticky_pending,
)
"""Sticky: r = u + gain (s - u), τ ṡ = u - s: with a gain of one, a servo lag."""

ALL = (FLAP, BOOM, INFLOW, TWIST, BLEED, LEAK, STICKY)
