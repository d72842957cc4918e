"""What may be wrong with a lifelike glider: effects in forms of many hands.

Each form is a function of a random generator and a glider that changes the glider and
returns what it planted. The form "library" is the library's own formula, written again,
so that its coefficients have a true value; the others are what real gliders do, and
only their names can be right.
"""

import dataclasses
from collections.abc import Callable

import numpy as np

from tests.helpers.lifelike_flight import Flow, Glider, Lag, Servo


@dataclasses.dataclass(frozen=True, kw_only=True)
class Planted:
    """One effect of a truth.

    Attributes:
        name: kind that a right answer gives.
        form: of FORMS.
        words: the formula with its numbers.
        coefficients: true values of those that mean the same in the library.
        also: kinds that are right in its place.
        allowed: kinds that are not wrong beside it, and not asked for.
    """

    name: str
    form: str = "library"
    words: str = ""
    coefficients: dict[str, float] = dataclasses.field(default_factory=dict)
    also: frozenset[str] = frozenset()
    allowed: frozenset[str] = frozenset()

    @property
    def accepted(self) -> frozenset[str]:
        """Kinds of which any one names it."""
        return self.also | {self.name}


Form = Callable[[np.random.Generator, Glider], tuple[Planted, ...]]


def _either_sign(rng: np.random.Generator, low: float, high: float) -> float:
    return float(rng.uniform(low, high) * rng.choice([-1.0, 1.0]))


def _one(name: str, **coefficients: float) -> tuple[Planted, ...]:
    words = ", ".join(f"{k} {v:.4g}" for k, v in coefficients.items())
    return (Planted(name=name, words=words, coefficients=coefficients),)


# Attached lift: C_n grows faster than the plate's below stall.


def _attached_library(rng, g):
    slope, stall = rng.uniform(1.5, 3.5), rng.uniform(0.18, 0.35)
    fade = rng.uniform(0.03, 0.07)

    def normal(f: Flow):
        beyond = (np.abs(f.alpha) - stall) / fade
        return slope * np.sin(f.alpha) / (1.0 + np.exp(np.clip(beyond, -50, 50)))

    g.normal.append(normal)
    return _one("attached_lift", slope=slope, stall_angle=stall, fade=fade)


def _fall(value, begin, end):
    """Returns how far a value is between begin and end, 0 to 1."""
    return np.clip((value - begin) / (end - begin), 0.0, 1.0)


def _attached_half_cosine(rng, g):
    slope, begin = rng.uniform(2.0, 3.5), rng.uniform(0.14, 0.24)
    end = begin + rng.uniform(0.15, 0.3)

    def normal(f: Flow):
        part = _fall(np.abs(f.alpha), begin, end)
        return slope * np.sin(f.alpha) * 0.5 * (1.0 + np.cos(np.pi * part))

    g.normal.append(normal)
    words = f"slope {slope:.2f}, half a cosine from {begin:.2f} to {end:.2f}"
    return (Planted(name="attached_lift", form="half_cosine", words=words),)


def _attached_smoothstep(rng, g):
    slope, begin = rng.uniform(1.5, 3.0), rng.uniform(0.12, 0.22)
    end = begin + rng.uniform(0.15, 0.35)

    def normal(f: Flow):
        part = _fall(np.abs(f.alpha), begin, end)
        return slope * f.alpha * (1.0 - part**2 * (3.0 - 2.0 * part))

    g.normal.append(normal)
    words = f"{slope:.2f} alpha, smoothstep from {begin:.2f} to {end:.2f}"
    return (Planted(name="attached_lift", form="smoothstep", words=words),)


def _attached_soft(rng, g):
    slope, most = rng.uniform(1.5, 3.0), rng.uniform(0.15, 0.25)

    def normal(f: Flow):
        lift = slope * most * np.tanh(np.sin(f.alpha) / most)
        return lift * np.cos(f.alpha) ** 2

    g.normal.append(normal)
    words = f"{slope:.2f} tanh(sin alpha / {most:.2f}) {most:.2f} cos^2 alpha"
    return (Planted(name="attached_lift", form="soft", words=words),)


# Stall with a memory.


