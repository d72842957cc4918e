"""One effect in a glider of `lifelike_flight`, of a size and of the library's shape.

The formulas are written again in that simulator's terms: they share nothing with the
library's but what they mean.
"""

from collections.abc import Callable, Mapping

import numpy as np

from tests.helpers.lifelike_flight import Flow, Glider, Lag

Shapes = Mapping[str, float]
"""Name of an effect's shape to its value."""

ONE_SIGN = (
    "servo_lag",
    "command_delay",
    "attached_lift",
    "dynamic_stall",
    "ground_effect",
    "tail_wake",
    "profile_drag",
    "induced_drag",
    "axial_drag",
)
"""Effects whose size is positive."""


def plant(glider: Glider, kind: str, size: float, shapes: Shapes) -> None:
    """Gives a glider an effect.

    Args:
        glider: that is changed.
        kind: of the effect, one of PLANTED.
        size: its first coefficient that is not a shape.
        shapes: its others that are.
    """
    PLANTED[kind](glider, size, shapes)


def _servo_lag(g: Glider, size: float, shapes: Shapes) -> None:
    g.servo.lag = size


def _command_delay(g: Glider, size: float, shapes: Shapes) -> None:
    g.servo.delay = size


def _wind(g: Glider, size: float, shapes: Shapes) -> None:
    g.wind = g.wind + size


def _wind_shear(g: Glider, size: float, shapes: Shapes) -> None:
    g.winds.append(lambda f: size * f.z)


def _wing_incidence(g: Glider, size: float, shapes: Shapes) -> None:
    g.wing_incidence = size


def _elevator_trim(g: Glider, size: float, shapes: Shapes) -> None:
    g.elevator_trim = size


def _center_of_pressure(g: Glider, size: float, shapes: Shapes) -> None:
    g.wing_shift.append(lambda f: size)


def _downwash(g: Glider, size: float, shapes: Shapes) -> None:
    g.downwash.append(lambda f: size * f.speed * np.sin(f.alpha) * np.cos(f.alpha))


def _attached(f: Flow, stall: float, fade: float) -> np.ndarray:
    return 0.5 - 0.5 * np.tanh(0.5 * (np.abs(f.alpha) - stall) / fade)


def _stalled_downwash(g: Glider, size: float, shapes: Shapes) -> None:
    def downwash(f: Flow) -> np.ndarray:
        whole = size * f.speed * np.sin(f.alpha) * np.cos(f.alpha)
        return whole * _attached(f, shapes["stall_angle"], shapes["fade"])

    g.downwash.append(downwash)


def _lagged_downwash(g: Glider, size: float, shapes: Shapes) -> None:
    index, late = len(g.lags), shapes["time_constant"]

    def whole(f: Flow) -> np.ndarray:
        return np.sin(f.alpha) * np.cos(f.alpha)

    g.lags.append(Lag(rate=lambda f, s: (whole(f) - s) / late, rest=whole))
    g.downwash.append(lambda f: size * f.speed * f.lags[index])


def _attached_lift(g: Glider, size: float, shapes: Shapes) -> None:
    def normal(f: Flow) -> np.ndarray:
        return (
            size * np.sin(f.alpha) * _attached(f, shapes["stall_angle"], shapes["fade"])
        )

    g.normal.append(normal)


def _camber(g: Glider, size: float, shapes: Shapes) -> None:
    g.normal.append(lambda f: 2.0 * (np.sin(f.alpha - size) - np.sin(f.alpha)))


def _pitch_rate_lift(g: Glider, size: float, shapes: Shapes) -> None:
    g.normal.append(lambda f: -size * f.pitchdot / np.maximum(f.speed, 1e-4))


def _dynamic_stall(g: Glider, size: float, shapes: Shapes) -> None:
    index, late = len(g.lags), shapes["time_constant"]
    g.lags.append(
        Lag(
            rate=lambda f, s: (np.sin(f.alpha) - s) / late,
            rest=lambda f: np.sin(f.alpha),
        )
    )
    g.normal.append(lambda f: size * (np.sin(f.alpha) - f.lags[index]))


