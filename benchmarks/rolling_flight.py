"""Flights in three dimensions of gliders that roll, yaw and slip.

The body's plane of symmetry contains its nose and the normal of its wing. The forces of
`tests.helpers.lifelike_flight` act in that plane, on what the air does in it; a fin
weathervanes the glider into its slip. Axes are forward, left and up.
"""

import dataclasses

import numpy as np

from tests.helpers.lifelike_flight import STEP, Glider, flow_of, rates

FIN_ARM = 0.27
"""Of the fin behind the center of mass [m]."""

YAW_INERTIA = 0.0018
"""[kg m²]"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Rolls:
    """How F flights roll, by whatever moment that needs: evenly."""

    first: np.ndarray  #: (F,) at launch, left wing up [rad].
    last: np.ndarray  #: (F,) at the end [rad].
    fin: float  #: Area of the fin [m²].


def fly_rolling(
    glider: Glider,
    rolls: Rolls,
    start: np.ndarray,
    elevator: np.ndarray,
    air: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Flies all flights of a campaign by Runge-Kutta steps.

    Args:
        glider: what flies.
        rolls: of its flights.
        start: (4, F) complex: position, velocity, pitch, pitch rate, see `draw_starts`.
        elevator: (2 K + 1, F) its angles at every half STEP [rad].
        air: (2 K + 1, F) velocity of the air there, x + i z [m/s]; None for still.

    Returns:
        Poses (K + 1, F, 3) in the plane x, z of the launch: positions and the pitch of
        the nose; and y, roll and yaw (K + 1, F, 3), as a log with them has it.
    """
    steps = len(elevator) // 2
    flights = elevator.shape[1]
    if air is None:
        air = np.zeros_like(elevator)
    turning = (rolls.last - rolls.first) / (steps * STEP)

    def axes(time: float, yaw: np.ndarray) -> tuple[np.ndarray, ...]:
        """Level nose, the wing's normal at no pitch, and left of the body, (3, F)."""
        roll = rolls.first + turning * time
        cos, sin, none = np.cos(yaw), np.sin(yaw), np.zeros(flights)
        left = np.array([-sin, cos, none])
        level = np.array([cos, sin, none])
        up = np.array([none, none, none + 1.0])
        top = np.cos(roll) * up - np.sin(roll) * left
        return level, top, np.cos(roll) * left + np.sin(roll) * up

    def split(time: float, x: np.ndarray, wind: np.ndarray) -> tuple[np.ndarray, ...]:
        """State of the plane of symmetry, and what goes on across it."""
        level, top, left = axes(time, x[8])
        flown = np.array([x[0] + 1j * x[2], *np.zeros((3, flights))], complex)
        flown[1] = np.sum(x[3:6] * level, 0) + 1j * np.sum(x[3:6] * top, 0)
        flown[2], flown[3] = x[6], x[7]
        vector = np.array([wind.real, np.zeros(flights), wind.imag])
        within = np.sum(vector * level, 0) + 1j * np.sum(vector * top, 0)
        slip = np.sum((x[3:6] - vector) * left, 0)
        return np.concatenate([flown, x[10:]]), within, slip

    def derivative(half: int, x: np.ndarray, turn: np.ndarray) -> np.ndarray:
        time = 0.5 * STEP * half
        level, top, left = axes(time, x[8])
        flown, within, slip = split(time, x, air[half])
        d = rates(glider, time, flown, elevator[half], turn, within)
        force = d[1] + 1j * glider.gravity  # Per mass, in the plane of symmetry.
        at_fin = slip - FIN_ARM * x[9]
        speed = np.hypot(np.abs(flown[1] - within), at_fin)
        side = -glider.air_density * rolls.fin * at_fin * speed
        out = np.empty_like(x)
        out[0:3] = x[3:6]
        out[3:6] = force.real * level + force.imag * top + side / glider.mass * left
        out[5] -= glider.gravity
        # The pitch turns about the left; of the yaw a part does, too.
        out[6] = d[2].real - x[9] * left[2]
        out[7] = d[3].real
        out[8] = x[9] * top[2]
        out[9] = -FIN_ARM * side / YAW_INERTIA
        out[10:] = d[4:].real
        return out

    first = np.zeros((10, flights))
    first[[0, 2]] = start[0].real, start[0].imag
    first[[3, 5]] = start[1].real, start[1].imag
    first[[6, 7]] = start[2].real, start[3].real
    state, within, _ = split(0.0, first, air[0])
    flow, _ = flow_of(glider, 0.0, state, elevator[0], within)
    rest = [lag.rest(flow) + 0.0 * flow.speed for lag in glider.lags]
    x = np.concatenate([first, np.reshape(rest, (-1, flights))])
    poses, aside = [], []
    for k in range(steps + 1):
        time = k * STEP
        level, top, left = axes(time, x[8])
        nose = np.cos(x[6]) * level - np.sin(x[6]) * top
        normal = np.sin(x[6]) * level + np.cos(x[6]) * top
        pitch = -np.arcsin(nose[2])
        poses.append(np.stack([x[0], x[2], pitch], axis=-1))
        roll = np.arctan2(left[2], normal[2])
        aside.append(np.stack([x[1], roll, np.arctan2(nose[1], nose[0])], axis=-1))
        if k == steps:
            break
        j = 2 * k
        turn = (elevator[j + 2] - elevator[j]) / STEP
        one = derivative(j, x, turn)
        two = derivative(j + 1, x + 0.5 * STEP * one, turn)
        three = derivative(j + 1, x + 0.5 * STEP * two, turn)
        four = derivative(j + 2, x + STEP * three, turn)
        x = x + STEP / 6.0 * (one + 2.0 * (two + three) + four)
    return np.array(poses), np.array(aside)
