"""One way to fly: many launches of a glider under a policy, by compiled code."""

import dataclasses
import math
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

import joblib
import numpy as np

from glider.compiled.flight import Feedback, Steps, fly_batch, make_feedback
from glider.errors import expect
from glider.physics.model import GliderModel, as_model
from glider.physics.state import NUM_STATES
from glider.planning.problem import PerchingProblem
from glider.simulation.flown_flights import Flights

STEP = 0.002
"""Longest Runge-Kutta step [s]."""

AFTER = 0.1
"""Time that a flight goes on after the plan's end [s]: a glider that comes late
passes the wire later. The plan ends at 0.9 m/s forward and 2 m/s down."""

_CHUNK = 2500
"""Number of flights in one task of a sweep. Another number means other random draws."""


class Policy(Protocol):
    """Law of the elevator's rate as a function of time and state."""

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the states that are fed back, the glider's first ones."""

    @property
    def duration(self) -> float:
        """Time until the plan's end [s]."""

    def count(self, step: float) -> int:
        """Number of equal steps, none longer, that the plan divides into."""

    def sample(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns u = offset - gain x: offset (J,) [rad/s] and gain (J, m) at times."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Clock:
    """The steps of a flight and how many of them a command is held."""

    step: float  #: Length of a step [s].
    steps: int  #: Number of steps.
    hold: int  #: Steps to a command; 0 where the command follows the state at once.

    @property
    def commands(self) -> int:
        """Number of commands that are given, 0 without a hold."""
        return math.ceil(self.steps / self.hold) if self.hold else 0


def _make_clock(
    policy: Policy,
    command_rate: float | None = None,
    step: float = STEP,
    after: float = AFTER,
) -> _Clock:
    """Divides a flight into steps that the kinks of plan or commands fall between.

    Args:
        policy: whose plan is flown.
        command_rate: [Hz]; None for a feedback without a hold.
        step: longest step [s].
        after: how long the flight goes on after the plan [s].
    """
    duration = policy.duration
    good = math.isfinite(after) and after >= 0.0
    expect(good, "'after'", after, "a number of seconds that is not negative")
    count = policy.count(step)
    if command_rate is None:
        step = duration / count
        return _Clock(step=step, steps=count + math.ceil(after / step), hold=0)
    check_command_rate(command_rate)
    hold = math.ceil(1.0 / (command_rate * step) - 1e-9)
    step = 1.0 / (command_rate * hold)
    return _Clock(step=step, steps=math.ceil((duration + after) / step), hold=hold)


def check_command_rate(rate: float) -> None:
    """Raises InputError unless commands can be given at a rate [Hz]."""
    good = math.isfinite(rate) and rate > 0.0
    expect(good, "the command rate", rate, "a positive number of Hz")


def fly(
    model: GliderModel | Path | str,
    policy: Policy,
    starts: np.ndarray,
    *,
    problem: PerchingProblem | None = None,
    command_rate: float | None = None,
    step: float = STEP,
    after: float = AFTER,
    keep_paths: bool = False,
) -> Flights:
    """Flies launches of one glider under a policy, servo limits included.

    The same loop as `diagrams.closed_loop`, by Runge-Kutta at fixed steps.

    Args:
        model: the glider that is flown, or the path of its file; it may have effects
            that the policy does not model; the air is still but for these.
        policy: fed with the first states of the glider. A policy whose planner's
            effects have states that the glider lacks needs the observer of
            `diagrams.closed_loop`.
        starts: (B, 7), the effects' own states at rest, or (B, n).
        problem: whose wire and hook; None for the article's.
        command_rate: commands are computed at this rate and held [Hz]; None: the
            command follows the state at once.
        step: longest step [s]; divided where the effects' own states ask for it.
        after: how long the flights go on after the plan [s].
        keep_paths: whether to return all states.

    Raises:
        InputError: what is given does not fit together.
    """
    model = as_model(model)
    check_states(model, policy)
    clock = _make_clock(policy, command_rate, step, after)
    laps = model.count_laps(clock.step)
    starts = full_starts(model, starts)
    count = clock.steps * laps
    steps = Steps(count, clock.step / laps, every=laps if keep_paths else count)
    problem = PerchingProblem() if problem is None else problem
    if clock.hold:
        sampled = np.arange(clock.commands) * clock.hold * clock.step
        offset, gain = (table[None] for table in policy.sample(sampled))
        feedback = Feedback(offset, gain, clock.hold * laps)
    else:
        feedback = make_feedback(policy.sample, steps)
    flown = fly_batch(model, starts, steps, feedback, wire=problem.wire)
    states = flown.states
    return Flights(
        times=np.arange(clock.steps + 1) * clock.step,
        miss=flown.miss,
        arrivals=flown.arrivals,
        problem=problem,
        ends=states[:, -1].copy(),
        paths=states if keep_paths else None,
    )


def check_states(model: GliderModel, policy: Policy) -> None:
    """Raises InputError unless a glider's first states are those that are fed back."""
    known = tuple(policy.state_names)
    fed_back = model.state_names[: len(known)]
    needed = f"{', '.join(known)} first"
    needed += ", as the policy feeds them back, or diagrams.closed_loop's observer"
    what = "the list of the glider's states"
    expect(fed_back == known, what, model.state_names, needed)


def full_starts(model: GliderModel, starts: np.ndarray) -> np.ndarray:
    """Returns launch states (B, n); given (B, 7), the effects' own are at rest."""
    starts = np.array(starts, dtype=float)
    good = starts.ndim == 2 and len(starts) and np.all(np.isfinite(starts))
    expect(good, "the launches", starts, f"(B, {NUM_STATES}) finite numbers")
    return np.ascontiguousarray(model.initial_state(starts.T).T)


def sweep(
    fly_some: Callable[[int, np.random.Generator], Flights], flights: int, seed: int
) -> Flights:
    """Flies very many launches in chunks that joblib's workers share.

    The caller chooses the workers, up to a cluster:

        def fly_some(count, rng):
            return fly(model, policy, problem.draw_launches(count, rng))

        with workers_of("tcp://scheduler:8786"):
            found = sweep(fly_some, flights=100_000, seed=0)

    The result depends on the seed alone, not on the workers, and is without paths.
    """
    expect(flights >= 1, "sweep: 'flights'", flights, "at least 1")
    counts = [min(_CHUNK, flights - first) for first in range(0, flights, _CHUNK)]
    rngs = np.random.default_rng(seed).spawn(len(counts))
    fly_chunk = joblib.delayed(fly_some)
    chunks = joblib.Parallel()(map(fly_chunk, counts, rngs))
    joined = {
        name: np.concatenate([getattr(chunk, name) for chunk in chunks])
        for name in ("miss", "arrivals", "ends")
    }
    return dataclasses.replace(chunks[0], **joined, paths=None)
