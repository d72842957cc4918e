"""Lesson 2: refine the model until whole flights fit, not only accelerations.

The end of the article's section "Model structure". Least squares scores accelerations
at states that were seen; a simulation goes on from its own states, so that small errors
grow. What counts is

    J_sim(β) = Σ_k ‖x_sim,k(β) - x_data,k‖²_Q

with Q = diag(1/SCALES²). The article names backpropagation through time and real-time
recurrent learning. Here, as in the second, the sensitivities ∂x_k/∂β are carried
forward with the states: they are the imaginary parts of complex steps, which are exact.
Least squares in a trust region uses them, starting from the coefficients of lesson 1.
Flight 0 is in no fit. With the published signs its error grows: J_sim weighs pitch and
rates too, which a model of the wrong form can only trade against the position.

    python examples/article/basis_refinement.py --figure basis_refinement.png
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from basis_model import (
    CONFIGURATIONS,
    CONSISTENT,
    PUBLISHED,
    STEP,
    BasisModel,
    best_choice,
    fit,
    fly_exercise,
    rollout,
)
from course import SHOWN, compare, legend_beside, picture, read_options, start
from glider.report.plots.style import BLUE, GREEN, ORANGE, RED

ARTICLE = {
    "Held-out flight, least squares and refined": "described",
    "Configuration 6: error of the held-out flight": "-",
    "Configuration 6 with the published signs": "-",
    "Best one feature for each acceleration": "-",
    "Best two features": "-",
    "Best three features": "-",
}

SCALES = np.array([0.1, 0.1, 0.1, np.inf, 0.5, 0.5, 1.0])
"""Errors of the states that weigh the same [m, rad, m/s, rad/s]. The elevator's angle
is only integrated from the given rates, so that it is not scored."""

TINY = 1e-30
"""Length of a complex step."""


def refine(model: BasisModel, states: np.ndarray, rates: np.ndarray) -> BasisModel:
    """Returns the model with the coefficients that minimize J_sim over some flights.

    Args:
        model: where to start.
        states: (B, N + 1, 7) to fit.
        rates: (B, N) [rad/s].
    """
    size = np.abs(model.coefficients)
    launches = states[:, 0]

    def errors(share: np.ndarray) -> np.ndarray:
        flown = rollout(model, launches, rates, size * share)
        return ((flown - states) / SCALES).ravel()

    def slopes(share: np.ndarray) -> np.ndarray:
        # One rollout for each coefficient, all at once: (m, 1, m) against (B, 7).
        moved = size * (share + 1j * TINY * np.eye(len(share)))
        starts = np.broadcast_to(launches, (len(share), *launches.shape))
        flown = rollout(model, starts, rates, moved[:, None, :])
        return (flown.imag / TINY / SCALES).reshape(len(share), -1).T

    share = model.coefficients / size
    found = least_squares(errors, share, jac=slopes, x_scale="jac", max_nfev=50)
    return model._replace(coefficients=size * found.x)


def position_error(model: BasisModel, states: np.ndarray, rates: np.ndarray) -> float:
    """Returns the RMS distance of a model's flight from the one that was flown [m]."""
    apart = rollout(model, states[0], rates)[:, :2] - states[:, :2]
    return float(np.sqrt(np.mean(np.sum(apart**2, axis=1))))


def main(arguments: Sequence[str] | None = None) -> dict[str, str]:
    """Fits and refines some models, and flies the held-out flight with each."""
    path = read_options(__doc__, arguments)
    states, rates = fly_exercise()
    fitted, held_out = (states[1:], rates[1:]), (states[0], rates[0])
    choices = {
        "configuration 6": (CONFIGURATIONS[6], CONSISTENT),
        "configuration 6, published signs": (CONFIGURATIONS[6], PUBLISHED),
        "best one": (best_choice(*fitted, 1), CONSISTENT),
        "best two": (best_choice(*fitted, 2), CONSISTENT),
        "best three": (best_choice(*fitted, 3), CONSISTENT),
    }
    pairs = {}
    for name, (choice, sign) in choices.items():
        model, _ = fit(*fitted, choice, sign)
        pairs[name] = model, refine(model, *fitted)
    errors = []
    for before, after in pairs.values():
        first, last = (1000 * position_error(m, *held_out) for m in (before, after))
        errors.append(f"{first:.2f} mm, refined {last:.2f} mm")
    if path:
        draw(path, *held_out, pairs)
    return compare(ARTICLE, SHOWN, *errors)


def draw(
    path: Path,
    states: np.ndarray,
    rates: np.ndarray,
    pairs: dict[str, tuple[BasisModel, BasisModel]],
) -> None:
    """Draws how far each model is from the held-out flight, before and after."""
    times = STEP * np.arange(3, len(states))  # The first steps are given.
    with picture(path, 9.0, 4.0) as figure:
        ax = figure.subplots()
        for (name, pair), color in zip(
            pairs.items(), (BLUE, RED, ORANGE, GREEN, "k"), strict=True
        ):
            for model, dashes in zip(pair, ("--", "-"), strict=True):
                apart = rollout(model, states[0], rates)[3:, :2] - states[3:, :2]
                distance = 1000 * np.linalg.norm(apart, axis=1)
                label = name if dashes == "-" else None
                ax.plot(times, distance, color=color, ls=dashes, label=label)
        ax.set(xlabel="time [s]", ylabel="distance from flight 0 [mm]", yscale="log")
        ax.set_title("dashed: least squares; solid: refined", loc="left")
        legend_beside(ax)


if __name__ == "__main__":
    start(main)
