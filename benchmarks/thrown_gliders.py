"""Flights of gliders of any size in three dimensions, to test guesses of frames with.

A rigid body with the forces of a plate with a leading edge, a tail and a fin: of 0.3 to
3 m span, thrown level, steeply, banked or sideways, shot by a catapult, into a loop, or
so heavy that they barely feel the air. A hand may carry them before, and they may slide
on the floor after. Axes are forward, left and up, and nose, left and top of the body.
"""

import dataclasses
import math

import numpy as np
from scipy.spatial.transform import Rotation

GRAVITY, DENSITY = 9.81, 1.2
KINDS = ("level", "steep", "banked", "sideslip", "catapult", "loop", "heavy", "dive")
_STEP = 1.0 / 480.0  # [s]


@dataclasses.dataclass(frozen=True)
class Glider:
    """Geometry [m, kg] and coefficients per radian; moments are nose up, in chords."""

    span: float
    mass: float
    aspect: float
    slope: float  # Of the normal force.
    suction: float  # Share of the leading edge's suction.
    drag: float
    stability: float
    tail: float  # Moment of the elevator.
    lift: float  # Coefficient that it is trimmed to.

    @property
    def chord(self) -> float:
        return self.span / self.aspect

    @property
    def trim_speed(self) -> float:
        area = self.span * self.chord
        return math.sqrt(2 * self.mass * GRAVITY / (DENSITY * area * self.lift))


@dataclasses.dataclass(frozen=True)
class Take:
    """One recording: rows of poses and of the elevator, and when it flies."""

    time: np.ndarray  # (n,) [s]
    position: np.ndarray  # (n, 3) [m]
    rotation: Rotation  # From nose, left, top to forward, left, up.
    elevator: np.ndarray  # (n,) trailing edge up [rad]
    command: np.ndarray  # (n,) its rate [rad/s]
    free: tuple[float, float]  # Times of release and of landing [s].


def draw_glider(rng: np.random.Generator, *, heavy: bool = False) -> Glider:
    """A glider of random size."""
    span = float(np.exp(rng.uniform(np.log(0.3), np.log(3.0))))
    aspect = rng.uniform(3.0, 6.0 + 4.0 * span)
    loading = 0.4 + rng.uniform(0.3, 1.8) * span  # [kg/m²]
    if heavy:
        loading *= 8.0
    return Glider(
        span=span,
        mass=loading * span**2 / aspect,
        aspect=aspect,
        slope=2 * math.pi * aspect / (aspect + 2),
        suction=rng.uniform(0.0, 0.9),
        drag=rng.uniform(0.02, 0.1),
        stability=rng.uniform(0.05, 0.3),
        tail=rng.uniform(0.4, 1.2),
        lift=rng.uniform(0.3, 0.9),
    )


def fly(
    rng: np.random.Generator, glider: Glider, kind: str, *, servo: bool, rate: float
) -> Take:
    """One flight of a glider, with what is before and after it."""
    speed = glider.trim_speed * rng.uniform(0.8, 1.4)
    climb, bank, slip, rates = rng.normal(0, 0.1), rng.normal(0, 0.05), 0.0, np.zeros(3)
    trim = glider.lift / glider.slope
    attack = trim + rng.normal(0, 0.05)
    if kind == "steep":
        climb, speed = rng.uniform(0.7, 1.2), max(speed, 5.0)
    elif kind == "dive":
        climb = -rng.uniform(0.5, 1.0)
    elif kind == "banked":
        bank = rng.choice([-1, 1]) * np.radians(rng.uniform(10, 25))
    elif kind == "sideslip":
        slip = rng.choice([-1, 1]) * np.radians(rng.uniform(10, 20))
    elif kind == "catapult":
        speed *= rng.uniform(1.5, 2.5)
    elif kind == "loop":
        speed *= 2.2
    elif kind == "heavy":
        speed = rng.uniform(4.0, 8.0)
    speed = max(speed, 3.0)
    up = 0.5 if kind == "loop" else 0.0
    nose = Rotation.from_euler("ZYX", [slip, -(climb + attack), bank])
    heading = np.array([np.cos(climb), 0.0, np.sin(climb)]) * speed
    longest = rng.uniform(0.7, 2.5) if glider.span < 1.5 else rng.uniform(1.0, 8.0)
    longest = max(longest, 0.9)
    height = rng.uniform(1.3, 2.5) + (20.0 if glider.span > 1.5 else 0.0)
    height += 2.0 if kind == "dive" else 0.0
    count = int(longest / _STEP)
    time = np.arange(count) * _STEP
    knots = np.arange(0.0, longest + 0.3, rng.uniform(0.15, 0.3))
    moves = rng.uniform(-0.3, 0.4, len(knots)) * servo
    moves[0] = 0.0
    elevator = np.interp(time, knots, moves) + up
    command = np.gradient(elevator, _STEP)
    states = [np.r_[0.0, 0.0, height, heading, nose.as_quat(), rates]]
    for k in range(count - 1):
        y, d = states[-1], elevator[k]
        k1 = _derivative(glider, y, d, trim)
        k2 = _derivative(glider, y + 0.5 * _STEP * k1, d, trim)
        k3 = _derivative(glider, y + 0.5 * _STEP * k2, d, trim)
        k4 = _derivative(glider, y + _STEP * k3, d, trim)
        new = y + _STEP / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        new[6:10] /= np.linalg.norm(new[6:10])
        if new[2] < 0.05:
            break
        states.append(new)
    return _sample(rng, np.stack(states), elevator, command, rate)


