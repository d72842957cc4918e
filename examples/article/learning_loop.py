"""Lesson 9: plan, fly, learn, plan again.

The article's section "Closing the loop". The planner believes in the flat plate and a
residual, and so does the simulator that stands for the glider:

    ẋ = f_plate(x, u) + G(x, u) w

where the columns of G are Gaussians ψ times the dynamic pressure, turned into lift,
drag and moment. The planner's depend on angle of attack and elevator (26 weights each),
the simulator's on airspeed too (126 weights): no amount of data lets w describe that.
Each round plans by iLQR, flies u = ū + K (x - x̄) from a launch of another speed, and
finds w by ridge regression on all flights so far,

    min Σ_n ‖Π_a ((x_n+1 - x_n)/h - f_plate - G w)‖² + γ ‖w‖²,

Π_a taking the three accelerations. w starts at zero. Terminal costs vary with the speed
of the launch, as the article warns: they jump up where a launch is slow or fast. From
the planned launch they show what was learned. There are 20 rounds (the article's code
has 50), and no limit of the elevator acts.

    python examples/article/learning_loop.py --figure learning_loop.png
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib import colormaps

from course import (
    SHOWN,
    compare,
    draw_wire,
    legend_beside,
    picture,
    rates_of,
    read_options,
    start,
)
from glider import GliderModel
from glider.physics.effects.free_functions import COEFFICIENTS
from glider.report.plots.style import BLUE, RED
from residual_coefficients import RIDGE, Residual, features, gaussian_grid

ARTICLE = {
    "Executed rollouts over the iterations": SHOWN,
    "Terminal cost over the iterations": SHOWN,
    "Change of the weights over the iterations": SHOWN,
    "Weights of a coefficient: planner, simulator": "26, 126",
    "Terminal cost, first and median of the last five": "falls",
    "The same from the planned launch": "-",
    "Change of the weights, first and last": "falls",
    "Miss of the wire from the planned launch": "-",
}

STEP = 0.01  # [s]
STEPS = 75
ROUNDS = 20
SPEEDS = (6.5, 7.5)  # [m/s]
STATE_NOISE = 0.01
LAUNCH = np.array([-3.5, 0.1, 0.0, 0.0, 7.0, 0.0, 0.0])
GOAL = np.array([0.0, 0.0, -np.pi / 4, 0.0, 2.0, -2.0, 0.0])
FINAL = np.diag([1000.0, 1000.0, 100.0, 1.0, 1.0, 1.0, 1.0])
HOLD_STATE = 0.1 * np.eye(7)
HOLD_INPUT = 0.1
SHARES = 0.5 ** np.arange(10)
"""Shares of the feed-forward that the line search tries."""

TRUTH = GliderModel.load("low_reynolds")
"""A glider whose coefficients depend on the airspeed, as at low Reynolds numbers."""

PLATE = GliderModel(parameters=TRUTH.parameters)

# ------------------------------------------------------------------------ the glider


def accelerations_of(states: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Returns G w (3, N): what coefficients (N, 3) add to the accelerations.

    Lift turns the velocity up, drag opposes it, the moment is positive nose down; all
    over ½ ρ V² S_w.
    """
    p = PLATE.parameters
    xdot, zdot = states[4:6]
    lift, drag, moment = values.T
    speed = np.hypot(xdot, zdot)
    pressure = 0.5 * p.air_density * p.wing_area * speed
    force_x = pressure * (-lift * zdot - drag * xdot)
    force_z = pressure * (lift * xdot - drag * zdot)
    turn = pressure * speed * moment / p.pitch_inertia
    return np.array([force_x / p.mass, force_z / p.mass, turn])


def variables_of(states: np.ndarray) -> np.ndarray:
    """Returns angle of attack, elevator and airspeed, (N, 3), of states (7, N)."""
    _, _, pitch, elevator, xdot, zdot, _ = states
    alpha = np.arctan2(-zdot, xdot) - pitch
    return np.column_stack([alpha, elevator, np.hypot(xdot, zdot)])


def step_on(residual: Residual, states: np.ndarray, inputs: np.ndarray) -> np.ndarray:
    """Returns states (7, N) an Euler step later, under elevator rates (N,)."""
    slopes = rates_of(PLATE, states, inputs)
    values = variables_of(states)[:, : len(residual.widths)]
    psi = features(values, residual.centers, residual.widths)
    slopes[4:7] += accelerations_of(states, psi @ residual.weights)
    return states + STEP * slopes


def step_one(residual: Residual, state: np.ndarray, command: float) -> np.ndarray:
    """Returns one state (7,) an Euler step later, under an elevator rate."""
    states = state[:, None]
    inputs = np.array([command])
    return step_on(residual, states, inputs)[:, 0]


# ----------------------------------------------------------------------------- iLQR


class Maneuver(NamedTuple):
    """A nominal flight and its local feedback."""

    states: np.ndarray  #: (N + 1, 7) x̄
    inputs: np.ndarray  #: (N,) ū [rad/s]
    gains: np.ndarray  #: (N, 7) K


