"""Flights of a glider that shares no physics with the library.

Vectors are complex numbers, p = x + i z, so that a turn is a product: the body axis is
t = exp(-iθ), the wing's normal n = i t, a point r of the body moves at v - i θ̇ r, and a
force F at r turns the nose up by Im(conj(r) F). Signs and frame as everywhere: angles
turn about +y, positive pitch is nose down, positive elevator is trailing edge up.

All flights of a campaign are flown at once: what is called (F,) has one number a
flight, and every number of a glider may be one for all flights or one a flight.
"""

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

STEP = 1.0 / 1200.0
"""Step of the integration [s]; rows and commands fall on it."""

Number = float | np.ndarray


class Flow(NamedTuple):
    """What a term of the forces may depend on, (F,) each."""

    t: float
    x: np.ndarray
    z: np.ndarray
    alpha: np.ndarray  # Angle of attack of the body axis [rad].
    speed: np.ndarray  # Through the air [m/s].
    pitchdot: np.ndarray  # Nose down [rad/s].
    elevator: np.ndarray
    lags: np.ndarray  # (L, F) own states of terms.
    normal: np.ndarray  # C_n of the wing, once it is known; before, 0.


Term = Callable[[Flow], Number]


class Lag(NamedTuple):
    """An own state of a term."""

    rate: Callable[[Flow, np.ndarray], np.ndarray]
    rest: Callable[[Flow], np.ndarray]


@dataclasses.dataclass(kw_only=True)
class Servo:
    """What turns commands into the elevator's angle.

    The commanded angle is the integral of the commands, `delay` late. A `lag` follows
    it to first order; `natural_frequency` and `damping_ratio` to second order; `slew`
    limits the rate at which a quick servo (20 ms) comes after it.
    """

    delay: float = 0.0  # [s]
    lag: float = 0.0  # [s]
    natural_frequency: float = 0.0  # [rad/s]
    damping_ratio: float = 1.0
    slew: float = 0.0  # [rad/s]; 0 for no limit.


@dataclasses.dataclass(kw_only=True)
class Glider:
    """A glider, its air and its sensors: two flat plates, and terms that add to them.

    Terms of the forces are coefficients referred to ½ ρ V² S_w at the center of mass.
    """

    mass: Number = 0.08
    pitch_inertia: Number = 0.0015
    wing_area: Number = 0.0885
    elevator_area: Number = 0.0147
    wing_offset: Number = 0.0
    hinge_offset: Number = 0.27
    elevator_offset: Number = 0.022
    air_density: Number = 1.204
    gravity: float = 9.81
    elevator_limits: tuple[float, float] = (-0.4463, 0.9473)
    thrust: Number = 0.0  # Along the body axis [N].
    wing_incidence: Number = 0.0  # Of the wing's plate, nose down [rad].
    elevator_trim: Number = 0.0  # True minus read angle [rad].
    wind: complex | np.ndarray = 0.0  # x + i z [m/s].
    servo: Servo = dataclasses.field(default_factory=Servo)

    winds: list[Term] = dataclasses.field(default_factory=list)  # Along x [m/s].
    normal: list[Term] = dataclasses.field(default_factory=list)  # C_n of the wing.
    axial: list[Term] = dataclasses.field(default_factory=list)  # C_A, to the tail.
    drag: list[Term] = dataclasses.field(default_factory=list)  # C_D.
    moment: list[Term] = dataclasses.field(default_factory=list)  # C_m [m], nose down.
    wing_factor: list[Term] = dataclasses.field(default_factory=list)
    elevator_factor: list[Term] = dataclasses.field(default_factory=list)
    wing_shift: list[Term] = dataclasses.field(default_factory=list)  # Ahead [m].
    downwash: list[Term] = dataclasses.field(default_factory=list)  # At the tail [m/s].
    lags: list[Lag] = dataclasses.field(default_factory=list)

    marker_offset: complex = 0.0  # Ahead + i above [m].
    frame_tilt: float = 0.0  # [rad]
    pitch_offset: Number = 0.0  # [rad]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Motion:
    """States of F flights at K + 1 times."""

    time: np.ndarray  # (K + 1,) [s]
    position: np.ndarray  # (K + 1, F) x + i z [m]
    velocity: np.ndarray  # (K + 1, F) [m/s]
    pitch: np.ndarray  # (K + 1, F) [rad]
    pitchdot: np.ndarray  # (K + 1, F) [rad/s]
    elevator: np.ndarray  # (K + 1, F) as its sensor stands, without trim [rad]
    alpha: np.ndarray  # (K + 1, F) [rad]


