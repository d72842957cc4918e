"""Lesson 6: defend the plan by finite-horizon LQR.

The article's section "Planning the maneuver", step 4. About the plan x₀(t), u₀(t) the
dynamics are linear, x̃˙ = A(t) x̃ + B(t) ũ, and the feedback

    u = u₀(t) - K(t) (x - x₀(t)),   K = R⁻¹ Bᵀ S,   -Ṡ = AᵀS + SA - S B R⁻¹ Bᵀ S + Q

minimizes ∫ (x̃ᵀ Q x̃ + R ũ²) dt + x̃(T)ᵀ Q_f x̃(T). Drake integrates S backward from
S(T) = Q_f. Launches 4 cm (one standard deviation) off in height are flown with the
feedback and without. A flight perches if a hook can take it at the wire: within 5 cm,
not too fast, nose up.

Where we differ: from these launches the plan alone perches as well, for the glider is
the planned one. So launches follow with three times the usual standard deviations
of this library (12 cm in height, 0.3 m/s in speed, 3.4° in pitch): there feedback is
worth it. In a
head wind that the plan does not know it makes the miss smaller, and still no flight
perches.

    python examples/article/tracking_lqr.py --figure tracking_lqr.png
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from pydrake.systems.controllers import (
    FiniteHorizonLinearQuadraticRegulator,
    FiniteHorizonLinearQuadraticRegulatorOptions,
    MakeFiniteHorizonLinearQuadraticRegulator,
)

from course import (
    SHOWN,
    compare,
    draw_wire,
    legend_beside,
    picture,
    read_options,
    start,
)
from diagrams import closed_loop, open_loop, simulate_flights
from glider import (
    GliderModel,
    GliderPlant,
    Perches,
    PerchingProblem,
    Plan,
    effects,
    plan,
)
from glider.report.plots.style import BLUE, RED

ARTICLE = {
    "Closed-loop flights from jittered heights": SHOWN,
    "Launches that perch with feedback, and without": "-",
    "Median miss with feedback, and without": "-",
    "Gain K of z at the launch and 0.1 s before the wire": "-",
    "Worse launches that perch with feedback, and without": "-",
    "Median miss of these": "-",
    "In a head wind of 0.6 m/s: that perch": "-",
    "Median miss in it": "-",
}

Q = np.diag([10.0, 10.0, 10.0, 1.0, 1.0, 1.0, 1.0])
R = np.array([[0.1]])
FINAL_Q = np.diag([400.0, 400.0, 1 / 9, 1 / 9, 1.0, 1.0, 1 / 9])
LAUNCHES = 20
HEIGHT_STD = 0.04  # [m]
SCALE = 3.0
"""How much worse than usual the worse launches are."""

AFTER = 0.1
"""Time that a flight goes on after the plan's end [s]: it may pass the wire late."""


def riccati_arguments(model: GliderModel, planned: Plan) -> dict[str, object]:
    """Returns what Drake wants to know of a finite-horizon LQR along a plan."""
    plant = GliderPlant(model)
    options = FiniteHorizonLinearQuadraticRegulatorOptions()
    options.Qf = FINAL_Q
    options.x0 = planned.state_trajectory
    options.u0 = planned.input_trajectory
    options.input_port_index = plant.GetInputPort("elevator_rate").get_index()
    return {
        "system": plant,
        "context": plant.CreateDefaultContext(),
        "t0": 0.0,
        "tf": planned.duration,
        "Q": Q,
        "R": R,
        "options": options,
    }


def fly(
    truth: GliderModel, model: GliderModel, planned: Plan, starts: np.ndarray
) -> tuple[Perches, Perches]:
    """Flies launches of a glider with the feedback of a model, and without."""
    arguments = riccati_arguments(model, planned)
    regulator = MakeFiniteHorizonLinearQuadraticRegulator(**arguments)
    duration = planned.duration + AFTER
    return (
        simulate_flights(closed_loop(truth, regulator), starts, duration),
        simulate_flights(open_loop(truth, planned), starts, duration),
    )


def main(arguments: Sequence[str] | None = None) -> dict[str, str]:
    """Plans, computes the feedback and flies the launches."""
    path = read_options(__doc__, arguments)
    model, problem = GliderModel(), PerchingProblem()
    windy = GliderModel(effects=[effects.WIND(x=-0.6)])
    planned = plan(model, problem)
    rng = np.random.default_rng(0)
    jittered = np.tile(problem.launch, (LAUNCHES, 1))
    jittered[:, 1] += rng.normal(0.0, HEIGHT_STD, LAUNCHES)
    worse = problem.draw_launches(LAUNCHES, rng, scale=SCALE)

    gains = FiniteHorizonLinearQuadraticRegulator(**riccati_arguments(model, planned)).K
    first, last = (gains.value(t)[0, 1] for t in (0.0, planned.duration - 0.1))
    flown = {
        "jittered heights": fly(model, model, planned, jittered),
        "worse launches": fly(model, model, planned, worse),
        "jittered heights, in a head wind": fly(windy, model, planned, jittered),
    }
    near, far, blown = ((perches_of(own), misses_of(own)) for own in flown.values())
    if path:
        draw(path, planned, flown)
    gain = f"{first:.1f} and {last:.1f}"
    return compare(ARTICLE, SHOWN, *near, gain, *far, *blown)


def perches_of(flown: tuple[Perches, Perches]) -> str:
    """Counts the flights that perch, with feedback and without."""
    guided, blind = (int(np.sum(flights.perched)) for flights in flown)
    return f"{guided} and {blind} of {LAUNCHES}"


def misses_of(flown: tuple[Perches, Perches]) -> str:
    """Returns the median misses, with feedback and without."""
    guided, blind = (1000 * np.median(flights.misses) for flights in flown)
    return f"{guided:.1f} and {blind:.1f} mm"


def draw(path: Path, planned: Plan, flown: dict[str, tuple[Perches, Perches]]) -> None:
    """Draws the flights with feedback and without."""
    with picture(path, 9.0, 6.6) as figure:
        panels = figure.subplots(3, 1)
        for ax, (title, (guided, blind)) in zip(panels, flown.items(), strict=True):
            for flights, word, color in (
                (blind, "without feedback", RED),
                (guided, "with feedback", BLUE),
            ):
                for k, flight in enumerate(flights):
                    label = word if k == 0 else None
                    ax.plot(*flight.states[:, :2].T, color=color, lw=0.7, label=label)
            ax.plot(*planned.states[:, :2].T, color="k", ls="--", label="plan")
            draw_wire(ax)
            ax.set_title(title, loc="left")
            ax.set_aspect("equal", adjustable="datalim")
            legend_beside(ax)


if __name__ == "__main__":
    start(main)
