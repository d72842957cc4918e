"""Lesson 4: which numbers drift? A filter that estimates parameters in flight.

The article's section "Physical parameters". The wing's offset l_w and the elevator's
area S_e are taken for slow states beside those of the flight,

    z = (x, l_w, S_e),   ż = (f(x, u; l_w, S_e), 0, 0),   y = x + noise,

and an extended Kalman filter runs on z. Nothing measures either number: they show in
the innovation, as far as the motion depends on them. The glider is held near level
flight by LQR with elevator and thrust, in a wind that drifts and that the filter
knows.

Then the same filter watches a perch, as the article only suggests. How much better a
perch could determine constant parameters than a settled cruise of the same glider and
duration follows from Fisher information,

    P ≥ (P₀⁻¹ + Σ_k G_kᵀ R⁻¹ G_k)⁻¹,   G_k = ∂y_k/∂z₀ along the true flight.

The filter's own deviations are larger: its process noise lets both numbers drift.

Where we differ: at 9 m/s the lift of the article's trim (nose up by 0.05 rad) is less
than half of the weight, so this is the trim that flies level; its filter takes steps of
1/119 s through samples that are 0.01 s apart; its process noise is here a variance per
second.

    python examples/article/filter_parameters.py --figure filter.png
"""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from pydrake.systems.controllers import LinearQuadraticRegulator
from scipy.optimize import fsolve

from course import SHOWN, compare, draw_attitudes, picture, read_options, start
from glider import GliderModel, PerchingProblem, effects, plan, tracking_policy
from glider.paths import models_path
from glider.physics.parameters import Theta, load_parameters
from glider.report.plots.style import BLUE, RED

ARTICLE = {
    "Glide under LQR through drifting wind": SHOWN,
    "Estimates of l_w and S_e over time": SHOWN,
    "l_w [m] after 4 s of cruise, true: -0.0300": "-",
    "S_e [m²] after 4 s of cruise, true: 0.0147": "-",
    "l_w, S_e after a perch of 0.7 s, true: 0, 0.0147": "-",
    "Least deviations of constants: settled cruise": "-",
    "Least deviations of constants: perch": "less",
}

STEP = 0.01  # [s]
CRUISE_SPEED = 9.0  # [m/s]
CRUISE_SECONDS = 4.0
CRUISE_START = np.array([-3.5, 0.5, 0.0, 0.0, 7.0, 0.0, 0.0])
CRUISE_WIND = np.array([-1.0, 0.5])
PERCH_GUESS = (0.02, 0.0)
"""Of l_w and S_e before the perch: wrong, since its true l_w is zero."""

# Variances of the filter: before the first sample, of a reading, per second.
PRIOR = 0.1 * np.eye(9)
READING = 0.01 * np.eye(7)
PROCESS = np.diag([0.01] * 7 + [0.001] * 2)

TINY = 1e-30
"""Length of a complex step."""

SHOWS = np.eye(7, 9)
"""H: what is measured of z."""


# ------------------------------------------------------------------------ the glider


def slopes(model: GliderModel, z: np.ndarray, inputs: np.ndarray) -> np.ndarray:
    """Returns ż (9,) at z, real or complex.

    Args:
        model: a glider with the effect THRUST, whose force is an input.
        z: (9,) state, wing offset [m], elevator area [m²].
        inputs: (4,) elevator rate [rad/s], thrust [N], wind x and z [m/s].
    """
    rate, thrust, *wind = inputs
    own = model.numbers
    p = own.p._replace(wing_offset=z[7], elevator_area=z[8])
    theta = Theta(p, np.array([thrust]), own.gaussians)
    return np.array([*model.chain.derivatives(0.0, z[:7], rate, *wind, theta), 0, 0])


def slope_matrix(model: GliderModel, z: np.ndarray, inputs: np.ndarray) -> np.ndarray:
    """Returns ∂ż/∂(z, inputs), (9, 13), by complex steps."""
    columns = []
    for unit in np.eye(13):
        moved = 1j * TINY * unit
        columns.append(slopes(model, z + moved[:9], inputs + moved[9:]).imag / TINY)
    return np.array(columns).T


class Flight(NamedTuple):
    """A flight of K steps, its readings, and the glider that flew."""

    model: GliderModel
    states: np.ndarray  #: (K + 1, 9) z, of which the last two stay.
    inputs: np.ndarray  #: (K, 4) elevator rate, thrust, wind.
    readings: np.ndarray  #: (K, 7) behind each step.