def _airspeed_dependence(g: Glider, size: float, shapes: Shapes) -> None:
    usual = shapes["reference_speed"]
    g.wing_factor.append(lambda f: size * (f.speed / usual - 1.0))


def _ground_effect(g: Glider, size: float, shapes: Shapes) -> None:
    g.wing_factor.append(lambda f: size * np.exp(-f.z / shapes["height"]))


def _tail_wake(g: Glider, size: float, shapes: Shapes) -> None:
    angle, width = shapes["angle"], shapes["width"]
    g.elevator_factor.append(
        lambda f: -size * np.exp(-0.5 * ((f.alpha - angle) / width) ** 2)
    )


def _elevator_area(g: Glider, size: float, shapes: Shapes) -> None:
    g.elevator_factor.append(lambda f: size)


def _profile_drag(g: Glider, size: float, shapes: Shapes) -> None:
    g.drag.append(lambda f: size)


def _induced_drag(g: Glider, size: float, shapes: Shapes) -> None:
    g.drag.append(lambda f: size * np.sin(2.0 * f.alpha) ** 2)


def _axial_drag(g: Glider, size: float, shapes: Shapes) -> None:
    def axial(f: Flow) -> np.ndarray:
        forward = np.cos(f.alpha)
        return size * forward * np.sqrt(1.01 / (forward**2 + 0.01))

    g.axial.append(axial)


def _pitch_damping(g: Glider, size: float, shapes: Shapes) -> None:
    g.moment.append(lambda f: -size * f.pitchdot / np.maximum(f.speed, 1e-4))


def _pitch_moment(g: Glider, size: float, shapes: Shapes) -> None:
    g.moment.append(lambda f: size)


def _thrust(g: Glider, size: float, shapes: Shapes) -> None:
    g.thrust = size


def _mass(g: Glider, size: float, shapes: Shapes) -> None:
    g.mass = g.mass * (1.0 + size)


def _inertia(g: Glider, size: float, shapes: Shapes) -> None:
    g.pitch_inertia = g.pitch_inertia * (1.0 + size)


def _marker_offset(g: Glider, size: float, shapes: Shapes) -> None:
    g.marker_offset = complex(size)


def _frame_tilt(g: Glider, size: float, shapes: Shapes) -> None:
    g.frame_tilt = size


def _pitch_offset(g: Glider, size: float, shapes: Shapes) -> None:
    g.pitch_offset = size


PLANTED: dict[str, Callable[[Glider, float, Shapes], None]] = {
    "servo_lag": _servo_lag,
    "command_delay": _command_delay,
    "wind": _wind,
    "wind_shear": _wind_shear,
    "wing_incidence": _wing_incidence,
    "elevator_trim": _elevator_trim,
    "center_of_pressure": _center_of_pressure,
    "downwash": _downwash,
    "stalled_downwash": _stalled_downwash,
    "lagged_downwash": _lagged_downwash,
    "attached_lift": _attached_lift,
    "camber": _camber,
    "pitch_rate_lift": _pitch_rate_lift,
    "dynamic_stall": _dynamic_stall,
    "airspeed_dependence": _airspeed_dependence,
    "ground_effect": _ground_effect,
    "tail_wake": _tail_wake,
    "elevator_area": _elevator_area,
    "profile_drag": _profile_drag,
    "induced_drag": _induced_drag,
    "axial_drag": _axial_drag,
    "pitch_damping": _pitch_damping,
    "pitch_moment": _pitch_moment,
    "thrust": _thrust,
    "mass": _mass,
    "inertia": _inertia,
    "marker_offset": _marker_offset,
    "frame_tilt": _frame_tilt,
    "pitch_offset": _pitch_offset,
}
"""Kind to what plants it."""