def _stall_library(rng, g):
    strength, late = rng.uniform(0.6, 1.4), rng.uniform(0.05, 0.12)
    index = len(g.lags)
    g.lags.append(
        Lag(
            rate=lambda f, s: (np.sin(f.alpha) - s) / late,
            rest=lambda f: np.sin(f.alpha),
        )
    )
    g.normal.append(lambda f: strength * (np.sin(f.alpha) - f.lags[index]))
    return _one("dynamic_stall", strength=strength, time_constant=late)


def _stall_separation(rng, g):
    """Goman and Khrabrov (1994): a separation point that lags and is led by rate."""
    slope, stall = rng.uniform(2.0, 3.5), rng.uniform(0.22, 0.35)
    late, lead = rng.uniform(0.05, 0.1), rng.uniform(0.02, 0.05)
    index = len(g.lags)

    def steady(alpha):
        return 0.5 * (1.0 - np.tanh((np.abs(alpha) - stall) / 0.12))

    def rate(f: Flow, point):
        # Of alphadot the rate of the nose, which needs no acceleration.
        return (steady(f.alpha + lead * f.pitchdot) - point) / late

    def normal(f: Flow):
        point = np.clip(f.lags[index], 0.0, 1.0)
        share = (0.25 * (1.0 + np.sqrt(point)) ** 2 - 0.25) / 0.75
        return slope * np.sin(f.alpha) * share

    g.lags.append(Lag(rate=rate, rest=lambda f: steady(f.alpha)))
    g.normal.append(normal)
    words = f"slope {slope:.2f}, stall {stall:.2f}, lag {late:.3f} s, lead {lead:.3f} s"
    whole = frozenset({"lagged_separation"})
    return (
        Planted(name="attached_lift", form="separation", words=words, also=whole),
        Planted(name="dynamic_stall", form="separation", words=words, also=whole),
    )


# Camber: the force of another angle of attack, its direction unchanged.


def _camber_library(rng, g):
    angle = _either_sign(rng, 0.03, 0.1)
    g.normal.append(lambda f: 2.0 * np.sin(f.alpha - angle) - 2.0 * np.sin(f.alpha))
    return _one("camber", zero_lift_angle=angle)


def _camber_constant(rng, g):
    size = _either_sign(rng, 0.06, 0.2)
    g.normal.append(lambda f: size * np.cos(f.alpha))
    words = f"{size:.3f} cos alpha"
    return (Planted(name="camber", form="constant", words=words),)


# Drag.


def _profile_library(rng, g):
    cd0 = rng.uniform(0.03, 0.09)
    g.drag.append(lambda f: cd0)
    return _one("profile_drag", cd0=cd0)


def _profile_rising(rng, g):
    cd0, more = rng.uniform(0.03, 0.07), rng.uniform(0.02, 0.06)
    g.drag.append(lambda f: cd0 + more * np.sin(2.0 * f.alpha) ** 2)
    words = f"{cd0:.3f} + {more:.3f} sin^2(2 alpha)"
    induced = frozenset({"induced_drag"})  # Of a plate that is k C_L² to the letter.
    return (Planted(name="profile_drag", form="rising", words=words, allowed=induced),)


def _profile_reynolds(rng, g):
    cd0, share = rng.uniform(0.04, 0.09), rng.uniform(0.1, 0.3)
    g.drag.append(
        lambda f: cd0 * (1.0 + share * np.sqrt(7.0 / np.maximum(f.speed, 0.5)))
    )
    words = f"{cd0:.3f} (1 + {share:.2f} (Re/Re_0)^-1/2)"
    return (Planted(name="profile_drag", form="reynolds", words=words),)


def _axial_library(rng, g):
    ca0 = rng.uniform(0.04, 0.1)

    def axial(f: Flow):
        forward = np.cos(f.alpha)
        return ca0 * forward * np.sqrt(1.01 / (forward**2 + 0.01))

    g.axial.append(axial)
    return _one("axial_drag", ca0=ca0)


def _axial_constant(rng, g):
    ca0 = rng.uniform(0.04, 0.1)
    g.axial.append(lambda f: ca0)
    return (Planted(name="axial_drag", form="constant", words=f"ca0 {ca0:.3f}"),)