def fly(
    model: GliderModel,
    launch: np.ndarray,
    wind: np.ndarray,
    feedback,
    rng: np.random.Generator,
) -> Flight:
    """Flies by Euler steps under `feedback(k, x)`: elevator rate and thrust."""
    p = model.parameters
    low, high, fastest = p.servo
    states = [np.array([*launch, p.wing_offset, p.elevator_area])]
    inputs = []
    for k, air in enumerate(wind):
        now = states[-1]
        elevator = now[3]
        rate, thrust = feedback(k, now[:7])
        rate = np.clip(rate, -fastest, fastest)
        rate = np.clip(rate, (low - elevator) / STEP, (high - elevator) / STEP)
        given = np.array([rate, thrust, *air])
        inputs.append(given)
        states.append(now + STEP * slopes(model, now, given))
    flown = np.array(states)
    noise = rng.multivariate_normal(np.zeros(7), READING, len(wind))
    readings = flown[1:, :7] + noise
    return Flight(model, flown, np.array(inputs), readings)


# ------------------------------------------------------------------------ the cruise


def level_flight(model: GliderModel) -> tuple[np.ndarray, float]:
    """Returns state (7,) and thrust [N] of level flight in still air."""
    p = model.parameters

    def point(unknown):
        pitch, elevator, thrust = unknown
        return np.array([0, 0, pitch, elevator, CRUISE_SPEED, 0, 0]), thrust

    def accelerations(unknown):
        x, thrust = point(unknown)
        z = np.array([*x, p.wing_offset, p.elevator_area])
        return slopes(model, z, np.array([0.0, thrust, 0.0, 0.0]))[4:7]

    return point(fsolve(accelerations, [-0.1, 0.1, 0.3], xtol=1e-12))


def cruise_gain(model: GliderModel, trim: np.ndarray, thrust: float) -> np.ndarray:
    """Returns K (2, 7) of the infinite-horizon LQR on all states but x."""
    p = model.parameters
    z = np.array([*trim, p.wing_offset, p.elevator_area])
    slope = slope_matrix(model, z, np.array([0.0, thrust, 0.0, 0.0]))
    A = slope[1:7, 1:7]
    B = slope[1:7, 9:11]
    Q = np.diag([1000.0, 1.0, 1.0, 1.0, 1.0, 1.0])
    R = 0.1 * np.eye(2)
    gain, _ = LinearQuadraticRegulator(A, B, Q, R)
    return np.hstack([np.zeros((2, 1)), gain])


def draw_wind(first: np.ndarray, steps: int, rng: np.random.Generator) -> np.ndarray:
    """Draws the article's wind (steps, 2) [m/s]: w ← 0.999 w + 0.01 N(0, I)."""
    wind = [first]
    while len(wind) < steps:
        wind.append(0.999 * wind[-1] + 0.01 * rng.normal(size=2))
    return np.array(wind)


def fly_cruise(
    model: GliderModel, start: np.ndarray | None, air: np.ndarray, rng
) -> Flight:
    """Flies the cruise from a launch; None: from its trim."""
    trim, thrust = level_flight(model)
    gain = cruise_gain(model, trim, thrust)
    wind = draw_wind(air, round(CRUISE_SECONDS / STEP), rng)
    launch = trim if start is None else start

    def feedback(k, x):
        return np.array([0.0, thrust]) - gain @ (x - trim)

    return fly(model, launch, wind, feedback, rng)


def fly_perch(model: GliderModel, rng: np.random.Generator) -> Flight:
    """Plans a perch without thrust and flies it under finite-horizon LQR."""
    policy = tracking_policy(model, plan(model, PerchingProblem()))
    times = np.arange(0.0, policy.duration, STEP)
    offset, gain = policy.sample(times)
    wind = draw_wind(np.zeros(2), len(times), rng)

    def feedback(k, x):
        return offset[k] - gain[k] @ x[: gain.shape[1]], 0.0

    return fly(model, policy.plan.states[0, :7], wind, feedback, rng)


# ------------------------------------------------------------------------ the filter