def _sum(terms: list[Term], flow: Flow) -> Number:
    return sum((term(flow) for term in terms), 0.0)


def flow_of(glider, t, state, elevator, air) -> tuple[Flow, np.ndarray]:
    """Returns the Flow and the velocity through the air of a state (4 + L, F)."""
    position, velocity, pitch, pitchdot = state[:4]
    still = Flow(
        t,
        position.real,
        position.imag,
        0.0,
        0.0,
        pitchdot.real,
        elevator,
        state[4:].real,
        0.0,
    )
    through = velocity - glider.wind - air - _sum(glider.winds, still)
    alpha = -np.angle(through * np.exp(1j * pitch.real))
    return still._replace(alpha=alpha, speed=np.abs(through)), through


def rates(glider: Glider, t, state, elevator, elevator_rate, air) -> np.ndarray:
    """Returns d/dt of states (4 + L, F): position, velocity, pitch, its rate, lags.

    Args:
        glider: what flies.
        t: [s].
        state: complex; the pitch, its rate and the lags have no imaginary part.
        elevator: (F,) as its sensor stands [rad].
        elevator_rate: (F,) [rad/s].
        air: (F,) velocity of the air beyond the glider's winds, x + i z [m/s].
    """
    g = glider
    pitch, pitchdot = state[2].real, state[3].real
    flow, through = flow_of(g, t, state, elevator, air)
    axis = np.exp(-1j * pitch)
    normal = 1j * axis
    pressure_area = 0.5 * g.air_density * flow.speed**2 * g.wing_area

    wing_arm = (g.wing_offset + _sum(g.wing_shift, flow)) * axis
    plate = normal * np.exp(-1j * g.wing_incidence)
    c_normal = _sum(g.normal, flow)
    factor = 1.0 + _sum(g.wing_factor, flow)
    wing = _plate(through - 1j * pitchdot * wing_arm, plate, g.wing_area, g.air_density)
    wing = factor * (wing + pressure_area * c_normal * plate)

    tail_axis = axis * np.exp(-1j * (elevator + g.elevator_trim))
    hinge, from_hinge = -g.hinge_offset * axis, -g.elevator_offset * tail_axis
    at_tail = through + _sum(g.downwash, flow) * normal
    at_tail = at_tail - 1j * pitchdot * (hinge + from_hinge)
    at_tail = at_tail - 1j * elevator_rate * from_hinge
    tail = _plate(at_tail, 1j * tail_axis, g.elevator_area, g.air_density)
    tail = tail * (1.0 + _sum(g.elevator_factor, flow))

    flow = flow._replace(normal=2.0 * np.sin(flow.alpha) + c_normal)
    force = wing + tail + g.thrust * axis
    force = force - pressure_area * _sum(g.axial, flow) * axis
    force = force - pressure_area * _sum(g.drag, flow) * through / flow.speed
    nose_up = (np.conj(wing_arm) * wing + np.conj(hinge + from_hinge) * tail).imag
    nose_down = pressure_area * _sum(g.moment, flow) - nose_up

    result = np.empty_like(state)
    result[0] = state[1]
    result[1] = force / g.mass - 1j * g.gravity
    result[2] = pitchdot
    result[3] = nose_down / g.pitch_inertia
    for i, lag in enumerate(g.lags):
        result[4 + i] = lag.rate(flow, flow.lags[i])
    return result


def _plate(velocity, normal, area, density):
    """Returns the force on a plate that meets the air with C_n = 2 sin α."""
    across = (np.conj(normal) * velocity).real
    return -density * area * across * np.abs(velocity) * normal