def _induced_library(rng, g):
    k = rng.uniform(0.05, 0.12)
    g.drag.append(lambda f: k * np.sin(2.0 * f.alpha) ** 2)
    return _one("induced_drag", k=k)


def _induced_whole_wing(rng, g):
    k = rng.uniform(0.06, 0.15)
    g.drag.append(lambda f: k * (f.normal * np.cos(f.alpha)) ** 2)
    return (Planted(name="induced_drag", form="whole_wing", words=f"k {k:.3f}"),)


# Pitch rate.


def _rate_lift_library(rng, g):
    arm = rng.uniform(0.08, 0.25)
    g.normal.append(lambda f: -arm * f.pitchdot / np.maximum(f.speed, 1e-4))
    return _one("pitch_rate_lift", arm=arm)


def _rate_lift_fading(rng, g):
    arm = rng.uniform(0.12, 0.3)
    g.normal.append(
        lambda f: -arm * f.pitchdot / np.maximum(f.speed, 0.3) * np.cos(f.alpha) ** 2
    )
    words = f"arm {arm:.3f} cos^2 alpha"
    return (Planted(name="pitch_rate_lift", form="fading", words=words),)


def _damping_library(rng, g):
    size = rng.uniform(0.008, 0.025)
    g.moment.append(lambda f: -size * f.pitchdot / np.maximum(f.speed, 1e-4))
    return _one("pitch_damping", coefficient=size)


def _damping_quadratic(rng, g):
    size = rng.uniform(0.005, 0.012)
    g.moment.append(
        lambda f: (
            -size * f.pitchdot * np.abs(f.pitchdot) / np.maximum(f.speed, 0.3) ** 2
        )
    )
    words = f"{size:.4g} q|q| / V^2"
    return (Planted(name="pitch_damping", form="quadratic", words=words),)


# Center of pressure.


def _pressure_library(rng, g):
    shift = _either_sign(rng, 0.003, 0.008)
    travel = _either_sign(rng, 0.002, 0.008) if rng.random() < 0.5 else 0.0
    g.wing_shift.append(lambda f: shift + travel * np.sin(f.alpha) ** 2)
    return _one("center_of_pressure", shift=shift, travel=travel)


def _pressure_travelling(rng, g):
    shift, travel = _either_sign(rng, 0.002, 0.006), -rng.uniform(0.006, 0.015)
    g.wing_shift.append(lambda f: shift + travel * np.minimum(np.abs(f.alpha), 1.57))
    words = f"{shift:.4f} {travel:+.4f} |alpha|"
    return (Planted(name="center_of_pressure", form="travelling", words=words),)


# Numbers that are off the drawing.


def _mass(rng, g):
    change = _either_sign(rng, 0.06, 0.15)
    g.mass = g.mass * (1.0 + change)
    return _one("mass", change=change)


def _inertia(rng, g):
    change = _either_sign(rng, 0.12, 0.25)
    g.pitch_inertia = g.pitch_inertia * (1.0 + change)
    return _one("inertia", change=change)


def _incidence(rng, g):
    angle = _either_sign(rng, 0.02, 0.05)
    g.wing_incidence = g.wing_incidence + angle
    return _one("wing_incidence", angle=angle)


def _trim(rng, g):
    angle = _either_sign(rng, 0.03, 0.07)
    g.elevator_trim = g.elevator_trim + angle
    return _one("elevator_trim", angle=angle)


def _elevator_area(rng, g):
    change = _either_sign(rng, 0.12, 0.25)
    g.elevator_factor.append(lambda f: change)
    return _one("elevator_area", change=change)


# The servo.


def _lag_library(rng, g):
    g.servo = Servo(lag=rng.uniform(0.015, 0.045))
    return _one("servo_lag", time_constant=g.servo.lag)


def _lag_second_order(rng, g):
    s = Servo(
        natural_frequency=rng.uniform(45.0, 80.0), damping_ratio=rng.uniform(0.8, 1.1)
    )
    g.servo = s
    words = f"second order, {s.natural_frequency:.0f} rad/s, {s.damping_ratio:.2f}"
    late = frozenset({"command_delay"})
    return (
        Planted(
            name="servo_lag", form="second_order", words=words, also=late, allowed=late
        ),
    )


