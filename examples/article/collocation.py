"""Lesson 5: plan a perch by direct collocation, and replay it without feedback.

The article's section "Planning the maneuver", its steps 1 to 3. States and inputs at
the knots are the unknowns of one program,

    min  ∫ 100 u² dt + (x(T) - x_g)ᵀ Q_f (x(T) - x_g),   ẋ = f(x, u) at the collocation
         points, x(0) the launch, x(T) at the wire, limits of state, elevator and servo,
         and of pitch and speed at T; T is free.

Nothing says when to pitch up. It is solved on 25 knots, and from there on 41. Then the
commands are replayed: by Drake's integrator from the planned launch, and in other ways.

Where we differ: the notebook's plan costs 222.39. Its plant computes forces with the
sine of the pitch rate, by a view of its state that it writes into; no glider flies that
plan. With that put right, its elevator limits, which are for angles that count nose
up beside a pitch that counts nose down, leave no solution; with limits in the pitch's
sign the plan costs 194.05. And replayed as planned, it
hardly drifts: 41 knots are a fine mesh for 0.9 s. Commands held for 20 ms, Euler steps
of 10 ms, a launch or a wind that is not as planned make it drift by 3 to 46 cm: that is
what feedback is for.

    python examples/article/collocation.py --figure collocation.png
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from pydrake.planning import DirectCollocation
from pydrake.solvers import SnoptSolver
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from course import (
    SHOWN,
    compare,
    draw_attitudes,
    draw_wire,
    legend_beside,
    picture,
    read_options,
    start,
)
from glider import GliderModel, GliderPlant, PerchingProblem, plan
from glider.report.plots.style import BLUE, COLORS, GREEN, ORANGE, RED

ARTICLE = {
    "A planned perch on 25, then 41 knots": SHOWN,
    "Its cost on 25 and on 41 knots": "- and 222.39 (fault 1)",
    "The same by glider.plan": "-",
    "Duration of the plan": "-",
    "Open-loop replay drifts away": SHOWN,
    "Distance from the wire at T, replayed as planned": "-",
    "The same, commands held for 20 ms": "-",
    "The same by Euler steps of 10 ms": "-",
    "The same, launched 0.1 m/s too fast": "-",
    "The same in a head wind of 0.6 m/s": "-",
}

GLIDER = GliderModel()
LAUNCH = np.array([-3.5, 0.1, 0.0, 0.0, 7.0, 0.0, 0.0])
GOAL = np.array([0.0, 0.0, -np.pi / 4, 0.0, 0.0, 0.0, 0.0])
GOAL_WEIGHTS = np.diag([10.0, 10.0, 1.0, 10.0, 1.0, 1.0, 1.0])
RATE_COST = 100.0
GUESSED_SECONDS = 0.8

Planned = tuple[PiecewisePolynomial, PiecewisePolynomial]
"""State and elevator rate over time."""


def straight_line() -> Planned:
    """Returns the first guess: from the launch to the wire, elevator at rest."""
    times = [0.0, GUESSED_SECONDS]
    states = PiecewisePolynomial.FirstOrderHold(times, np.array([LAUNCH, GOAL]).T)
    return states, PiecewisePolynomial.FirstOrderHold(times, np.zeros((1, 2)))


def solve(knots: int, guess: Planned) -> tuple[Planned, float]:
    """Solves the program on some knots; returns the plan and its cost."""
    plant = GliderPlant(GLIDER)
    rate_port = plant.GetInputPort("elevator_rate").get_index()
    shortest, longest = 0.5 / knots, 2.0 / knots
    dc = DirectCollocation(
        plant, plant.CreateDefaultContext(), knots, shortest, longest, rate_port
    )
    prog = dc.prog()
    dc.AddEqualTimeIntervalsConstraints()

    x, z, pitch, elevator, *_ = dc.state()
    u = dc.input()[0]
    down, up = GLIDER.parameters.elevator_limits
    fastest = GLIDER.parameters.elevator_rate_limit
    for variable, low, high in (
        (x, -3.5, 1.0),
        (z, -1.0, 1.0),
        (pitch, -np.pi / 2, np.pi / 2),
        (elevator, down, up),
        (u, -fastest, fastest),
    ):
        dc.AddConstraintToAllKnotPoints(variable >= low)
        dc.AddConstraintToAllKnotPoints(variable <= high)

    prog.AddBoundingBoxConstraint(LAUNCH, LAUNCH, dc.initial_state())
    last = dc.final_state()
    prog.AddBoundingBoxConstraint(0.0, 0.0, last[:2])
    prog.AddBoundingBoxConstraint(-1.0, -np.pi / 6, last[2])
    prog.AddBoundingBoxConstraint(-2.0, 2.0, last[4:6])

    dc.AddRunningCost(RATE_COST * u**2)
    prog.AddQuadraticErrorCost(GOAL_WEIGHTS, GOAL, last)
    states, inputs = guess
    dc.SetInitialTrajectory(inputs, states)
    result = SnoptSolver().Solve(prog)
    if not result.is_success():
        raise RuntimeError(f"No plan on {knots} knots: {result.get_solution_result()}")
    found = dc.ReconstructStateTrajectory(result), dc.ReconstructInputTrajectory(result)
    return found, result.get_optimal_cost()


def plan_perch() -> tuple[Planned, tuple[float, float]]:
    """Solves on 25 knots, and from there on 41; returns the plan and both costs."""
    coarse, first_cost = solve(25, straight_line())
    fine, cost = solve(41, coarse)
    return fine, (first_cost, cost)


# ------------------------------------------------------------------------- the replay


def replay(
    planned: Planned,
    start: np.ndarray = LAUNCH,
    wind: tuple[float, float] = (0.0, 0.0),
    hold: float | None = None,
    euler: float | None = None,
) -> np.ndarray:
    """Flies the commands of a plan without feedback, for its duration.

    Args:
        planned: whose commands to give.
        start: launch state (7,).
        wind: (x, z) [m/s].
        hold: for how long each command is held [s]; None: they change all the time.
        euler: step of explicit Euler [s]; None: Runge-Kutta of order 5 with error
            control.

    Returns:
        states (K, 7) of the flight.
    """
    _, commands = planned
    if hold is not None:
        times = np.arange(0.0, commands.end_time() + hold, hold)
        held = commands.vector_values(np.minimum(times, commands.end_time()))
        commands = PiecewisePolynomial.ZeroOrderHold(times, held)
    builder = DiagramBuilder()
    glider = builder.AddSystem(GliderPlant(GLIDER))
    source = builder.AddSystem(TrajectorySource(commands))
    builder.Connect(source.get_output_port(), glider.GetInputPort("elevator_rate"))
    log = LogVectorOutput(glider.GetOutputPort("state"), builder)
    simulator = Simulator(builder.Build())
    config = SimulatorConfig(integration_scheme="runge_kutta5", accuracy=1e-8)
    if euler is not None:
        config = SimulatorConfig(
            integration_scheme="explicit_euler",
            max_step_size=euler,
            use_error_control=False,
        )
    ApplySimulatorConfig(config, simulator)
    context = simulator.get_mutable_context()
    context.SetContinuousState(start)
    own = glider.GetMyMutableContextFromRoot(context)
    glider.GetInputPort("wind").FixValue(own, wind)
    simulator.AdvanceTo(planned[1].end_time())
    return log.FindLog(context).data().T


def miss_of(flight: np.ndarray) -> float:
    """Returns how far from the wire a flight is when the plan ends [m]."""
    return float(np.hypot(*flight[-1, :2]))


def main(arguments: Sequence[str] | None = None) -> dict[str, str]:
    """Plans, and replays the plan in different ways."""
    path = read_options(__doc__, arguments)
    planned, costs = plan_perch()
    ours = plan(GLIDER, PerchingProblem())
    faster = LAUNCH + np.array([0.0, 0.0, 0.0, 0.0, 0.1, 0.0, 0.0])
    flights = {
        "as planned": replay(planned),
        "commands held for 20 ms": replay(planned, hold=0.02),
        "Euler steps of 10 ms": replay(planned, euler=0.01),
        "launched 0.1 m/s too fast": replay(planned, start=faster),
        "head wind of 0.6 m/s": replay(planned, wind=(-0.6, 0.0)),
    }
    if path:
        draw(path, planned, flights)
    return compare(
        ARTICLE,
        SHOWN,
        f"{costs[0]:.2f} and {costs[1]:.2f}",
        f"{ours.cost:.4f}",
        f"{planned[0].end_time():.4f} s",
        SHOWN,
        *(f"{1000 * miss_of(flight):.2f} mm" for flight in flights.values()),
    )


def draw(path: Path, planned: Planned, flights: dict[str, np.ndarray]) -> None:
    """Draws the plan, the replays, and how the elevator moves."""
    states, _ = planned
    times = np.linspace(0.0, states.end_time(), 200)
    along = states.vector_values(times).T
    with picture(path, 9.0, 5.0) as figure:
        top, bottom = figure.subplots(2, 1, height_ratios=[1, 1])
        draw_attitudes(top, along, every=12)
        colors = (COLORS["nominal"], GREEN, ORANGE, BLUE, RED)
        for (name, flight), color in zip(flights.items(), colors, strict=True):
            label = f"{name}: {1000 * miss_of(flight):.1f} mm"
            top.plot(*flight[:, :2].T, color=color, label=label)
        draw_wire(top)
        top.set_aspect("equal", adjustable="datalim")
        top.set_title("plan, with the glider's attitude, and replays", loc="left")
        legend_beside(top)
        bottom.plot(
            times, np.degrees(along[:, 2]), color="k", label="pitch, nose down > 0"
        )
        bottom.plot(
            times, np.degrees(along[:, 3]), color=BLUE, label="elevator, up > 0"
        )
        bottom.set(xlabel="time [s]", ylabel="angle [°]")
        legend_beside(bottom)


if __name__ == "__main__":
    start(main)
