"""Many flights under one tracking feedback, by compiled code."""

import dataclasses
import math
from typing import Any

import numpy as np

from glider.compiled.kernel import compiled
from glider.control.policy import (
    TrackingPolicy,
    aligned_count,
    sample_policy,
)
from glider.errors import InputError
from glider.physics.model import GliderModel
from glider.physics.parameters import parameter_vector
from glider.physics.state import NUM_STATES
from glider.simulation.miss import PERCH_RADIUS
from glider.systems.plant import (
    GliderPlant,
    initial_state,
)

STEP = 0.002
"""Longest Runge-Kutta step [s]."""

AFTER = 0.1
"""How long a flight goes on after the plan's end [s]: a glider that comes late
passes the wire later. The plan ends at 0.9 m/s forward and 2 m/s down."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Flights:
    """What became of some launches."""

    times: np.ndarray
    """(N + 1,) of the steps [s]."""

    miss: np.ndarray
    """(B,) least distance of the center of mass from the wire [m]."""

    ends: np.ndarray
    """(B, n) the last states."""

    paths: np.ndarray | None = None
    """(B, N + 1, n) all states, if they were asked for."""

    @property
    def perched(self) -> np.ndarray:
        """(B,) whether the wire was within reach."""
        return self.miss < PERCH_RADIUS


@dataclasses.dataclass(frozen=True, kw_only=True)
class Clock:
    """The steps of a flight and how many of them a command is held."""

    step: float
    """[s]."""

    steps: int
    """Their number."""

    hold: int
    """Steps to a command; 0 where the command follows the state at once."""

    @property
    def commands(self) -> int:
        """How many commands are given, 0 without a hold."""
        return math.ceil(self.steps / self.hold) if self.hold else 0


def make_clock(
    policy: TrackingPolicy,
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
    duration = policy.plan.duration
    if not (math.isfinite(after) and after >= 0.0):
        raise InputError(f"'after' is {after} s; a number not negative is needed.")
    count = aligned_count(policy.plan, step)
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
        raise InputError(f"The command rate is {rate} Hz; a positive number is needed.")


def fly_closed_loop(
    model: GliderModel,
    policy: TrackingPolicy,
    starts: np.ndarray,
    *,
    wire: tuple[float, float] = (0.0, 0.0),
    command_rate: float | None = None,
    noise: np.ndarray | None = None,
    step: float = STEP,
    after: float = AFTER,
    keep_paths: bool = False,
) -> Flights:
    """Flies launches of one glider under a feedback, servo limits included.

    The same loop as `diagrams.closed_loop`, by Runge-Kutta at fixed steps.

    Args:
        model: the glider that is flown; it may have effects that the policy does
            not know, in still air beyond its own.
        policy: fed with the first states of the glider. A policy whose planner's
            effects have states that the glider lacks needs the observer of
            `diagrams.closed_loop`.
        starts: (B, 7), the effects' own states at rest, or (B, n).
        wire: (x, z) [m].
        command_rate: commands are computed at this rate and held [Hz]; None: the
            command follows the state at once.
        noise: (B, H, m) added to the states that each command is computed from,
            m states and `make_clock(...).commands` commands.
        step: longest step [s].
        after: how long the flights go on after the plan [s].
        keep_paths: whether to return all states.

    Raises:
        InputError: what is given does not fit together.
    """
    plant = GliderPlant(model)
    known = policy.plan.state_names
    if plant.state_names[: len(known)] != tuple(known):
        raise InputError(
            f"The policy feeds back {', '.join(known)}, but the glider has the states "
            f"{', '.join(plant.state_names)}; diagrams.closed_loop with its observer "
            "is needed."
        )
    clock = make_clock(policy, command_rate, step, after)
    starts = full_starts(plant, starts)
    batch, n = starts.shape
    shape = (batch, clock.commands, len(known))
    noise = np.empty((batch, 0, len(known))) if noise is None else np.asarray(noise)
    if noise.shape[1] > 0 and (clock.hold == 0 or noise.shape != shape):
        raise InputError(
            f"The noise has shape {noise.shape}; "
            + ("a command rate is needed." if clock.hold == 0 else f"{shape} needed.")
        )
    if clock.hold:
        sampled = np.arange(clock.commands) * clock.hold * clock.step
    else:
        sampled = np.arange(2 * clock.steps + 1) * 0.5 * clock.step
    offset, gain = sample_policy(policy, sampled)
    miss = np.empty(batch)
    states = np.empty((batch, clock.steps + 1 if keep_paths else 1, n))
    drawing = plant.model.parameters
    compiled(plant.kinds, plant.model.field is not None).guided(
        starts,
        clock.steps,
        clock.step,
        np.ascontiguousarray(offset),
        np.ascontiguousarray(gain),
        clock.hold,
        np.ascontiguousarray(noise, dtype=float),
        np.array([*drawing.elevator_limits, drawing.elevator_rate_limit]),
        np.array(wire, dtype=float),
        parameter_vector(drawing),
        plant.model.coefficients,
        plant.model.residual_field,
        miss,
        states,
    )
    return Flights(
        times=np.arange(clock.steps + 1) * clock.step,
        miss=miss,
        ends=states[:, -1].copy(),
        paths=states if keep_paths else None,
    )


def full_starts(plant: Any, starts: np.ndarray) -> np.ndarray:
    """Returns launch states (B, n); given (B, 7), the effects' own are at rest."""
    starts = np.array(starts, dtype=float)
    if starts.ndim != 2 or not len(starts) or not np.all(np.isfinite(starts)):
        raise InputError(
            f"The launches have shape {starts.shape}; (B, {NUM_STATES}) finite "
            "numbers are needed."
        )
    return np.ascontiguousarray(initial_state(plant, starts.T).T)
