"""Sampled command sequences: what they cost, and the update of MPPI."""

import dataclasses
import math

import numpy as np

from glider.compiled.flight import fly_tapes
from glider.compiled.sequence_costs import FlightCost, costs_to_go
from glider.errors import expect
from glider.physics.model import GliderModel
from glider.physics.servo import NO_LIMITS
from glider.planning.problem import PerchingProblem

_WORST = 1e300
"""Cost of a flight whose numbers overflow."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class MppiSettings:
    """Settings of model-predictive path-integral control, by default the article's."""

    samples: int = 30  #: Sequences in an iteration.
    #: λ, in units of the cost: at a small one the best sequence takes all, at a large
    #: one all have equal weight.
    temperature: float = 10.0
    deviation: float = math.sqrt(0.1)  #: σ of each command [rad/s].
    #: Whether the cost holds λ log dQ/dP of the drawn sequence, Q being the
    #: distribution that it is drawn from and P the one about zero commands. The
    #: canonical algorithm does, and thereby minimizes a state cost plus λ/(2σ²) Σ u²;
    #: the article's does not.
    likelihood_ratio: bool = False

    def __post_init__(self):
        """Raises InputError where a setting cannot be."""
        for name in ("samples", "temperature", "deviation"):
            value = getattr(self, name)
            good = math.isfinite(value) and value > 0
            expect(good, f"MppiSettings: '{name}'", value, "a positive number")

    @property
    def penalty(self) -> float:
        """Weight of the likelihood ratio, see `glider.compiled.sequence_costs`."""
        return self.temperature / self.deviation**2 if self.likelihood_ratio else 0.0


class SequenceCost:
    """Cost that a problem gives sequences of commands, each held for a step.

    rate_cost Σ u² step + (x_N - goal)ᵀ diag(goal_weights) (x_N - goal)

    Attributes:
        model: the glider.
        step: [s].
        steps: their number N.
        num_states: n, with the effects' own states.
        servo: whose limits the commands keep.
    """

    def __init__(
        self,
        model: GliderModel,
        problem: PerchingProblem,
        *,
        step: float = 0.01,
        steps: int = 75,
        order: int = 1,
        within_limits: bool = False,
        free_end: bool = False,
    ) -> None:
        """Sets what is flown and its cost.

        Args:
            model: the glider.
            problem: whose goal, goal_weights and rate_cost are used, not its limits.
            step: [s].
            steps: their number.
            order: 1 for explicit Euler, 4 for classical Runge-Kutta.
            within_limits: whether the servo keeps its limits; the article's does not.
            free_end: whether the final cost is taken where that is cheapest, at
                step N or before: a glider may come early or late.

        Raises:
            InputError: a step or a number that cannot be.
        """
        positive = math.isfinite(step) and step > 0.0
        expect(positive, "SequenceCost: 'step'", step, "a positive number")
        expect(steps >= 1, "SequenceCost: 'steps'", steps, "at least 1")
        expect(order in (1, 4), "SequenceCost: 'order'", order, "1 or 4")
        self.step = step
        self.steps = steps
        self.num_states = model.num_states
        self.model = model
        self._order = order
        self.servo = model.parameters.servo if within_limits else NO_LIMITS
        self._cost = FlightCost(
            goal=np.array(problem.goal, dtype=float),
            weights=np.array(problem.goal_weights, dtype=float),
            rate=float(problem.rate_cost),
            free_end=free_end,
        )

    def to_go(
        self,
        start: np.ndarray,
        commands: np.ndarray,
        nominal: np.ndarray | None = None,
        penalty: float = 0.0,
    ) -> np.ndarray:
        """Returns the costs-to-go S_k of commands (B, N) [rad/s], shape (B, N + 1).

        The likelihood ratio is taken about `nominal` (N,) [rad/s] with the weight
        `penalty`, see `glider.compiled.sequence_costs`.
        """
        states = self.fly(start, commands)
        commands = np.ascontiguousarray(commands, dtype=float)
        nominal = np.zeros(self.steps) if nominal is None else nominal
        return costs_to_go(states, commands, nominal, penalty, self.step, self._cost)

    def fly(self, start: np.ndarray, commands: np.ndarray) -> np.ndarray:
        """Returns the states of the flights, shape (B, N + 1, n)."""
        start = np.asarray(start, dtype=float)
        commands = np.asarray(commands, dtype=float)
        good = start.shape == (self.num_states,) and commands.shape[1:] == (self.steps,)
        what = "SequenceCost: the pair of shapes"
        shapes = (start.shape, commands.shape)
        needed = f"a start ({self.num_states},) and commands (B, {self.steps})"
        expect(good, what, shapes, needed)
        return fly_tapes(
            self.model, start[None], commands, self.step, self._order, servo=self.servo
        )


def _mppi_update(
    mean: np.ndarray, noise: np.ndarray, to_go: np.ndarray, temperature: float
) -> np.ndarray:
    """Returns the mean, moved by the weighted noise.

    u_k + Σ_r w_k^r ε_k^r,  w_k^r = exp(-S_k^r / λ) / Σ_s exp(-S_k^s / λ)

    u is the mean (N,), ε the noise (B, N) [rad/s], S the costs-to-go (B, N), of which
    what is not a number weighs nothing, and λ the temperature.
    """
    to_go = np.nan_to_num(to_go, nan=_WORST, posinf=_WORST)
    # The least cost cancels in the quotient; without it all may underflow.
    weights = np.exp((np.min(to_go, axis=0) - to_go) / temperature)
    return mean + np.sum(weights * noise, axis=0) / np.sum(weights, axis=0)


def mppi_step(
    cost: SequenceCost,
    start: np.ndarray,
    mean: np.ndarray,
    rng: np.random.Generator,
    settings: MppiSettings,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Draws, flies and weights sequences once.

    Returns:
        the new mean (N,), the commands (1 + B, N) with the old mean as the first,
        and their costs (1 + B,).
    """
    noise = settings.deviation * rng.standard_normal((settings.samples, cost.steps))
    commands = np.vstack([mean, mean + noise])
    to_go = cost.to_go(start, commands, mean, settings.penalty)
    new = _mppi_update(mean, noise, to_go[1:, :-1], settings.temperature)
    return new, commands, to_go[:, 0]
