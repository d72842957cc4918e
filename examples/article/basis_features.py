"""The features of the basis exercise: what an acceleration may be proportional to.

The formulas count angles nose up; `angles` says how the given states count them.
That the two differ unnoticed is the third of the faults that the README names.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from glider.errors import InputError
from glider.physics.aerodynamics import airspeed

ANGLES = {"nose_up": 1.0, "nose_down": -1.0}
"""Ways in which states may count angles, and the sign that makes them nose up. States
of this project are nose down; the published exercise takes them for nose up."""


def angle_sign(angles: str) -> float:
    """Returns the sign of a way to count angles; raises InputError for another."""
    if angles not in ANGLES:
        raise InputError(f"angles are '{angles}'; expected one of {', '.join(ANGLES)}.")
    return ANGLES[angles]


class BasisFlow(NamedTuple):
    """Flow that the features are made of, arrays of one shape; angles nose up.

    Attributes:
        V: speed of the wing, whose center is taken at the center of mass [m/s].
        sin_a: sine of the wing's angle of attack a = θ - atan2(ż, ẋ).
        cos_a: its cosine.
        W: speed of the elevator's center, its own rate omitted [m/s].
        sin_b: sine of the elevator's angle of attack.
        cos_b: its cosine.
        q: pitch rate [rad/s].
        sin_p: sine of the elevator's angle p.
        cos_p: its cosine.
        u: elevator rate [rad/s].
    """

    V: np.ndarray
    sin_a: np.ndarray
    cos_a: np.ndarray
    W: np.ndarray
    sin_b: np.ndarray
    cos_b: np.ndarray
    q: np.ndarray
    sin_p: np.ndarray
    cos_p: np.ndarray
    u: np.ndarray


def basis_flow(
    states: np.ndarray, rates: np.ndarray, arm: float, angles: str
) -> BasisFlow:
    """Computes the smooth flow of the features, of real or complex states.

    Args:
        states: (..., 7) of STATE_NAMES.
        rates: (...) elevator rate [rad/s], counted like the states' angles.
        arm: from the center of mass back to the elevator's center [m].
        angles: a key of ANGLES.
    """
    sign = angle_sign(angles)
    _, _, pitch, elevator, xdot, zdot, pitchdot = np.moveaxis(states, -1, 0)
    pitch, elevator, q, u = (sign * a for a in (pitch, elevator, pitchdot, rates))
    sine, cosine = np.sin(pitch), np.cos(pitch)
    speed = airspeed(xdot, zdot)
    tail_x = xdot + arm * q * sine
    tail_z = zdot - arm * q * cosine
    tail_speed = airspeed(tail_x, tail_z)
    sin_e, cos_e = np.sin(pitch + elevator), np.cos(pitch + elevator)
    return BasisFlow(
        V=speed,
        sin_a=(xdot * sine - zdot * cosine) / speed,
        cos_a=(xdot * cosine + zdot * sine) / speed,
        W=tail_speed,
        sin_b=(tail_x * sin_e - tail_z * cos_e) / tail_speed,
        cos_b=(tail_x * cos_e + tail_z * sin_e) / tail_speed,
        q=q,
        sin_p=np.sin(elevator),
        cos_p=np.cos(elevator),
        u=u,
    )


def _magnitude(value):
    """|value| that a complex step can differentiate."""
    return np.sqrt(value * value)


Formula = Callable[[BasisFlow], np.ndarray]

PAPER: dict[int, tuple[str, Formula]] = {
    1: ("V² sin a", lambda f: f.V**2 * f.sin_a),
    3: ("V² sin a cos² a", lambda f: f.V**2 * f.sin_a * f.cos_a**2),
    5: ("V² sin³ a", lambda f: f.V**2 * f.sin_a**3),
    6: ("V² cos³ a", lambda f: f.V**2 * f.cos_a**3),
    7: ("V³ cos a", lambda f: f.V**3 * f.cos_a),
    9: ("V q cos a", lambda f: f.V * f.q * f.cos_a),
    11: ("q", lambda f: f.q),
    13: ("sin p", lambda f: f.sin_p),
    15: ("V u sin p", lambda f: f.V * f.u * f.sin_p),
    18: ("V (q+u) sin p cos p", lambda f: f.V * (f.q + f.u) * f.sin_p * f.cos_p),
    20: ("W² sin b", lambda f: f.W**2 * f.sin_b),
    24: ("W² sin b sin p", lambda f: f.W**2 * f.sin_b * f.sin_p),
    26: ("W u cos b", lambda f: f.W * f.u * f.cos_b),
    29: ("V² sin a cos a", lambda f: f.V**2 * f.sin_a * f.cos_a),
    30: ("W² sin b cos b cos p", lambda f: f.W**2 * f.sin_b * f.cos_b * f.cos_p),
    32: ("q |q|", lambda f: f.q * _magnitude(f.q)),
    35: ("q |q| cos a", lambda f: f.q * _magnitude(f.q) * f.cos_a),
    38: ("W (q+u)", lambda f: f.W * (f.q + f.u)),
    39: ("W (q+u) sin b", lambda f: f.W * (f.q + f.u) * f.sin_b),
    41: ("W (q+u) sin b cos b", lambda f: f.W * (f.q + f.u) * f.sin_b * f.cos_b),
}
"""The exercise's 20 features out of the 41 of Hoburg and Tedrake 2009, by number."""

OURS: dict[int, tuple[str, Formula]] = {
    101: ("V²", lambda f: f.V**2),
    102: ("V² cos a", lambda f: f.V**2 * f.cos_a),
    103: ("V² sin² a", lambda f: f.V**2 * f.sin_a**2),
    104: ("V² sin² a cos a", lambda f: f.V**2 * f.sin_a**2 * f.cos_a),
    105: ("V q", lambda f: f.V * f.q),
    106: ("V q sin a", lambda f: f.V * f.q * f.sin_a),
    107: ("W²", lambda f: f.W**2),
    108: ("W² cos b", lambda f: f.W**2 * f.cos_b),
    109: ("W² sin² b", lambda f: f.W**2 * f.sin_b**2),
    110: ("W² sin b cos b", lambda f: f.W**2 * f.sin_b * f.cos_b),
    111: ("W² sin b cos p", lambda f: f.W**2 * f.sin_b * f.cos_p),
    112: ("W² cos b sin p", lambda f: f.W**2 * f.cos_b * f.sin_p),
    113: ("W q", lambda f: f.W * f.q),
    114: ("W q sin b", lambda f: f.W * f.q * f.sin_b),
    115: ("u", lambda f: f.u),
    116: ("u |u|", lambda f: f.u * _magnitude(f.u)),
    117: ("V u", lambda f: f.V * f.u),
    118: ("W u", lambda f: f.W * f.u),
    119: ("W u cos p", lambda f: f.W * f.u * f.cos_p),
    120: ("W u sin p", lambda f: f.W * f.u * f.sin_p),
    121: ("W u sin² b", lambda f: f.W * f.u * f.sin_b**2),
}
"""Further forces and dampings of two plates; ours, not the paper's, so their numbers
start at 101."""

FEATURES = {**PAPER, **OURS}
"""Number to words and formula of all 41."""


def feature_columns(flow: BasisFlow, numbers: tuple[int, ...]) -> np.ndarray:
    """Returns features of a flow, (..., len(numbers)).

    Raises:
        InputError: a number is of no feature.
    """
    for number in numbers:
        if number not in FEATURES:
            raise InputError(
                f"there is no feature {number}; there are "
                f"{', '.join(map(str, FEATURES))}."
            )
    return np.stack([FEATURES[number][1](flow) for number in numbers], axis=-1)