def terminal_cost(state: np.ndarray) -> float:
    """Returns ½ (x - goal)ᵀ Q_f (x - goal)."""
    error = state - GOAL
    return 0.5 * float(error @ FINAL @ error)


def linearize(residual: Residual, states: np.ndarray, inputs: np.ndarray):
    """Returns A (N, 7, 7) and B (N, 7) of the steps along a flight, by differences."""
    size = 1e-5
    slopes = []
    points = np.vstack([states[:-1].T, inputs])
    for k in range(8):
        aside = np.zeros((8, 1))
        aside[k] = size
        up = points + aside
        down = points - aside
        above = step_on(residual, up[:7], up[7])
        below = step_on(residual, down[:7], down[7])
        slopes.append((above - below) / (2.0 * size))
    jacobian = np.array(slopes)  # (8, 7, N)
    A = np.transpose(jacobian[:7], (2, 1, 0))
    B = np.transpose(jacobian[7])
    return A, B


def backward(
    residual: Residual, states: np.ndarray, inputs: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Returns the feed-forward (N,) and the gains (N, 7) that improve on a flight.

    Dynamic programming backward from the goal; the stage cost, half of 0.1 |x - x̄|² and
    of 0.1 (u - ū)², holds an iteration to the one before.
    """
    all_A, all_B = linearize(residual, states, inputs)
    feed = np.empty(STEPS)
    gains = np.empty((STEPS, 7))
    # Cost-to-go ½ x̃ᵀ V x̃ + sᵀ x̃ about the flight.
    V = FINAL
    s = FINAL @ (states[-1] - GOAL)
    for k in reversed(range(STEPS)):
        A = all_A[k]
        B = all_B[k]
        stiffness = HOLD_INPUT + B @ V @ B
        gains[k] = -(B @ V @ A) / stiffness
        feed[k] = -(B @ s) / stiffness
        closed = A + np.outer(B, gains[k])
        s = closed.T @ s
        V = HOLD_STATE + A.T @ V @ closed
        V = 0.5 * (V + V.T)
    return feed, gains


def forward(
    residual: Residual,
    nominal: tuple[np.ndarray, np.ndarray],
    policy: tuple[np.ndarray, np.ndarray],
) -> tuple[np.ndarray, np.ndarray]:
    """Flies ū + share feed + K (x - x̄) with each share; returns the cheapest flight."""
    states, inputs = nominal
    feed, gains = policy
    now = np.repeat(states[:1].T, len(SHARES), axis=1)
    flown = [now]
    given = []
    for k in range(STEPS):
        error = now - states[k, :, None]
        u = inputs[k] + SHARES * feed[k] + gains[k] @ error
        now = step_on(residual, now, u)
        flown.append(now)
        given.append(u)
    costs = [terminal_cost(end) for end in now.T]
    best = int(np.nanargmin(costs))
    better = np.array(flown)[:, :, best]
    commands = np.array(given)[:, best]
    return better, commands


def ilqr(residual: Residual, launch: np.ndarray, guess: np.ndarray) -> Maneuver:
    """Plans from a launch, starting from commands (N,), until nothing is gained."""
    flown = [launch]
    for u in guess:
        flown.append(step_one(residual, flown[-1], u))
    states = np.array(flown)
    inputs = guess
    while True:
        feed, gains = backward(residual, states, inputs)
        better, commands = forward(residual, (states, inputs), (feed, gains))
        gain = terminal_cost(states[-1]) - terminal_cost(better[-1])
        if gain < 1e-3:
            return Maneuver(states, inputs, gains)
        states = better
        inputs = commands


# ------------------------------------------------------------------------- the loop


def execute(
    truth: Residual, maneuver: Maneuver, launch: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Flies the true glider along a maneuver; returns states and inputs."""
    states = [launch]
    inputs = []
    for k, nominal in enumerate(maneuver.inputs):
        error = states[-1] - maneuver.states[k]
        u = nominal + maneuver.gains[k] @ error
        inputs.append(u)
        states.append(step_one(truth, states[-1], u))
    return np.array(states), np.array(inputs)


def equations_of(states: np.ndarray, inputs: np.ndarray, grid: Residual):
    """Returns ΦᵀΦ (78, 78) and Φᵀy (78,) of the weights, from one measured flight."""
    now = states[:-1].T
    values = variables_of(now)[:, :2]
    psi = features(values, grid.centers, grid.widths)
    columns = []
    for unit in np.eye(3):  # Of C_L, C_D, C_M, one everywhere.
        everywhere = np.tile(unit, (len(inputs), 1))
        pushed = accelerations_of(now, everywhere)
        columns.append(pushed[:, :, None] * psi)
    G = np.concatenate(columns, axis=2)  # (3, N, 78)
    plate = rates_of(PLATE, now, inputs)[4:7]
    measured = np.diff(states[:, 4:], axis=0).T / STEP
    target = np.ravel(measured - plate)
    phi = G.reshape(len(target), -1)
    return phi.T @ phi, phi.T @ target


class Round(NamedTuple):
    """One turn of the loop."""

    flight: np.ndarray  #: (N + 1, 7) executed, from a launch of another speed.
    nominal: np.ndarray  #: The same from the planned launch; nothing learns from it.
    change: float  #: ‖w_j+1 - w_j‖ behind it.


def learn(
    truth: Residual,
    rounds: int,
    rng: np.random.Generator,
    say: Callable[[str], None] = print,
) -> list[Round]:
    """Runs the loop.

    Args:
        truth: what flies.
        rounds: their number.
        rng: of the launch speeds and of the noise.
        say: called with a line of text on each round.
    """
    believed = gaussian_grid()
    information = RIDGE * np.eye(3 * len(believed.weights))
    target = np.zeros(len(information))
    guess = np.zeros(STEPS)
    done = []
    for k in range(rounds):
        maneuver = ilqr(believed, LAUNCH, guess)
        launch = LAUNCH.copy()
        launch[4] = rng.uniform(*SPEEDS)
        states, inputs = execute(truth, maneuver, launch)
        noise = STATE_NOISE * rng.normal(size=states.shape)
        more, aims = equations_of(states + noise, inputs, believed)
        information = information + more
        target = target + aims
        solved = np.linalg.solve(information, target).reshape(3, -1).T
        change = float(np.linalg.norm(solved - believed.weights))
        believed = believed._replace(weights=solved)
        guess = maneuver.inputs
        nominal, _ = execute(truth, maneuver, LAUNCH)
        done.append(Round(states, nominal, change))
        cost = terminal_cost(states[-1])
        planned_cost = terminal_cost(nominal[-1])
        say(f"round {k}: terminal cost {cost:.2f}; at 7 m/s {planned_cost:.2f}")
    return done


def true_residual() -> Residual:
    """Returns the simulator's residual, 126 weights a coefficient."""
    [function] = TRUTH.free_functions
    weights = np.array([function.weights[name] for name in COEFFICIENTS]).T
    return Residual(np.array(function.centers), np.array(function.widths), weights)


def main(arguments: Sequence[str] | None = None) -> dict[str, str]:
    """Runs the loop and shows how it goes."""
    path = read_options(__doc__, arguments)
    truth = true_residual()
    rounds = learn(truth, ROUNDS, np.random.default_rng(0))
    costs = [terminal_cost(own.flight[-1]) for own in rounds]
    nominal = [terminal_cost(own.nominal[-1]) for own in rounds]
    misses = [1000 * miss_of(own.nominal) for own in rounds]
    if path:
        draw(path, rounds)
    return compare(
        ARTICLE,
        SHOWN,
        SHOWN,
        SHOWN,
        f"{len(gaussian_grid().weights)}, {len(truth.weights)}",
        first_and_last(costs),
        first_and_last(nominal),
        f"{rounds[0].change:.1f}, {rounds[-1].change:.1f}",
        first_and_last(misses) + " mm",
    )


def miss_of(states: np.ndarray) -> float:
    """Returns the least distance from the wire, between the states too [m]."""
    share = np.linspace(0.0, 1.0, 20)[:, None, None]
    between = (1.0 - share) * states[:-1, :2] + share * states[1:, :2]
    return float(np.min(np.linalg.norm(between, axis=-1)))


def first_and_last(values: list[float]) -> str:
    """Returns the first value and the median of the last five, as words."""
    last = np.median(values[-5:])
    return f"{values[0]:.1f}, {last:.1f}"


def draw(path: Path, rounds: list[Round]) -> None:
    """Draws the executed flights, their costs and the changes of the weights."""
    with picture(path, 9.0, 5.4) as figure:
        panels = figure.subplot_mosaic("AA;BC", height_ratios=[1.1, 1])
        flown, cost, change = panels.values()
        shades = colormaps["viridis_r"](np.linspace(0.1, 1.0, len(rounds)))
        for k, (own, shade) in enumerate(zip(rounds, shades, strict=True)):
            label = f"round {k}" if k in (0, len(rounds) - 1) else None
            flown.plot(*own.flight[:, :2].T, color=shade, lw=1.2, label=label)
        draw_wire(flown)
        flown.set_aspect("equal", adjustable="datalim")
        legend_beside(flown)
        executed = [terminal_cost(own.flight[-1]) for own in rounds]
        nominal = [terminal_cost(own.nominal[-1]) for own in rounds]
        cost.plot(executed, "o-", color=RED, ms=3, label="executed")
        cost.plot(nominal, "o-", color=BLUE, ms=3, label="from the planned launch")
        cost.set(xlabel="round", ylabel="terminal cost", yscale="log")
        cost.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2)
        change.plot([own.change for own in rounds], "o-", color=BLUE, ms=3)
        change.set(xlabel="round", ylabel="change of the weights", yscale="log")


if __name__ == "__main__":
    start(main)