def _derivative(g: Glider, y: np.ndarray, elevator: float, trim: float) -> np.ndarray:
    velocity, (qx, qy, qz, qw), (p, q, r) = y[3:6], y[6:10], y[10:13]
    turn = np.array(
        [
            [
                1 - 2 * (qy * qy + qz * qz),
                2 * (qx * qy - qz * qw),
                2 * (qx * qz + qy * qw),
            ],
            [
                2 * (qx * qy + qz * qw),
                1 - 2 * (qx * qx + qz * qz),
                2 * (qy * qz - qx * qw),
            ],
            [
                2 * (qx * qz - qy * qw),
                2 * (qy * qz + qx * qw),
                1 - 2 * (qx * qx + qy * qy),
            ],
        ]
    )
    u = turn.T @ velocity
    speed = math.sqrt(u @ u)
    alpha, beta = math.atan2(-u[2], u[0]), math.asin(u[1] / speed)
    area, b, c = g.span * g.chord, g.span, g.chord
    q_s = 0.5 * DENSITY * speed**2 * area
    attached = math.exp(-((alpha / 0.3) ** 2))
    normal = math.sin(alpha) * (2.0 + (g.slope - 2.0) * attached)
    axial = g.drag * math.cos(alpha) - g.suction * attached * normal * math.sin(alpha)
    force = q_s * np.array([-axial, -0.4 * math.sin(beta), normal])
    damp_b, damp_c = b / (2 * speed), c / (2 * speed)
    pitch = -g.stability * g.slope * math.sin(alpha - trim) + 12.0 * g.tail * damp_c * q
    pitch += g.tail * elevator * abs(math.cos(alpha))
    roll = 0.04 * beta - 0.45 * damp_b * p + 0.1 * damp_b * r
    yaw = 0.06 * beta - 0.15 * damp_b * r - 0.03 * damp_b * p
    inertia = g.mass * np.array([0.2 * b, 0.22 * b, 0.29 * b]) ** 2
    moment = q_s * np.array([b * roll, -c * pitch, b * yaw])
    i, j, k = inertia
    gyroscopic = np.array([(k - j) * q * r, (i - k) * r * p, (j - i) * p * q])
    spin = (moment - gyroscopic) / inertia
    acceleration = turn @ force / g.mass - [0.0, 0.0, GRAVITY]
    dq = 0.5 * np.array(
        [
            qw * p + qy * r - qz * q,
            qw * q + qz * p - qx * r,
            qw * r + qx * q - qy * p,
            -qx * p - qy * q - qz * r,
        ]
    )
    return np.concatenate([velocity, acceleration, dq, spin])


def _sample(
    rng: np.random.Generator,
    states: np.ndarray,
    elevator: np.ndarray,
    command: np.ndarray,
    rate: float,
) -> Take:
    """Rows of a camera, perhaps with a hand before and the floor after."""
    position, turn = states[:, :3], Rotation.from_quat(states[:, 6:10])
    time = np.arange(len(states)) * _STEP
    count = len(states)
    start = 0.0
    if rng.uniform() < 0.5:  # A hand carries it slowly, then throws it in 0.4 s.
        start = rng.uniform(0.8, 1.4)
        before = np.arange(-round(start / _STEP), 0) * _STEP
        velocity, pace = states[0, 3:6], 0.4
        blend = np.clip(1 + before / pace, 0, 1)
        swing = (
            velocity * (blend**2)[:, None]
            + 0.3
            * np.sin(2.1 * before + rng.uniform(0, 6, 3)[:, None]).T
            * (1 - blend)[:, None]
        )
        path = np.cumsum(swing[::-1], axis=0)[::-1] * -_STEP
        tilt = np.outer(1 - blend, rng.normal(0, 0.4, 3))
        carried = turn[0] * Rotation.from_rotvec(tilt)
        position = np.concatenate([position[0] + path, position])
        turn = Rotation.concatenate([carried, turn])
        elevator = np.r_[np.full(len(before), elevator[0]), elevator[:count]]
        command = np.r_[np.zeros(len(before)), command[:count]]
        time = np.r_[before, time] + start
    elevator, command = elevator[: len(time)], command[: len(time)]
    free = (start, start + (count - 1) * _STEP)
    if rng.uniform() < 0.5:  # It slides on the floor, level.
        velocity = states[-1, 3:6] * [0.6, 0.6, 0.0]
        after = np.arange(1, round(0.7 / _STEP)) * _STEP
        stop = np.minimum(after, np.linalg.norm(velocity) / 4.0)
        slow = 4.0 * velocity / max(np.linalg.norm(velocity), 1e-6)
        path = np.outer(stop, velocity) - 0.5 * np.outer(stop**2, slow)
        level = Rotation.from_euler("ZYX", turn[-1].as_euler("ZYX") * [1, 0, 0])
        position = np.concatenate([position, position[-1] + path])
        turn = Rotation.concatenate(
            [turn, level[None] if level.single else level]
            if False
            else [turn, Rotation.from_quat(np.tile(level.as_quat(), (len(after), 1)))]
        )
        elevator = np.r_[elevator, np.full(len(after), elevator[-1])]
        command = np.r_[command, np.zeros(len(after))]
        time = np.r_[time, time[-1] + after]
    stride = max(1, round(1 / (_STEP * rate)))
    rows = slice(rng.integers(stride), None, stride)
    return Take(
        time[rows], position[rows], turn[rows], elevator[rows], command[rows], free
    )
