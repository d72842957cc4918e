"""Flat plates in a stream: the prior that every effect corrects.

Pure functions of scalars: floats, AutoDiffXd, Expression or complex numbers, and
numba compiles them. So only operators and sin, cos, sqrt,
exp, tanh, arctan; no branch on a value, no abs or atan2.
"""

import numpy as np

from glider.physics.formulas import cos, exp, scalar, sin, sqrt

SPEED_SMOOTHING = 1e-8
"""Added under the square root of a speed, so that its derivative exists at
rest [m²/s²]."""

_ROUNDING = 1e-6
"""Rounds |α| at zero [rad²]."""


@scalar
def airspeed(along, normal):
    """Returns the length of a velocity (along, normal) [m/s], smooth at rest."""
    return sqrt(along * along + normal * normal + SPEED_SMOOTHING)


@scalar
def plate_force(velocity, plate, area, density):
    """Force on a thin plate along its normal n = (sin θ, cos θ) [N].

    With the coefficient C_n = 2 sin α (so C_L = 2 sin α cos α, C_D = 2 sin² α),
    which holds through stall:  f = -ρ S (n·v) |v|.

    Args:
        velocity: of the plate's center through the air, world (x, z) [m/s].
        plate: sine and cosine of its angle about +y.
        area: S [m²].
        density: ρ [kg/m³].

    Source: Underactuated Robotics, Trajectory Optimization; Hoburg and Tedrake
    2009.
    """
    normal_velocity = velocity[0] * plate[0] + velocity[1] * plate[1]
    return -density * area * normal_velocity * airspeed(velocity[0], velocity[1])


@scalar
def angle_of_attack(sin_alpha, cos_alpha):
    """Angle of attack from its sine and cosine, smooth but at ±π [rad].

    α = 2 atan(sin α / (1 + cos α)), which unlike atan2 takes complex numbers.
    """
    return 2.0 * np.arctan(sin_alpha / (1.0 + cos_alpha + 1e-9))


@scalar
def attached_share(alpha, stall_angle, fade):
    """Share of the flow that is attached: 1 / (1 + exp((|α| - stall_angle) / fade)).

    Written with tanh, which cannot overflow; |α| is rounded at zero.
    """
    beyond = np.sqrt(alpha * alpha + _ROUNDING) - stall_angle
    return 0.5 - 0.5 * np.tanh(0.5 * beyond / fade)


@scalar
def turned(flow, angle):
    """Sine and cosine of the pitch plus an angle [rad]."""
    sine = sin(angle)
    cosine = cos(angle)
    return (
        flow.sin_pitch * cosine + flow.cos_pitch * sine,
        flow.cos_pitch * cosine - flow.sin_pitch * sine,
    )


@scalar
def elevator_velocity(flow, plate, downwash):
    """Velocity of the elevator's center through the air, world (x, z) [m/s].

    v + (l_h θ̇ + downwash) n(θ) + l_e (θ̇ + φ̇) n(e), where `plate` is sine and cosine
    of the elevator's angle e and the downwash [m/s] is along the body's normal.
    """
    along_body = flow.hinge_offset * flow.pitchdot + downwash
    along_plate = flow.elevator_offset * (flow.pitchdot + flow.elevator_rate)
    return (
        flow.air_x + along_body * flow.sin_pitch + along_plate * plate[0],
        flow.air_z + along_body * flow.cos_pitch + along_plate * plate[1],
    )


@scalar
def tail_load(flow):
    """Force per area on the elevator's plate along its normal [Pa].

    ½ ρ W² · 2 sin α_e at the logged deflection, without downwash, with W and α_e the
    airspeed and the angle of attack at the plate's center.
    """
    plate = turned(flow, flow.elevator)
    velocity = elevator_velocity(flow, plate, 0.0)
    return plate_force(velocity, plate, 1.0, flow.air_density)


@scalar
def gaussian(value, center, width):
    """exp(-(value - center)² / (2 width²))."""
    scaled = (value - center) / width
    return exp(-0.5 * scaled * scaled)