def _lag_slew(rng, g):
    g.servo = Servo(slew=rng.uniform(4.0, 7.0))
    words = f"follows in 20 ms, at most {g.servo.slew:.1f} rad/s"
    late = frozenset({"command_delay"})
    return (Planted(name="servo_lag", form="slew", words=words, also=late),)


def _delay(rng, g):
    g.servo = Servo(delay=rng.uniform(0.012, 0.035))
    return _one("command_delay", delay=g.servo.delay)


# The air.


def _wind_library(rng, g):
    x, z = _either_sign(rng, 0.2, 0.5), _either_sign(rng, 0.0, 0.15)
    g.wind = g.wind + complex(x, z)
    return _one("wind", x=x, z=z)


def _shear_library(rng, g):
    gradient = _either_sign(rng, 0.25, 0.6)
    g.winds.append(lambda f: gradient * f.z)
    return _one("wind_shear", gradient=gradient)


def _shear_power_law(rng, g):
    """A wind over a floor at z = -1.8 m, as (height)^0.25: mostly a mean."""
    size = _either_sign(rng, 0.4, 0.9)
    g.winds.append(lambda f: size * (np.maximum(f.z + 1.8, 0.02) / 1.8) ** 0.25)
    mean = frozenset({"wind"})
    words = f"{size:.2f} ((z + 1.8) / 1.8)^0.25"
    return (
        Planted(
            name="wind_shear", form="power_law", words=words, also=mean, allowed=mean
        ),
    )


# Wing and tail among themselves and near the ground.


def _ground_library(rng, g):
    strength, height = rng.uniform(0.05, 0.12), rng.uniform(0.3, 0.8)
    g.wing_factor.append(lambda f: strength * np.exp(-f.z / height))
    return _one("ground_effect", strength=strength, height=height)


def _ground_inverse(rng, g):
    gain, height = rng.uniform(0.3, 0.6), rng.uniform(0.25, 0.5)
    g.wing_factor.append(
        lambda f: gain * height / (height + np.maximum(f.z + 0.8, 0.0))
    )
    words = f"{gain:.2f} / (1 + (z + 0.8) / {height:.2f})"
    return (Planted(name="ground_effect", form="inverse", words=words),)


def _wake_library(rng, g):
    loss, angle = rng.uniform(0.3, 0.6), rng.uniform(0.3, 0.7)
    width = rng.uniform(0.12, 0.25)
    g.elevator_factor.append(
        lambda f: -loss * np.exp(-0.5 * ((f.alpha - angle) / width) ** 2)
    )
    return _one("tail_wake", loss=loss, angle=angle, width=width)


def _wake_raised_cosine(rng, g):
    loss, angle = rng.uniform(0.3, 0.6), rng.uniform(0.3, 0.7)
    half = rng.uniform(0.25, 0.5)
    g.elevator_factor.append(
        lambda f: (
            -0.5
            * loss
            * (1.0 + np.cos(np.pi * np.clip((f.alpha - angle) / half, -1.0, 1.0)))
        )
    )
    words = f"loss {loss:.2f}, raised cosine {angle:.2f} +- {half:.2f}"
    return (Planted(name="tail_wake", form="raised_cosine", words=words),)


def _downwash_library(rng, g):
    gradient = rng.uniform(0.25, 0.5)
    g.downwash.append(lambda f: gradient * f.speed * np.sin(f.alpha) * np.cos(f.alpha))
    return _one("downwash", gradient=gradient)


def _stalled_library(rng, g):
    gradient, stall = rng.uniform(0.35, 0.6), rng.uniform(0.25, 0.4)
    fade = rng.uniform(0.04, 0.07)

    def downwash(f: Flow):
        attached = 0.5 - 0.5 * np.tanh(0.5 * (np.abs(f.alpha) - stall) / fade)
        return gradient * f.speed * np.sin(f.alpha) * np.cos(f.alpha) * attached

    g.downwash.append(downwash)
    return _one("stalled_downwash", gradient=gradient, stall_angle=stall, fade=fade)