def run_filter(
    flight: Flight, guess: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """Runs the extended Kalman filter along a flight.

    Args:
        flight: of which it gets the launch, inputs and readings.
        guess: of wing offset and elevator area.

    Returns:
        means (K + 1, 9) and covariances (K + 1, 9, 9) of z.
    """
    mean = np.array([*flight.states[0, :7], *guess])
    covariance = PRIOR
    means = [mean]
    covariances = [covariance]
    for inputs, reading in zip(flight.inputs, flight.readings, strict=True):
        # Predict: the mean by the model, the covariance by its slope.
        slope = slope_matrix(flight.model, mean, inputs)
        F = np.eye(9) + STEP * slope[:, :9]
        mean = mean + STEP * slopes(flight.model, mean, inputs)
        covariance = F @ covariance @ F.T + STEP * PROCESS
        # Correct: by the innovation, weighted by the Kalman gain.
        S = SHOWS @ covariance @ SHOWS.T + READING
        gain = np.linalg.solve(S, SHOWS @ covariance).T
        innovation = reading - SHOWS @ mean
        mean = mean + gain @ innovation
        covariance = covariance - gain @ S @ gain.T
        means.append(mean)
        covariances.append(covariance)
    return np.array(means), np.array(covariances)


def least_deviations(flight: Flight, steps: int) -> np.ndarray:
    """Returns the least standard deviations of l_w and S_e after some steps, (2,)."""
    information = np.linalg.inv(PRIOR)
    so_far = np.eye(9)
    for z, inputs in zip(flight.states[:steps], flight.inputs[:steps], strict=True):
        slope = slope_matrix(flight.model, z, inputs)
        so_far = so_far + STEP * slope[:, :9] @ so_far
        seen = SHOWS @ so_far
        information = information + seen.T @ np.linalg.solve(READING, seen)
    least = np.linalg.inv(information)
    return np.sqrt(np.diagonal(least)[7:])


# --------------------------------------------------------------------------- lecture


def main(arguments: Sequence[str] | None = None) -> dict[str, str]:
    """Flies and filters a cruise and a perch."""
    path = read_options(__doc__, arguments)
    rng = np.random.default_rng(0)
    behind, centered = (
        GliderModel(
            parameters=load_parameters(models_path("vehicles", f"{name}.yaml")),
            effects=(effects.THRUST(),),
        )
        for name in ("heavy_ekf", "heavy")
    )
    cruise = fly_cruise(behind, CRUISE_START, CRUISE_WIND, rng)
    perch = fly_perch(centered, rng)
    known = {
        "cruise": (cruise, *run_filter(cruise, (0.0, 0.0))),
        "perch": (perch, *run_filter(perch, PERCH_GUESS)),
    }

    settled = fly_cruise(centered, None, np.zeros(2), rng)
    steps = len(perch.inputs)
    least = [least_deviations(flight, steps) for flight in (settled, perch)]

    in_cruise = [_told(known["cruise"], k) for k in (7, 8)]
    at_wire = (_told(known["perch"], k) for k in (7, 8))
    if path:
        draw(path, known)
    return compare(
        ARTICLE,
        SHOWN,
        SHOWN,
        *in_cruise,
        ", ".join(at_wire),
        *(f"{l_w:.4f} m, {S_e:.5f} m²" for l_w, S_e in least),
    )


def _told(known: tuple[Flight, np.ndarray, np.ndarray], k: int) -> str:
    _, means, covariances = known
    return f"{means[-1, k]:.4f} ± {np.sqrt(covariances[-1, k, k]):.4f}"


def draw(path: Path, known: dict[str, tuple[Flight, np.ndarray, np.ndarray]]) -> None:
    """Draws the glide in its wind, and both numbers over time."""
    cruise, *_ = known["cruise"]
    with picture(path, 9.0, 6.4) as figure:
        glide, *rest = figure.subplot_mosaic("AA;BC", height_ratios=[1, 1.2]).values()
        draw_attitudes(glide, cruise.states, every=20)
        every = slice(None, None, 20)
        glide.quiver(
            *cruise.states[:-1][every, :2].T,
            *cruise.inputs[every, 2:].T,
            color=BLUE,
            width=0.002,
        )
        glide.set(xlabel="x [m]", ylabel="z [m]")
        glide.set_title("cruise; arrows: the wind", loc="left")
        names = ("wing offset l_w [m]", "elevator area S_e [m²]")
        for ax, k, name in zip(rest, (7, 8), names, strict=True):
            for label, color in (("cruise", BLUE), ("perch", RED)):
                draw_estimate(ax, known[label], k, label, color)
            ax.set(xlabel="time [s]", ylabel=name)
            ax.legend()
        rest[0].set_ylim(-0.1, 0.1)
        rest[1].set_ylim(-0.02, 0.05)


def draw_estimate(
    ax: Axes,
    known: tuple[Flight, np.ndarray, np.ndarray],
    k: int,
    label: str,
    color: str,
) -> None:
    """Draws an estimate with twice its deviation, and the true number."""
    flight, means, covariances = known
    times = STEP * np.arange(len(means))
    spread = 2.0 * np.sqrt(covariances[:, k, k])
    mean = means[:, k]
    ax.fill_between(times, mean - spread, mean + spread, color=color, alpha=0.15, lw=0)
    ax.plot(times, mean, color=color, label=label)
    ax.plot(times[[0, -1]], flight.states[[0, -1], k], color=color, ls="--", lw=1.0)


if __name__ == "__main__":
    start(main)
