"""Trims a steady glide and holds it with a linear-quadratic regulator.

A glider without thrust cannot hold its height: its cruise is a straight glide down. The
trim has no acceleration at a fixed elevator. The regulator (infinite-horizon LQR) holds
the line and the speed, not the place along the line: it feeds back the distance from
the line and all states but x and z. The glider starts disturbed and must return.

    python examples/cruise.py
    python examples/cruise.py --speed 6 --headless --json cruise.json

--json: {"speed", "slope_rad", "pitch_rad", "elevator_rad": the trim, "offset_m": the
distance from the line at the start and at the end, "seconds"}.
"""

import dataclasses
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
from glider import GliderModel, GliderPlant, InputError, Perches

LARGEST_ACCELERATION = 1e-8
"""Largest acceleration of a trim [m/s², rad/s²]."""

WEIGHTS = (10.0, 10.0, 1.0, 1.0, 1.0, 1.0)
"""Weights of the distance from the line, pitch, elevator, xdot, zdot and pitchdot."""

RATE_WEIGHT = 0.1
"""Weight of the elevator-rate command."""

DISTURBANCE = (0.0, 0.05, 0.02, -0.02, 0.2, -0.1, 0.1)
"""Error of the start against the trim, in the order of the states."""

SECONDS = 12.0
"""Duration of the flight [s]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Cruise:
    """A trim, and a disturbed flight that the regulator brings back to it."""

    trim: np.ndarray
    """State (n,) of a steady straight flight through the origin."""

    flights: Perches
    """One flight, from a disturbed start."""

    @property
    def slope(self) -> float:
        """Angle of the path, positive when it climbs [rad]."""
        return slope_of(self.trim)

    @property
    def offsets(self) -> tuple[float, float]:
        """Distance from the line at the start and at the end [m]."""
        normal = np.array([-math.sin(self.slope), math.cos(self.slope)])
        first, last = (abs(self.flights[0].states[k, :2] @ normal) for k in (0, -1))
        return float(first), float(last)

    def key_figures(self) -> dict[str, object]:
        """Returns the trim and the distances, for a file."""
        return {
            "speed": math.hypot(*self.trim[4:6]),
            "slope_rad": self.slope,
            "pitch_rad": float(self.trim[2]),
            "elevator_rad": float(self.trim[3]),
            "offset_m": list(self.offsets),
            "seconds": float(self.flights[0].times[-1]),
        }

    def describe(self) -> str:
        """Returns the trim, and how the disturbance decays."""
        first, last = self.offsets
        return (
            f"Trimmed at {math.hypot(*self.trim[4:6]):.2f} m/s: path "
            f"{math.degrees(self.slope):.1f}°, nose "
            f"{-math.degrees(self.trim[2]):.1f}° up, elevator "
            f"{math.degrees(self.trim[3]):.1f}°.\n"
            f"{1000 * first:.0f} mm off the line at the start, {1000 * last:.2f} mm "
            f"after {self.flights[0].times[-1]:.0f} s."
        )


def slope_of(state: np.ndarray) -> float:
    """Returns the angle of a state's path, positive when it climbs [rad]."""
    return math.atan2(state[5], state[4])


def find_trim(model: GliderModel, speed: float | None = None) -> np.ndarray:
    """Finds a state (n,) without acceleration while the elevator is at rest.

    Args:
        model: the glider.
        speed: of the flight [m/s], on the slope that results; None for level
            flight at the speed that results, which takes thrust.

    Raises:
        InputError: no such flight is found within the elevator's travel.
    """
    p = model.parameters
    v = 7.0 if speed is None else speed
    alpha = min(p.mass * p.gravity / (p.air_density * p.wing_area * v * v), 0.6)
    derivatives, theta = model.chain.derivatives, model.numbers

    def state_of(unknown: np.ndarray) -> np.ndarray:
        pitch, elevator, last = unknown
        velocity = (last, 0.0)
        if speed is not None:
            velocity = (speed * math.cos(last), speed * math.sin(last))
        return model.initial_state([0.0, 0.0, pitch, elevator, *velocity, 0.0])

    def accelerations(unknown: np.ndarray) -> np.ndarray:
        return np.array(derivatives(0.0, state_of(unknown), 0.0, 0.0, 0.0, theta)[4:7])

    if speed is None:
        guess, low, high = [-alpha, alpha, v], [-0.7, -1.5, 0.5], [0.7, 1.5, 60.0]
    else:
        guess, low, high = [0.0, alpha, -alpha], [-1.5] * 3, [1.5] * 3
    found = least_squares(
        accelerations, guess, bounds=(low, high), xtol=1e-15, ftol=1e-15, gtol=1e-15
    )
    state = state_of(found.x)
    worst = float(np.max(np.abs(accelerations(found.x))))
    down, up, _ = p.servo
    if worst > LARGEST_ACCELERATION or not down <= state[3] <= up:
        what = "level flight" if speed is None else f"flight at {speed:g} m/s"
        raise InputError(
            f"No steady {what} was found: the best has an acceleration of "
            f"{worst:.2g} at an elevator of {state[3]:.3f} rad; its travel is "
            f"{down:.3f} to {up:.3f}."
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
    A, B = linear.A(), linear.B()
    cosine, sine = math.cos(slope_of(trim)), math.sin(slope_of(trim))
    if np.max(np.abs(A[:, :2] @ [cosine, sine])) > LARGEST_ACCELERATION:
        raise InputError(
            "The glider's dynamics change along the line; no cruise is steady there."
        )
    n = len(trim)
    T = np.zeros((n - 1, n))
    T[0, :2] = -sine, cosine
    T[1:, 2:] = np.eye(n - 2)
    Q = np.diag(np.append(WEIGHTS, np.zeros(n - 1 - len(WEIGHTS))))
    # T has orthonormal rows, so that its transpose leads back.
    K, _ = LinearQuadraticRegulator(T @ A @ T.T, T @ B, Q, [[RATE_WEIGHT]])
    gain = K @ T
    regulator = AffineSystem(D=-gain, y0=gain @ trim)
    regulator.set_name("regulator")
    return regulator


def fly(
    model: GliderModel, speed: float | None = None, seconds: float = SECONDS
) -> Cruise:
    """Trims a glider and flies it from a disturbed start under the regulator."""
    trim = find_trim(model, speed)
    start = trim.copy()
    start[: len(DISTURBANCE)] += DISTURBANCE
    loop = closed_loop(model, cruise_regulator(model, trim), all_states=True)
    flights = simulate_flights(loop, start[None], seconds)
    return Cruise(trim=trim, flights=flights)


def main(arguments: Sequence[str] | None = None) -> None:
    """Flies as the command line says, prints and shows the result."""
    parser = program.make_parser(__doc__)
    words = "of the glide [m/s] (default: %(default)s)"
    parser.add_argument("--speed", type=float, default=7.0, help=words)
    args = program.read_options(parser, arguments)
    with program.working("trim and fly (compiles once)"):
        flown = fly(GliderModel(), args.speed)
    print(flown.describe())
    program.write_json(args, flown.key_figures())
    track = playback.track_of("disturbed glide", flown.flights[0])
    program.show(args, [track], "Cruise", has_wire=False)


if __name__ == "__main__":
    sys.exit(program.run(main))
