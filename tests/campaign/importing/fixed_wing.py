"""A simulated fixed-wing aircraft with a motor, as PX4 logs it."""

import dataclasses
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from glider.physics.effects import Effect
from glider.physics.effects.wrench import THRUST
from glider.physics.model import GliderModel
from glider.physics.parameters import GliderParameters
from glider.simulation.campaigns import fly_path
from glider.sysid.replay.log_space import log_space_of, vector_of
from tests.campaign.importing.foreign import NED, ulog_bytes

RATE = 50.0  # Of all topics [Hz].
FINE = 10  # Integration steps between two rows.
AIRPLANE = GliderParameters(
    mass=1.2,
    pitch_inertia=0.06,
    wing_area=0.35,
    elevator_area=0.05,
    wing_offset=0.0,
    hinge_offset=0.55,
    elevator_offset=0.03,
    elevator_limits=[-0.4, 0.4],
    elevator_rate_limit=6.0,
)
TRAVEL = 0.4  # Of the elevator at a command of 1 [rad].
TRIM = 0.155  # Angle of the elevator that holds 13 m/s [rad].
MAP = """\
columns: {position: vehicle_local_position, attitude: vehicle_attitude.q,
          elevator_angle_command: "actuator_servos.control[2]"}
units: {elevator_angle_command: {gain: 0.4}}
frame: NED
vehicle: {mass: 1.2, wing_area: 0.35, elevator_rate_limit: 6.0,
          elevator_limits: [-0.4, 0.4]}
"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Motored:
    """A flight: motor on, then off, with doublets of the elevator."""

    time: np.ndarray  # (n,) [s]
    states: np.ndarray  # (n, 7)
    elevator: np.ndarray  # (n,) as commanded [rad].


def fly(
    rng: np.random.Generator, motor: float, glide: float, thrust: float = 2.2
) -> Motored:
    """Flies some seconds with the motor on, then some with it off."""
    space = log_space_of(GliderModel(effects=(Effect(kind=THRUST, values=(1.0,)),)))
    rows = round((motor + glide) * RATE) + 1
    time = np.arange(rows) / RATE
    command = np.full(rows, TRIM)
    for begin in np.arange(1.0, motor + glide - 2.0, 3.0) + rng.uniform(0.0, 0.5):
        size, half = rng.uniform(0.03, 0.06), rng.uniform(0.3, 0.5)
        command += size * ((time >= begin) & (time < begin + half))
        command -= size * ((time >= begin + half) & (time < begin + 2 * half))
    # In small steps, as an autopilot commands: 0.04 rad a row at most.
    for k in range(1, rows):
        command[k] = command[k - 1] + np.clip(command[k] - command[k - 1], -0.04, 0.04)
    fine = np.arange((rows - 1) * FINE + 1) / (RATE * FINE)
    path = np.interp(fine, time, command)
    start = np.array([0.0, 60.0, -0.15, 0.0, 13.0, 0.0, 0.0])
    start += rng.normal(size=7) * [0, 0, 0.02, 0, 0.3, 0.2, 0.05]
    parts, since = [], 0
    for until, force in ((motor, thrust), (motor + glide, 0.0)):
        last = round(until * RATE) * FINE
        if last <= since:
            continue
        span = slice(since, last + 1)
        middle = 0.5 * (path[since:last] + path[since + 1 : last + 1])
        elevator = np.stack([path[since:last], middle, path[since + 1 : last + 1]], 1)
        model = GliderModel(
            parameters=AIRPLANE, effects=(Effect(kind=THRUST, values=(force,)),)
        )
        rate = np.diff(path[span]) * RATE * FINE
        states = fly_path(space, vector_of(model), start, fine[span], elevator, rate)
        parts.append(states[bool(parts) :, :7])
        start, since = states[-1, :7], last
    states = np.concatenate(parts)
    return Motored(time=time, states=states[::FINE], elevator=command)


def write(path: Path, flight: Motored, rng: np.random.Generator):
    """Writes PX4's topics."""
    x, z, pitch = flight.states.T[:3]
    rows = len(flight.time)
    place = np.column_stack([x, np.zeros(rows), z])
    place += rng.normal(size=place.shape) * 0.003
    angle = pitch + rng.normal(size=rows) * 0.001
    turn = NED @ Rotation.from_euler("y", angle[:, None]).as_matrix() @ NED.T
    x, y, z, w = Rotation.from_matrix(turn).as_quat().T
    servos = np.zeros((rows, 8))
    servos[:, 2] = flight.elevator / TRAVEL
    topics = {
        ("vehicle_local_position", "float x;float y;float z;"): place @ NED.T,
        ("vehicle_attitude", "float[4] q;"): np.column_stack([w, x, y, z]),
        ("actuator_servos", "float[8] control;"): servos,
    }
    stamp = np.round(1e6 * (flight.time + 9)).astype(np.uint64)
    surfaces = {"CA_SV_CS0_TYPE": 1, "CA_SV_CS1_TYPE": 2, "CA_SV_CS2_TYPE": 3}
    path.write_bytes(ulog_bytes(topics, stamp, surfaces))
    return path
