"""A plan with held commands and its feedback, as `glider.simulation.fly` takes it."""

import dataclasses

import numpy as np

from glider.control.tvlqr import aligned_count
from glider.physics.held_commands import latest_command
from glider.physics.state import NUM_STATES, STATE_NAMES
from glider.planning.plan import Plan


@dataclasses.dataclass(frozen=True, kw_only=True)
class HeldPolicy:
    """The feedback of a plan with held commands, u_k = inputs[k] + gains[k] x̃_k.

    The rigid body's states are fed back; the effects' own, which are not measured, are
    taken to be as planned. After the plan the elevator stands still.

    Attributes:
        plan: the plan.
        gains: (N - 1, n); None for the plan's commands as they are.
    """

    plan: Plan
    gains: np.ndarray | None = None

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the states that are fed back."""
        return STATE_NAMES

    @property
    def duration(self) -> float:
        """Duration of the plan [s]."""
        return self.plan.duration

    @property
    def command_rate(self) -> float:
        """Rate of the commands [Hz]."""
        return 1.0 / float(self.plan.times[1])

    def count(self, step: float) -> int:
        """Number of equal steps, none longer, that the plan divides into."""
        return aligned_count(self.plan, step)

    def sample(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns u = offset - gain x at times (J,): (J,) [rad/s] and (J, 7)."""
        offset, gain = np.zeros(len(times)), np.zeros((len(times), NUM_STATES))
        knot = latest_command(self.plan.times, times)
        flown = np.flatnonzero(knot < len(self.plan.inputs))
        knot = knot[flown]
        if self.gains is not None:
            gain[flown] = -self.gains[knot, :NUM_STATES]
        nominal = self.plan.states[knot, :NUM_STATES]
        offset[flown] = self.plan.inputs[knot] + np.sum(gain[flown] * nominal, axis=1)
        return offset, gain
