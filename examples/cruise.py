"""Trims a steady glide and holds it with a linear-quadratic regulator.

A glider without thrust cannot hold its height: its cruise is a straight glide down. The
trim has no acceleration at a fixed elevator. The regulator (infinite-horizon LQR) holds
the line and the speed, not the place along the line: it feeds back the distance from
the line and all states but x and z. The glider starts disturbed and must return.

    python examples/cruise.py
    python examples/cruise.py --speed 6 --headless
"""

import math
import sys
from collections.abc import Sequence

import numpy as np
from pydrake.systems.controllers import LinearQuadraticRegulator
from pydrake.systems.framework import OutputPortSelection
from pydrake.systems.primitives import AffineSystem, FirstOrderTaylorApproximation
from scipy.optimize import least_squares

from diagrams import closed_loop, playback, simulate_flights
from diagrams.programs import program
from glider import GliderModel, GliderPlant, InputError

LARGEST_ACCELERATION = 1e-8
"""Largest acceleration of a trim [m/s², rad/s²]."""

WEIGHTS = (10.0, 10.0, 1.0, 1.0, 1.0, 1.0)
"""Weights of the distance from the line, pitch, elevator, xdot, zdot and pitchdot."""

RATE_WEIGHT = 0.1
"""Weight of the elevator-rate command."""

DISTURBANCE = (0.0, 0.05, 0.02, -0.02, 0.2, -0.1, 0.1)
"""Error of the start against the trim, in the order of the states."""


def slope_of(state: np.ndarray) -> float:
    """Returns the angle of a state's path, positive when it climbs [rad]."""
    return math.atan2(state[5], state[4])


def find_trim(model: GliderModel, speed: float) -> np.ndarray:
    """Finds a state (n,) at a speed [m/s] that does not accelerate, elevator at rest.

    Raises:
        InputError: no such flight is found within the elevator's travel.
    """
    p = model.parameters
    pressure = p.air_density * p.wing_area * speed * speed
    alpha = min(p.mass * p.gravity / pressure, 0.6)

    def state_of(unknown: np.ndarray) -> np.ndarray:
        pitch, elevator, slope = unknown
        velocity = speed * math.cos(slope), speed * math.sin(slope)
        return model.initial_state([0.0, 0.0, pitch, elevator, *velocity, 0.0])

    def accelerations(unknown: np.ndarray) -> np.ndarray:
        state = state_of(unknown)
        rates = model.chain.derivatives(0.0, state, 0.0, 0.0, 0.0, model.numbers)
        return np.array(rates[4:7])

    guess = [0.0, alpha, -alpha]
    exact = dict.fromkeys(("xtol", "ftol", "gtol"), 1e-15)
    found = least_squares(accelerations, guess, bounds=(-1.5, 1.5), **exact)
    state = state_of(found.x)
    worst = float(np.max(np.abs(accelerations(found.x))))
    down, up, _ = p.servo
    if worst > LARGEST_ACCELERATION or not down <= state[3] <= up:
        raise InputError(
            f"No steady flight at {speed:g} m/s was found: the best has an "
            f"acceleration of {worst:.2g} at an elevator of {state[3]:.3f} rad; its "
            f"travel is {down:.3f} to {up:.3f}."
        )
    return state


def cruise_regulator(model: GliderModel, trim: np.ndarray) -> AffineSystem:
    """Makes the System u = -K (x - x_trim), without the place along the line.

    The error is e = T (x - x_trim): the distance n · (x, z) from the line with
    its normal n = (-sin γ, cos γ), then all states but x and z.

    Raises:
        InputError: the glider's dynamics change along the line.
    """
    plant = GliderPlant(model, fast=False)  # Differentiated once: not worth compiling.
    context = plant.CreateDefaultContext()
    context.SetContinuousState(trim)
    port = plant.GetInputPort("elevator_rate")
    port.FixValue(context, [0.0])
    linear = FirstOrderTaylorApproximation(
        plant, context, port.get_index(), OutputPortSelection.kNoOutput
    )
    A = linear.A()
    along = np.array([math.cos(slope_of(trim)), math.sin(slope_of(trim))])
    if np.max(np.abs(A[:, :2] @ along)) > LARGEST_ACCELERATION:
        raise InputError(
            "The glider's dynamics change along the line; no cruise is steady there."
        )
    n = len(trim)
    T = np.zeros((n - 1, n))
    T[0, :2] = -along[1], along[0]
    T[1:, 2:] = np.eye(n - 2)
    Q = np.diag(np.append(WEIGHTS, np.zeros(n - 1 - len(WEIGHTS))))
    # T has orthonormal rows, so that its transpose leads back.
    K, _ = LinearQuadraticRegulator(T @ A @ T.T, T @ linear.B(), Q, [[RATE_WEIGHT]])
    gain = K @ T
    regulator = AffineSystem(D=-gain, y0=gain @ trim)
    regulator.set_name("regulator")
    return regulator


def main(arguments: Sequence[str] | None = None) -> None:
    """Trims, disturbs and flies; prints how the disturbance decays."""
    parser = program.make_parser(__doc__)
    words = "of the glide [m/s] (default: %(default)s)"
    parser.add_argument("--speed", type=float, default=7.0, help=words)
    args = program.read_options(parser, arguments)

    model = GliderModel()
    trim = find_trim(model, args.speed)
    slope = slope_of(trim)
    pitch, elevator = np.degrees(trim[2:4])
    print(
        f"Trimmed at {math.hypot(*trim[4:6]):.2f} m/s: path "
        f"{math.degrees(slope):.1f}°, nose {-pitch:.1f}° up, elevator {elevator:.1f}°."
    )
    loop = closed_loop(model, cruise_regulator(model, trim), all_states=True)
    start = trim + DISTURBANCE
    with program.working("fly (compiles once)"):
        [flight] = simulate_flights(loop, start[None], 12.0)
    across = flight.states[:, :2] @ [-math.sin(slope), math.cos(slope)]
    first, last = 1000.0 * np.abs(across[[0, -1]])
    print(
        f"{first:.0f} mm off the line at the start, {last:.2f} mm after "
        f"{flight.times[-1]:.0f} s."
    )
    track = playback.track_of("disturbed glide", flight)
    program.show(args, [track], "Cruise", has_wire=False)


if __name__ == "__main__":
    sys.exit(program.run(main))
