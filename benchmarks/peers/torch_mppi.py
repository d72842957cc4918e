"""pytorch-mppi on the article's sampling problem, with the likelihood ratio.

Its dynamics are our compiled ones on the tensors' own memory. It weighs a sequence
by the cost of all of it, ours each command by what it costs from there on.
"""

import dataclasses

import numpy as np

from benchmarks.peers.pairs import Pair
from glider.compiled.kernel import Family
from glider.paths import models_path
from glider.physics.chain import derivatives
from glider.physics.model import GliderModel
from glider.physics.parameters import load_parameters
from glider.planning.problem import PerchingProblem
from glider.planning.sampling import MppiSettings, SequenceCost, mppi_step

ITERATIONS = 100


def rates_at(points, theta, rates):
    """Writes the derivatives (P, n) at points (P, n + 1) of states and command."""
    for k in range(len(points)):
        state, command = points[k, :-1], points[k, -1]
        d = derivatives(0.0, state, command, 0.0, 0.0, theta)
        for i in range(len(d)):
            rates[k, i] = d[i]


LOOPS = Family((rates_at,), (rates_at,))


def pairs() -> tuple[Pair, ...]:
    """Returns the article's search, and one update with many sequences."""
    import torch
    from pytorch_mppi import MPPI

    torch.set_num_threads(1)
    heavy = load_parameters(models_path("vehicles", "heavy.yaml"))
    problem = PerchingProblem.load(models_path("problems", "sampling.yaml"))
    model, launch = GliderModel(parameters=heavy), np.array(problem.launch)
    cost = SequenceCost(model, problem)
    loops = LOOPS.over(model.kinds)
    start, settings = (
        torch.tensor(launch),
        MppiSettings(temperature=0.1, deviation=1.0, likelihood_ratio=True),
    )

    def step(state, u):
        points = np.hstack([state.numpy(), u.numpy()])
        rates = np.empty(state.shape)
        loops.rates_at(points, model.numbers, rates)
        return state + cost.step * torch.from_numpy(rates)

    def running_cost(state, u):
        return problem.rate_cost * cost.step * u[:, 0] ** 2

    goal = torch.tensor(problem.goal, dtype=torch.float64)
    weights = torch.tensor(problem.goal_weights, dtype=torch.float64)

    def terminal_cost(states, actions):
        return torch.sum(weights * (states[..., -1, :] - goal) ** 2, dim=-1)

    def controller(samples):
        return MPPI(
            step,
            running_cost,
            model.num_states,
            torch.tensor([[settings.deviation**2]], dtype=torch.float64),
            num_samples=samples,
            horizon=cost.steps,
            terminal_state_cost=terminal_cost,
            lambda_=settings.temperature,
            U_init=torch.zeros((cost.steps, 1), dtype=torch.float64),
        )

    costs: dict[str, float] = {}

    def ours():
        rng = np.random.default_rng(0)
        mean = np.zeros(cost.steps)
        for _ in range(ITERATIONS):
            mean, _, _ = mppi_step(cost, launch, mean, rng, settings)
        total = cost.to_go(launch, mean[None], mean, settings.penalty)
        costs["ours"] = total[0, 0]

    def theirs():
        torch.manual_seed(0)
        planner = controller(settings.samples)
        for _ in range(ITERATIONS):
            planner.command(start, shift_nominal_trajectory=False)
        commands = planner.U.numpy().T
        costs["theirs"] = cost.to_go(launch, commands, commands[0], settings.penalty)[
            0, 0
        ]

    many = dataclasses.replace(settings, samples=1000)
    mean = np.zeros(cost.steps)
    rng, wide = np.random.default_rng(0), controller(1000)
    return (
        Pair(
            task=f"MPPI, {ITERATIONS} iterations of 30 flights of 75 steps",
            peer="pytorch-mppi",
            ours=ours,
            theirs=theirs,
            told=lambda: f"cost {costs['ours']:.1f} and {costs['theirs']:.1f}",
            rounds=5,
        ),
        Pair(
            task="MPPI, an update with 1000 flights",
            peer="pytorch-mppi",
            ours=lambda: mppi_step(cost, launch, mean, rng, many),
            theirs=lambda: wide.command(start, shift_nominal_trajectory=False),
            told=lambda: "",
        ),
    )
