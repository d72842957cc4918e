"""One way to fly: many launches of a glider under a policy, by compiled code."""

import dataclasses
import math
from pathlib import Path
from typing import Protocol

import numpy as np

from glider.compiled.closed_loop import Feedback, fly_feedback
from glider.errors import InputError, show
from glider.physics.model import GliderModel, as_model
from glider.physics.servo import limited_rates
from glider.physics.state import ELEVATOR, NUM_STATES
from glider.physics.stiffness import count_laps
from glider.planning.problem import PerchingProblem
from glider.simulation.flown_flights import Flights

STEP = 0.002
"""Longest Runge-Kutta step [s]."""

AFTER = 0.1
"""Time that a flight goes on after the plan's end [s]: a glider that comes late
passes the wire later. The plan ends at 0.9 m/s forward and 2 m/s down."""


class Policy(Protocol):
    """Law that tells the elevator's rate from the time and the state."""

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the states that are fed back, the glider's first ones."""

    @property
    def duration(self) -> float:
        """Time until the plan's end [s]."""

    def count(self, step: float) -> int:
        """Returns how many equal steps, none longer, the plan divides into."""

    def sample(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns u = offset - gain x: offset (J,) [rad/s] and gain (J, m) at times."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Clock:
    """The steps of a flight and how many of them a command is held."""

    step: float
    """Length of a step [s]."""

    steps: int
    """Number of steps."""

    hold: int
    """Number of steps to a command; 0 where the command follows the state at once."""

    @property
    def commands(self) -> int:
        """Number of commands that are given, 0 without a hold."""
        return math.ceil(self.steps / self.hold) if self.hold else 0


def make_clock(
    policy: Policy,
    command_rate: float | None = None,
    step: float = STEP,
    after: float = AFTER,
) -> Clock:
    """Divides a flight into steps that the kinks of plan or commands fall between.

    Args:
        policy: whose plan is flown.
        command_rate: [Hz]; None for a feedback without a hold.
        step: longest step [s].
        after: how long the flight goes on after the plan [s].
    """
    duration = policy.duration
    if not (math.isfinite(after) and after >= 0.0):
        raise InputError(f"'after' is {after} s; a number not negative is needed.")
    count = policy.count(step)
    if command_rate is None:
        step = duration / count
        return Clock(step=step, steps=count + math.ceil(after / step), hold=0)
    check_command_rate(command_rate)
    hold = math.ceil(1.0 / (command_rate * step) - 1e-9)
    step = 1.0 / (command_rate * hold)
    return Clock(step=step, steps=math.ceil((duration + after) / step), hold=hold)


def check_command_rate(rate: float) -> None:
    """Raises InputError unless commands can be given at a rate [Hz]."""
    if not (math.isfinite(rate) and rate > 0.0):
        raise InputError(
            f"The command rate is {show(rate)} Hz; a positive number is needed."
        )


def fly(
    model: GliderModel | Path | str,
    policy: Policy,
    starts: np.ndarray,
    *,
    problem: PerchingProblem | None = None,
    command_rate: float | None = None,
    noise: np.ndarray | None = None,
    step: float = STEP,
    after: float = AFTER,
    keep_paths: bool = False,
) -> Flights:
    """Flies launches of one glider under a policy, servo limits included.

    The same loop as `diagrams.closed_loop`, by Runge-Kutta at fixed steps.

    Args:
        model: the glider that is flown, or the path of its file; it may have effects
            that the policy does not know, in still air beyond its own.
        policy: fed with the first states of the glider. A policy whose planner's
            effects have states that the glider lacks needs the observer of
            `diagrams.closed_loop`.
        starts: (B, 7), the effects' own states at rest, or (B, n).
        problem: whose wire and hook; None for the article's.
        command_rate: commands are computed at this rate and held [Hz]; None: the
            command follows the state at once.
        noise: (B, H, m) added to the states that each command is computed from,
            m states and `make_clock(...).commands` commands.
        step: longest step [s]; divided where the effects' own states ask for it.
        after: how long the flights go on after the plan [s].
        keep_paths: whether to return all states, and what the servo made of held
            commands.

    Raises:
        InputError: what is given does not fit together.
    """
    model = as_model(model)
    known = policy.state_names
    if model.state_names[: len(known)] != tuple(known):
        raise InputError(
            f"The policy feeds back {', '.join(known)}, but the glider has the states "
            f"{', '.join(model.state_names)}; diagrams.closed_loop with its observer "
            "is needed."
        )
    clock = make_clock(policy, command_rate, step, after)
    laps = count_laps(model, clock.step)
    starts = full_starts(model, starts)
    shape = (len(starts), clock.commands, len(known))
    noise = np.empty((len(starts), 0, len(known))) if noise is None else noise
    noise = np.asarray(noise, dtype=float)
    is_none = noise.ndim == 3 and noise.shape[1] == 0
    if not is_none and (clock.hold == 0 or noise.shape != shape):
        raise InputError(
            f"The noise has shape {noise.shape}; "
            + ("a command rate is needed." if clock.hold == 0 else f"{shape} needed.")
        )
    if clock.hold:
        sampled = np.arange(clock.commands) * clock.hold * clock.step
    else:
        sampled = np.arange(2 * clock.steps * laps + 1) * 0.5 * clock.step / laps
    offset, gain = policy.sample(sampled)
    problem = PerchingProblem() if problem is None else problem
    miss, arrivals, states = fly_feedback(
        model,
        starts,
        clock.steps * laps,
        clock.step / laps,
        Feedback(offset=offset, gain=gain, hold=clock.hold * laps, noise=noise),
        wire=(problem.wire[0], problem.wire[1]),
        keep_paths=keep_paths,
    )
    states = states[:, ::laps]
    commands = None
    if keep_paths and clock.hold:
        begins = states[:, : -1 : clock.hold]
        seen = begins[:, :, : len(known)] + (noise if noise.shape[1] else 0.0)
        wanted = offset - np.sum(gain * seen, axis=2)
        commands = limited_rates(wanted, begins[:, :, ELEVATOR], model.parameters.servo)
    return Flights(
        times=np.arange(clock.steps + 1) * clock.step,
        miss=miss,
        arrivals=arrivals,
        problem=problem,
        ends=states[:, -1].copy(),
        paths=states if keep_paths else None,
        command_times=sampled if clock.hold else None,
        commands=commands,
    )


def full_starts(model: GliderModel, starts: np.ndarray) -> np.ndarray:
    """Returns launch states (B, n); given (B, 7), the effects' own are at rest."""
    starts = np.array(starts, dtype=float)
    if starts.ndim != 2 or not len(starts) or not np.all(np.isfinite(starts)):
        raise InputError(
            f"The launches have shape {starts.shape}; (B, {NUM_STATES}) finite "
            "numbers are needed."
        )
    return np.ascontiguousarray(model.initial_state(starts.T).T)
