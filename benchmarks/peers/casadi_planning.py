"""CasADi with IPOPT on the same transcription, its building not counted.

The same Hermite-Simpson defects, bounds and cost over the same knots, from the same
guess; our physics, traced to CasADi's symbols.
"""

import dataclasses
from typing import Any

import numpy as np

from benchmarks.bench_planning import KNOTS, PERIOD
from benchmarks.peers.pairs import Pair
from glider.physics.model import GliderModel
from glider.planning.guess import straight_line
from glider.planning.problem import PerchingProblem
from glider.planning.structured import (
    WARM_BARRIER,
    CollocatedFlight,
    make_program,
    solve_structured,
    to_optimum,
)

TOLERANCE = 1e-6
"""Tolerance of both."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Transcription:
    """A solver of CasADi's, its bounds and the launch in them."""

    solver: Any
    low: np.ndarray
    high: np.ndarray

    def solve(self, w, launch, multipliers=0.0):
        """Returns knots and step as our program has them, multipliers and cost.

        Args:
            w: to start from, (N (n + 1) + 1,).
            launch: (n,).
            multipliers: of the wire's place and the defects.
        """
        low, high = self.low.copy(), self.high.copy()
        low[: len(launch)] = high[: len(launch)] = launch
        found = self.solver(
            x0=w, lbx=low, ubx=high, lbg=0.0, ubg=0.0, lam_g0=multipliers
        )
        if not self.solver.stats()["success"]:
            raise RuntimeError(f"IPOPT: {self.solver.stats()['return_status']}")
        w, multipliers = np.array(found["x"])[:, 0], np.array(found["lam_g"])[:, 0]
        return w, multipliers, float(found["f"])


def transcribed(
    model: GliderModel, problem: PerchingProblem, knots: int, warm: bool = False
) -> Transcription:
    """Builds the program for CasADi, over the variables of `make_program`.

    Args:
        model: the glider.
        problem: what to fly.
        knots: number of them.
        warm: whether to start from a solution nearby, its multipliers included.
    """
    import casadi

    casadi.GlobalOptions.setNumpyMode(1)  # np.sin of a symbol is one.
    n, program = model.num_states, make_program(model, problem, knots)
    w = casadi.SX.sym("w", knots * (n + 1) + 1)
    x, u = casadi.SX.sym("x", n), casadi.SX.sym("u")
    rates = model.chain.derivatives(0.0, x, u, 0.0, 0.0, model.numbers)
    f = casadi.Function("f", [x, u], [casadi.vertcat(*rates)])
    h, points = w[-1], [w[k * (n + 1) : (k + 1) * (n + 1)] for k in range(knots)]
    slopes = [f(point[:n], point[n]) for point in points]
    defects = [points[-1][:2] - casadi.DM(problem.wire)]
    cost = 0.0
    for (a, fa), (b, fb) in zip(
        zip(points[:-1], slopes[:-1], strict=True),
        zip(points[1:], slopes[1:], strict=True),
        strict=True,
    ):
        middle = 0.5 * (a[:n] + b[:n]) + h / 8 * (fa - fb)
        fc = f(middle, 0.5 * (a[n] + b[n]))
        defects.append(b[:n] - a[:n] - h / 6 * (fa + 4 * fc + fb))
        cost += program.rate_cost * h / 2 * (a[n] ** 2 + b[n] ** 2)
    error = points[-1][:n] - casadi.DM(program.goal)
    cost += casadi.dot(casadi.DM(program.goal_weights), error**2)
    ipopt = {"print_level": 0, "sb": "yes", "tol": TOLERANCE}
    if warm:
        ipopt |= {"warm_start_init_point": "yes", "mu_init": WARM_BARRIER}
    options = {"print_time": False, "ipopt": ipopt}
    nlp = {"x": w, "f": cost, "g": casadi.vertcat(*defects)}
    return Transcription(
        solver=casadi.nlpsol("perch", "ipopt", nlp, options),
        low=program.bounds[0],
        high=program.bounds[1],
    )


def _moved(problem: PerchingProblem, flight: CollocatedFlight) -> PerchingProblem:
    """Returns the problem a command's period later, from a state beside the plan."""
    end, path = flight.times[-1], flight.knots[:, :7].T
    state = np.array([np.interp(PERIOD, flight.times, row) for row in path])
    state += [0.01, -0.01, 0.02, 0.0, 0.05, -0.05, 0.1]
    return dataclasses.replace(
        problem,
        launch=state.tolist(),
        x_limits=[-4.0, 1.0],
        duration_limits=[0.5 * end, 1.5 * end],
    )


def pairs() -> tuple[Pair, ...]:
    """Returns a plan from a straight line, and a plan made again from it."""
    model, problem = GliderModel(), PerchingProblem()
    line = straight_line(model, problem)
    costs: dict[str, float] = {}
    coarse, fine = (transcribed(model, problem, knots) for knots in KNOTS)
    launch = model.initial_state(problem.launch)

    def ours() -> CollocatedFlight:
        flight = solve_structured(model, problem, KNOTS[0], line)
        flight = solve_structured(model, problem, KNOTS[1], flight)
        costs["ours"] = flight.cost
        return flight

    def theirs() -> tuple[np.ndarray, np.ndarray]:
        w, _, _ = coarse.solve(to_optimum(line, KNOTS[0]).w, launch)
        w, multipliers, costs["theirs"] = fine.solve(_resampled(w, *KNOTS), launch)
        return w, multipliers

    planned, (their_plan, multipliers) = ours(), theirs()
    later = _moved(problem, planned)
    again, start = transcribed(model, later, KNOTS[1], True), np.array(later.launch)
    remaining = planned.resampled(KNOTS[1], PERIOD).w

    def ours_again():
        costs["ours again"] = solve_structured(
            model, later, KNOTS[1], planned, elapsed=PERIOD
        ).cost

    def theirs_again():
        costs["theirs again"] = again.solve(remaining, start, multipliers)[2]

    assert np.allclose(their_plan, planned.optimum.w, atol=1e-3)
    return (
        Pair(
            task="solve on 25, then 41 knots",
            peer="CasADi with IPOPT, solving only",
            ours=ours,
            theirs=theirs,
            told=lambda: f"cost {costs['ours']:.3f} and {costs['theirs']:.3f}",
        ),
        Pair(
            task="plan again from a state nearby, 41 knots",
            peer="CasADi with IPOPT, solving only",
            ours=ours_again,
            theirs=theirs_again,
            told=lambda: (
                f"cost {costs['ours again']:.3f} and {costs['theirs again']:.3f}"
            ),
        ),
    )


def _resampled(w: np.ndarray, old: int, new: int) -> np.ndarray:
    """Returns knots and step on another number of knots."""
    points, times = w[:-1].reshape(old, -1), np.linspace(0.0, 1.0, new)
    before = np.linspace(0.0, 1.0, old)
    columns = [np.interp(times, before, column) for column in points.T]
    step = w[-1] * (old - 1) / (new - 1)
    return np.append(np.column_stack(columns).ravel(), step)
