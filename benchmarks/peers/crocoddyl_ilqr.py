"""crocoddyl's BoxFDDP on the article's goal with a regular cost.

Its action model is a Python class over our compiled dynamics, Euler steps as ours; it
keeps the servo's rate limit (the stops of the elevator it cannot).
"""

import numpy as np

from benchmarks.peers.pairs import Pair
from glider.compiled.collocation import rates_along
from glider.compiled.jacobian import differentiate, stacked
from glider.paths import models_path
from glider.physics.model import GliderModel
from glider.physics.parameters import load_parameters
from ilqr import IlqrSettings, goal_problem, ilqr


def pairs() -> tuple[Pair, ...]:
    """Returns the 75 steps from no command at all."""
    import crocoddyl

    heavy = load_parameters(models_path("vehicles", "heavy.yaml"))
    model, problem, settings = (
        GliderModel(parameters=heavy),
        goal_problem(),
        IlqrSettings(),
    )
    n, servo = model.num_states, heavy.servo
    z = stacked(n, model.numbers)
    directions = np.asfortranarray(np.eye(n + 1))
    goal, stage = np.array(problem.goal), np.array(settings.state_weights)
    final, rate = np.array(problem.goal_weights), problem.rate_cost * settings.step

    class Action(crocoddyl.ActionModelAbstract):
        """A step of the glider and its cost, or the cost of the end."""

        def __init__(self, is_last: bool) -> None:
            space = crocoddyl.StateVector(n)
            crocoddyl.ActionModelAbstract.__init__(self, space, 0 if is_last else 1, 0)
            self._is_last = is_last
            if not is_last:
                self.u_lb, self.u_ub = np.array([-servo.rate]), np.array([servo.rate])

        def calc(self, data, x, u=None):
            error = x - goal
            if self._is_last or u is None:
                data.xnext, data.cost = x, float(final @ error**2)
                return
            rates = rates_along(model, np.append(x, u)[None])[0]
            data.xnext = x + settings.step * rates
            data.cost = float(stage @ error**2) + rate * u[0] ** 2

        def calcDiff(self, data, x, u=None):
            weights = final if self._is_last or u is None else stage
            data.Lx, data.Lxx = 2.0 * weights * (x - goal), np.diag(2.0 * weights)
            if self._is_last or u is None:
                return
            z[:n] = x
            z[n] = u[0]
            slopes = differentiate(model, 0.0, z, directions)[1]
            data.Fx = np.eye(n) + settings.step * slopes[:, :n]
            data.Fu = settings.step * slopes[:, n]
            data.Lu = np.array([2.0 * rate * u[0]])
            data.Luu = np.array([[2.0 * rate]])

    launch = model.initial_state(problem.launch)
    running, last = Action(False), Action(True)
    shooting = crocoddyl.ShootingProblem(launch, [running] * settings.steps, last)
    costs: dict[str, float] = {}

    def ours():
        costs["ours"] = ilqr(model, problem, settings).cost

    def theirs():
        commands = [np.zeros(1)] * settings.steps
        solver = crocoddyl.SolverBoxFDDP(shooting)
        solver.th_stop = 1e-6
        solver.solve(shooting.rollout(commands), commands, 500, True)
        costs["theirs"] = solver.cost

    return (
        Pair(
            task="iLQR, 75 steps to a goal",
            peer="crocoddyl's BoxFDDP, action model in Python",
            ours=ours,
            theirs=theirs,
            told=lambda: f"cost {costs['ours']:.3f} and {costs['theirs']:.3f}",
        ),
    )