def _stalled_smoothstep(rng, g):
    gradient, end = rng.uniform(0.35, 0.6), rng.uniform(0.35, 0.55)

    def downwash(f: Flow):
        part = _fall(np.abs(f.alpha), end - 0.2, end + 0.1)
        attached = 1.0 - part**2 * (3.0 - 2.0 * part)
        return gradient * f.speed * np.sin(f.alpha) * np.cos(f.alpha) * attached

    g.downwash.append(downwash)
    words = f"gradient {gradient:.2f}, smoothstep to {end + 0.1:.2f}"
    steady = frozenset({"downwash"})
    return (
        Planted(name="stalled_downwash", form="smoothstep", words=words, also=steady),
    )


def _thrust(rng, g):
    g.thrust = g.thrust + _either_sign(rng, 0.03, 0.07)
    return _one("thrust", force=float(g.thrust))


# The sensors.


def _marker(rng, g):
    ahead, above = _either_sign(rng, 0.012, 0.03), _either_sign(rng, 0.003, 0.02)
    g.marker_offset = complex(ahead, above)
    return _one("marker_offset", ahead=ahead, above=above)


def _tilt(rng, g):
    g.frame_tilt = _either_sign(rng, 0.015, 0.035)
    return _one("frame_tilt", angle=g.frame_tilt)


def _pitch_zero(rng, g):
    angle = _either_sign(rng, 0.02, 0.05)
    g.pitch_offset = g.pitch_offset + angle
    return _one("pitch_offset", angle=angle)


FORMS: dict[str, dict[str, Form]] = {
    "attached_lift": {
        "library": _attached_library,
        "half_cosine": _attached_half_cosine,
        "smoothstep": _attached_smoothstep,
        "soft": _attached_soft,
    },
    "dynamic_stall": {"library": _stall_library, "separation": _stall_separation},
    "camber": {"library": _camber_library, "constant": _camber_constant},
    "profile_drag": {
        "library": _profile_library,
        "rising": _profile_rising,
        "reynolds": _profile_reynolds,
    },
    "axial_drag": {"library": _axial_library, "constant": _axial_constant},
    "induced_drag": {"library": _induced_library, "whole_wing": _induced_whole_wing},
    "pitch_rate_lift": {"library": _rate_lift_library, "fading": _rate_lift_fading},
    "pitch_damping": {"library": _damping_library, "quadratic": _damping_quadratic},
    "center_of_pressure": {
        "library": _pressure_library,
        "travelling": _pressure_travelling,
    },
    "mass": {"library": _mass},
    "inertia": {"library": _inertia},
    "wing_incidence": {"library": _incidence},
    "elevator_trim": {"library": _trim},
    "elevator_area": {"library": _elevator_area},
    "servo_lag": {
        "library": _lag_library,
        "second_order": _lag_second_order,
        "slew": _lag_slew,
    },
    "command_delay": {"library": _delay},
    "wind": {"library": _wind_library},
    "wind_shear": {"library": _shear_library, "power_law": _shear_power_law},
    "ground_effect": {"library": _ground_library, "inverse": _ground_inverse},
    "tail_wake": {"library": _wake_library, "raised_cosine": _wake_raised_cosine},
    "downwash": {"library": _downwash_library},
    "stalled_downwash": {
        "library": _stalled_library,
        "smoothstep": _stalled_smoothstep,
    },
    "thrust": {"library": _thrust},
    "marker_offset": {"library": _marker},
    "frame_tilt": {"library": _tilt},
    "pitch_offset": {"library": _pitch_zero},
}
"""Kind to its forms."""

RIVALS: tuple[frozenset[str], ...] = (
    frozenset({"attached_lift", "dynamic_stall"}),
    frozenset({"profile_drag", "axial_drag", "induced_drag"}),
    frozenset({"wing_incidence", "pitch_offset", "frame_tilt", "camber"}),
    frozenset({"servo_lag", "command_delay"}),
    frozenset({"wind", "wind_shear", "ground_effect", "thrust"}),
    frozenset({"tail_wake", "downwash", "stalled_downwash", "elevator_area"}),
    frozenset({"pitch_rate_lift", "pitch_damping", "inertia"}),
)
"""At most one of each is drawn into a campaign: two would hide in one another."""
