"""The loop of learning: plan, execute, identify, plan again.

    plan -> execute with feedback -> log -> identify the model -> plan ...

What identifies is a function from the nominal model and the flights so far to a model:
the article's ridge regression for 26 weights a coefficient, or the tracer of
`glider.sysid`. The glider that flies has an effect that its nominal model lacks.
"""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from threadpoolctl import threadpool_limits

from coefficients import RIDGE, residual_basis, with_weights
from flight_weights import solve_weights, weight_equations
from glider.campaign.logs import Flight, campaign_of
from glider.campaign.motion_capture import MotionCapture
from glider.errors import InputError
from glider.physics.effects.free_functions import COEFFICIENTS
from glider.physics.model import GliderModel
from glider.physics.state import NUM_STATES, STATE_NAMES
from glider.planning.plan import Plan
from glider.planning.problem import PerchingProblem
from glider.simulation.flown_flights import Flights, FlownFlight
from glider.simulation.fly import fly
from glider.sysid.pipeline import close_the_loop
from held_policy import HeldPolicy
from ilqr import ARTICLE, DivergedError, IlqrSettings, goal_cost, goal_problem, ilqr

SPEEDS = (6.5, 7.5)
"""Bounds between which the launch speed is drawn [m/s]."""

STATE_NOISE = 0.01
"""Standard deviation of the states that are differenced, in SI units and radians."""

TEST_SPEEDS = (6.6, 6.8, 7.0, 7.2, 7.4)
"""Speeds of the launches that a model is judged by, the same for all [m/s]."""

LEAST_FLIGHTS = 3
"""Number of flights that the tracer needs: two to fit and one to judge by."""

RATE_COST = 0.5
"""Cost of the commands in `learning_problem` [1/(rad²/s)]."""

CAPTURE = MotionCapture()
"""Motion capture that films the flights."""

_SPEED = STATE_NAMES.index("xdot")

Progress = Callable[[str], None]


@dataclasses.dataclass(frozen=True, kw_only=True)
class LoggedFlight:
    """Log of an executed flight: all that is known of it."""

    states: np.ndarray
    """(N + 1, 7) with noise, when the commands begin and when the last ends."""

    rates: np.ndarray
    """(N,) elevator-rate commands, within the rate limit [rad/s]."""

    step: float
    """Time that each command is held [s]."""

    capture: Flight
    """Log of motion capture."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class IdentifiedModel:
    """A model made of flights, and in words what it adds to the nominal one."""

    model: GliderModel
    effects: tuple[str, ...] = ()


Identify = Callable[[GliderModel, Sequence[LoggedFlight]], IdentifiedModel]
"""Function from the nominal model and all flights so far to a model."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Round:
    """One turn of the loop."""

    identified: IdentifiedModel
    """Model that was planned with, of the flights before this round."""

    plan: Plan
    """Plan of the first flight."""

    flights: list[FlownFlight]
    """Flights of the true glider."""

    terminal_cost: float
    """Cost of the first flight at the plan's end."""

    miss: float
    """Median over TEST_SPEEDS of flights planned with the same model [m]."""


def learning_problem() -> PerchingProblem:
    """Returns the article's problem with a small cost of the commands themselves.

    The article weighs only how they change from one plan to the next, so that its
    plan depends on where it was begun and ended: plans of one model, the true one, then
    miss by 10 to 21 mm. RATE_COST makes them one.
    """
    return goal_problem(RATE_COST)


def learning_settings(order: int = 4) -> IlqrSettings:
    """Returns the article's settings with steps of an order.

    The article's simulator takes the planner's Euler steps; the glider that flies here
    does not, so that 1 leaves every model with an error that only the weights can
    learn.
    """
    return dataclasses.replace(ARTICLE, order=order)


@threadpool_limits.wrap(limits=1, user_api="blas")  # Small matrices.
def learn(
    truth: GliderModel,
    identify: Identify,
    rounds: int,
    rng: np.random.Generator,
    *,
    launches: int = LEAST_FLIGHTS,
    problem: PerchingProblem | None = None,
    settings: IlqrSettings | None = None,
    progress: Progress | None = None,
) -> list[Round]:
    """Runs the loop: each round plans, flies, and identifies from all flights so far.

    A flight is planned from its own launch, whose speed is drawn and measured, and
    iLQR starts from the plan before. The same generator state draws the same launches
    and noise whatever identifies.

    Args:
        truth: the glider that flies. Its parameters are known, its effects are not.
        identify: what makes a model of flights.
        rounds: their number; the last one is not learned from.
        rng: draws launch speeds and noise.
        launches: flights in a round.
        problem: what to fly; None for `learning_problem`.
        settings: of the planner; None for `learning_settings`.
        progress: called with a line of text as the work goes on.

    Raises:
        InputError: a number that cannot be, or a flight that cannot be logged.
    """
    if rounds < 1 or launches < 1:
        raise InputError(
            f"learn: {rounds} rounds of {launches} launches; expected one of each."
        )
    problem = learning_problem() if problem is None else problem
    settings = learning_settings() if settings is None else settings
    say = progress or (lambda text: None)
    nominal = GliderModel(parameters=truth.parameters)
    identified = IdentifiedModel(model=nominal)
    planned = ilqr(nominal, problem, settings)
    logs: list[LoggedFlight] = []
    results: list[Round] = []
    for k in range(rounds):
        say(f"round {k + 1} of {rounds}: plan and fly")
        model, plans, flights, knots = identified.model, [], [], []
        for _ in range(launches):
            launch = launched(problem, rng.uniform(*SPEEDS))
            planned = plan_again(model, launch, settings, planned)
            flown = fly_planned(truth, planned, launch)
            plans.append(planned)
            flights.append(flown.flight(0))
            knots.append(knots_of(flown, planned))
            name = f"flight_{len(logs):03d}.csv"
            logs.append(log(truth, flown, planned, rng, name))
        results.append(
            Round(
                identified=identified,
                plan=plans[0],
                flights=flights,
                terminal_cost=float(goal_cost(problem, knots[0][-1])),
                miss=median_miss(truth, model, problem, settings, plans[0]),
            )
        )
        if k + 1 < rounds:
            say(f"round {k + 1} of {rounds}: identify")
            identified = identify(nominal, logs)
    return results