def elevator_paths(
    servo: Servo, commands: np.ndarray, period: float, half_steps: int, limits
) -> np.ndarray:
    """Returns the elevator's angles (half_steps + 1, F) at every half STEP [rad].

    Args:
        servo: what follows the commands.
        commands: (H, F) elevator rates, each held for a period [rad/s].
        period: [s].
        half_steps: how many.
        limits: the elevator's travel [rad].
    """
    h = 0.5 * STEP
    flights = commands.shape[1]
    edges = period * np.arange(len(commands) + 1)
    whole = np.vstack([np.zeros(flights), period * np.cumsum(commands, axis=0)])
    late = h * np.arange(half_steps + 1) - servo.delay
    wanted = np.stack([np.interp(late, edges, column) for column in whole.T], axis=1)
    rate, angle = np.zeros(flights), np.zeros(flights)
    paths = np.zeros((half_steps + 1, flights))
    follow = np.exp(-h / servo.lag) if servo.lag else 0.0
    followed = np.zeros(flights)
    for k in range(half_steps):
        command = (wanted[k + 1] - wanted[k]) / h
        followed = followed + command * h
        if servo.natural_frequency:
            for _ in range(4):  # Semi-implicit: at 60 rad/s good to 1e-4.
                pull = servo.natural_frequency**2 * (followed - angle)
                push = 2.0 * servo.damping_ratio * servo.natural_frequency * rate
                rate = rate + 0.25 * h * (pull - push)
                angle = angle + 0.25 * h * rate
        elif servo.slew:
            rate = np.clip((followed - angle) / 0.02, -servo.slew, servo.slew)
            angle = angle + h * rate
        elif servo.lag:  # Exact for a command that is held over the half step.
            excess = rate - command
            angle = angle + command * h + servo.lag * (1.0 - follow) * excess
            rate = command + follow * excess
        else:
            angle = angle + command * h
        angle = np.clip(angle, *limits)
        paths[k + 1] = angle
    return paths


def fly(
    glider: Glider,
    start: np.ndarray,
    elevator: np.ndarray,
    air: np.ndarray | None = None,
) -> Motion:
    """Flies all flights of a campaign by Runge-Kutta steps.

    Args:
        glider: what flies.
        start: (4, F) complex: position, velocity, pitch, pitch rate.
        elevator: (2 K + 1, F) its angles at every half STEP [rad].
        air: (2 K + 1, F) velocity of the air there, x + i z [m/s]; None for still.
    """
    steps = len(elevator) // 2
    if air is None:
        air = np.zeros_like(elevator)
    state = start.astype(complex)
    flow, _ = flow_of(glider, 0.0, state, elevator[0], air[0])
    rest = [lag.rest(flow) + 0.0 * flow.speed for lag in glider.lags]
    state = np.concatenate([state, np.reshape(rest, (-1, state.shape[1]))])
    states = np.empty((steps + 1, *state.shape), complex)
    states[0] = state
    for k in range(steps):
        t, j = k * STEP, 2 * k
        turning = (elevator[j + 2] - elevator[j]) / STEP

        def rate(i, x, t=t, j=j, turning=turning):
            node = j + i
            return rates(
                glider, t + 0.5 * STEP * i, x, elevator[node], turning, air[node]
            )

        first = rate(0, state)
        second = rate(1, state + 0.5 * STEP * first)
        third = rate(1, state + 0.5 * STEP * second)
        fourth = rate(2, state + STEP * third)
        state = state + STEP / 6.0 * (first + 2.0 * (second + third) + fourth)
        states[k + 1] = state
    alpha = [
        flow_of(glider, k * STEP, x, elevator[2 * k], air[2 * k])[0].alpha
        for k, x in enumerate(states)
    ]
    return Motion(
        time=STEP * np.arange(steps + 1),
        position=states[:, 0],
        velocity=states[:, 1],
        pitch=states[:, 2].real,
        pitchdot=states[:, 3].real,
        elevator=elevator[::2],
        alpha=np.array(alpha),
    )


def shown_pose(glider: Glider, motion: Motion) -> np.ndarray:
    """Returns the poses (K + 1, F, 3) that the glider's sensors show without noise."""
    axis = np.exp(-1j * motion.pitch)
    point = motion.position + glider.marker_offset * axis
    point = point * np.exp(-1j * glider.frame_tilt)
    pitch = motion.pitch + glider.pitch_offset + glider.frame_tilt
    return np.stack([point.real, point.imag, pitch], axis=2)


def gusts(
    rng: np.random.Generator, std: float, correlation: float, shape: tuple[int, int]
) -> np.ndarray:
    """Returns air (2 K + 1, F) that moves in x and z as first-order Gauss-Markov."""
    keep = np.exp(-0.5 * STEP / correlation)
    kick = std * np.sqrt(1.0 - keep**2)
    noise = rng.normal(size=(*shape, 2)) @ np.array([1.0, 1j])
    air = np.empty(shape, complex)
    air[0] = std * noise[0]
    for k in range(1, len(air)):
        air[k] = keep * air[k - 1] + kick * noise[k]
    return air
