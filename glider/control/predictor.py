"""Held commands of a policy, and a predictor that makes up for their known latency.

A command that is computed from the state at a time s acts from s + latency on, and is
held for a period. The predictor flies the model from that state, first under the
commands that are on their way, then under the policy itself to the middle of the hold,
and commands what the policy would command there. So the held commands are those of the
continuous feedback but for the second order of the period.
"""

import dataclasses
import itertools
import math
from collections.abc import Sequence

import numpy as np

from glider.compiled.flight import Steps, fly_batch, make_feedback, make_tape
from glider.control.tvlqr import TrackingPolicy
from glider.errors import expect
from glider.physics.model import GliderModel

STEP = 0.0025
"""Longest Runge-Kutta step [s]; half as long changes commands by less than 1e-4 of the
rate limit."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Hold:
    """How commands reach the servo."""

    period: float = 0.02  #: Time between commands, each held until the next [s].
    latency: float = 0.0  #: Time from the state to the command that acts on it [s].

    def __post_init__(self):
        """Raises InputError where a time is out of range."""
        good = 1e-3 <= self.period <= 1.0
        expect(good, "the period of commands", self.period, "0.001 to 1 s")
        expect(0.0 <= self.latency <= 1.0, "the latency", self.latency, "0 to 1 s")

    @property
    def waiting(self) -> int:
        """Number of whole periods in the latency: commands that wait to act."""
        return int(self.latency / self.period * (1.0 + 1e-12))

    @property
    def rest(self) -> float:
        """What is left of the latency [s]."""
        return max(self.latency - self.waiting * self.period, 0.0)


def policy_command(
    policy: TrackingPolicy, times: np.ndarray, states: np.ndarray
) -> np.ndarray:
    """Returns the commands (B,) of a policy for states (B, n) at times (B,)."""
    offset, gain = policy.sample(times)
    return offset - np.sum(gain * states[:, : gain.shape[1]], axis=1)


def held_command(
    model: GliderModel,
    policy: TrackingPolicy,
    times: np.ndarray,
    states: np.ndarray,
    waiting: Sequence[np.ndarray],
    hold: Hold,
) -> np.ndarray:
    """Returns the command (B,) that is computed from states at some times [rad/s].

    Args:
        model: the glider that the predictor flies.
        policy: the continuous feedback.
        times: (B,) of the states; the command acts a latency later [s].
        states: (B, n).
        waiting: the commands (B,) that act until then: the one that acts now, then one
            for each whole period of the latency.
        hold: period and latency.
    """
    for number, command in enumerate(waiting):
        time = hold.rest if number == 0 else hold.period
        states = flown_under(model, states, time, command)
        times = times + time

    def feedback(steps):
        return make_feedback(policy.sample, steps, times)

    # What is made for held commands makes up for the hold itself.
    ahead = 0.0 if policy.period else 0.5 * hold.period
    states = _flown(model, states, ahead, feedback)
    return policy_command(policy, times + ahead, states)


def fly_held(
    model: GliderModel, policy: TrackingPolicy, period: float, step: float, fine: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Flies commands that are held, from a plan's launch on.

    Each is that of the policy half a period later.

    Args:
        model: the glider that flies.
        policy: the feedback along the plan.
        period: time that each command is held [s].
        step: longest time between those that are returned [s].
        fine: longest step of the integration [s].

    Returns:
        times (T,), states (T, n) and commands (T,). The time of a sample stands twice,
        with the command before it and after it.
    """
    plan = policy.plan
    hold = Hold(period=period)
    begins = period * np.arange(math.ceil(plan.duration / period - 1e-9))
    times = []
    states = []
    commands = []
    now = plan.states[:1]
    for begin, end in itertools.pairwise([*begins, plan.duration]):
        command = held_command(model, policy, np.array([begin]), now, [], hold)
        intervals = math.ceil((end - begin) / step - 1e-9)
        every = math.ceil((end - begin) / (intervals * fine) - 1e-9)
        count = intervals * every
        steps = Steps(count, (end - begin) / count, every=every)
        tape = make_tape(command[None], count)
        path = fly_batch(model, now, steps, tape).states[0]
        now = path[-1:]
        times.append(np.linspace(begin, end, intervals + 1))
        states.append(path)
        commands.append(np.repeat(command, intervals + 1))
    return np.concatenate(times), np.concatenate(states), np.concatenate(commands)


def flown_under(
    model: GliderModel, states: np.ndarray, duration: float, commands: np.ndarray
) -> np.ndarray:
    """Returns states (B, n) some time [s] later, under held commands (B,) [rad/s]."""

    def tape(steps):
        return make_tape(commands[:, None], steps.number)

    return _flown(model, states, duration, tape)


def _flown(model, states, duration, feedback):
    """Returns states (B, n) some time [s] later, under a feedback of these steps."""
    if duration == 0.0:
        return states
    count = math.ceil(duration / STEP - 1e-9)
    steps = Steps(count, duration / count, every=count)
    return fly_batch(model, states, steps, feedback(steps)).states[:, -1]