def launched(problem: PerchingProblem, speed: float) -> PerchingProblem:
    """Returns the problem from a launch at another speed [m/s]."""
    launch = list(problem.launch)
    launch[_SPEED] = float(speed)
    return dataclasses.replace(problem, launch=launch)


def plan_again(
    model: GliderModel, problem: PerchingProblem, settings: IlqrSettings, before: Plan
) -> Plan:
    """Plans with a model from the commands of a plan before.

    Where they make the model diverge, which a poor one may, the plan before stands.
    """
    try:
        return ilqr(model, problem, settings, guess=before.inputs)
    except DivergedError:
        return before


def fly_planned(truth: GliderModel, planned: Plan, problem: PerchingProblem) -> Flights:
    """Flies a problem's launch under a plan with held commands and its feedback.

    Args:
        truth: the glider that is flown, which may have effects that the planner does
            not know.
        planned: the flight and its feedback.
        problem: whose launch, wire and hook to take.
    """
    policy = HeldPolicy(plan=planned)
    return fly(
        truth,
        policy,
        np.array([problem.launch]),
        problem=problem,
        command_rate=policy.command_rate,
        keep_paths=True,
    )


def knots_of(flown: Flights, planned: Plan) -> np.ndarray:
    """Returns the states (N + 1, n) of a flight at the plan's knots."""
    assert flown.paths is not None
    return flown.paths[0, np.searchsorted(flown.times, planned.times - 1e-9)]


def median_miss(
    truth: GliderModel,
    model: GliderModel,
    problem: PerchingProblem,
    settings: IlqrSettings,
    before: Plan,
) -> float:
    """Returns the median miss over TEST_SPEEDS of flights planned with a model [m]."""
    misses = []
    for speed in TEST_SPEEDS:
        launch = launched(problem, speed)
        planned = plan_again(model, launch, settings, before)
        misses.append(fly_planned(truth, planned, launch).miss[0])
    return float(np.median(misses))


def log(
    truth: GliderModel,
    flown: Flights,
    planned: Plan,
    rng: np.random.Generator,
    name: str,
) -> LoggedFlight:
    """Returns the log of a flight, noise included.

    Raises:
        InputError: the flight did not stay finite.
    """
    states = knots_of(flown, planned)[:, :NUM_STATES]
    noise = STATE_NOISE * rng.normal(size=states.shape)
    assert flown.paths is not None and flown.commands is not None
    assert flown.command_times is not None
    commands = flown.command_times, flown.commands[0]
    return LoggedFlight(
        states=states + noise,
        rates=commands[1][: len(planned.inputs)],
        step=float(planned.times[1]),
        capture=CAPTURE.log(truth, flown.times, flown.paths[0], commands, rng, name),
    )


def fit_weights(nominal: GliderModel, logs: Sequence[LoggedFlight]) -> IdentifiedModel:
    """Identifies as the article does: 26 weights a coefficient, by ridge regression."""
    basis = residual_basis()
    equations = [
        weight_equations(nominal, basis, log.states, log.rates, log.step)
        for log in logs
    ]
    weights = solve_weights(sum(equations[1:], equations[0]), RIDGE)
    residual = with_weights(basis, COEFFICIENTS, weights)
    model = dataclasses.replace(nominal, free_functions=(residual,))
    return IdentifiedModel(model=model, effects=(residual.kind,))


def trace_effects(
    nominal: GliderModel, logs: Sequence[LoggedFlight]
) -> IdentifiedModel:
    """Identifies by the tracer: which effect of the library, or a free function.

    It judges by flights that it has not fitted, and so keeps the nominal model until
    there are LEAST_FLIGHTS.
    """
    if len(logs) < LEAST_FLIGHTS:
        return IdentifiedModel(model=nominal)
    flights = [log.capture for log in logs]
    campaign = campaign_of(
        "learning", nominal.parameters, flights, CAPTURE.rate, 1.0 / logs[0].step
    )
    found = close_the_loop(campaign)
    return IdentifiedModel(
        model=found.model, effects=tuple(effect.kind for effect in found.effects)
    )


def knowing(truth: GliderModel) -> Identify:
    """Returns an oracle: it identifies the truth from any flights."""
    return lambda nominal, logs: IdentifiedModel(model=truth)
