"""Flies a glider under a stepped plan, and what motion capture sees of it."""

import dataclasses
import math

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from glider.campaign.logs import Flight
from glider.compiled.kernel import compiled
from glider.errors import InputError
from glider.physics.compose import compose
from glider.physics.model import GliderModel
from glider.physics.parameters import parameter_vector
from glider.physics.servo import limited_rate
from glider.physics.state import (
    NUM_STATES,
    POSE_NAMES,
    STATE_NAMES,
)
from glider.planning.ilqr import SteppedPlan
from glider.simulation.closed_loop import (
    AFTER,
    STEP,
    full_starts,
)
from glider.simulation.miss import PERCH_RADIUS
from glider.systems.plant import GliderPlant

CAPTURE_RATE = 120.0
"""Of motion capture [Hz]."""

CAPTURE_NOISE = (0.0004, 0.0004, 0.0025, 0.005)
"""Standard deviation of x, z [m], pitch and elevator [rad], as practice campaigns
have it."""

_ELEVATOR = STATE_NAMES.index("elevator")
_RATES = slice(_ELEVATOR + 1, NUM_STATES)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Execution:
    """One flight of a glider under a stepped plan."""

    times: np.ndarray
    """(K + 1,) of the integrator's steps [s]."""

    states: np.ndarray
    """(K + 1, n) of the glider."""

    knots: np.ndarray
    """(N + 1, n) the states when the plan's commands begin and when it ends."""

    rates: np.ndarray
    """(H,) commands after the servo's limits, at the beginning of each [rad/s]; N of
    the plan, then zeros."""

    step: float
    """Of the commands [s]."""

    miss: float
    """Least distance of the center of mass from the wire [m]."""

    @property
    def perched(self) -> bool:
        """Whether the wire was within reach."""
        return self.miss < PERCH_RADIUS


def execute(
    truth: GliderModel,
    planned: SteppedPlan,
    starts: np.ndarray,
    wire: tuple[float, float] = (0.0, 0.0),
) -> list[Execution]:
    """Flies launches under a stepped plan and its feedback, servo limits included.

    Commands are held for the plan's step; the glider is integrated by Runge-Kutta
    at steps of at most `STEP`. The rigid body's states are fed back as they are; the
    model's effects' own, which nobody measures, are taken to be as planned. After the
    plan the elevator stands still while the glider may yet pass the wire.

    Args:
        truth: the glider that is flown, which may have effects that the planner
            does not know.
        planned: the flight and its feedback.
        starts: (B, 7) launches, or (B, n).
        wire: (x, z) [m].
    """
    plant = GliderPlant(truth)
    starts = full_starts(plant, starts)
    hold = math.ceil(planned.step / STEP - 1e-9)
    step, count = planned.step / hold, len(planned.inputs)
    commands = count + math.ceil(AFTER / planned.step)
    offset, gain = np.zeros(commands), np.zeros((commands, NUM_STATES))
    gain[:count] = -planned.gains[:, :NUM_STATES]
    nominal = planned.states[:-1, :NUM_STATES]
    offset[:count] = planned.inputs + np.sum(gain[:count] * nominal, axis=1)
    batch, n = starts.shape
    miss = np.empty(batch)
    states = np.empty((batch, commands * hold + 1, n))
    drawing = truth.parameters
    limits = (*drawing.elevator_limits, drawing.elevator_rate_limit)
    compiled(plant.kinds, truth.field is not None).guided(
        starts,
        commands * hold,
        step,
        offset,
        gain,
        hold,
        np.empty((batch, 0, NUM_STATES)),
        np.array(limits),
        np.array(wire, dtype=float),
        parameter_vector(drawing),
        plant.model.coefficients,
        truth.residual_field,
        miss,
        states,
    )
    begins = states[:, :-1:hold, :NUM_STATES]
    wanted = offset - np.sum(gain * begins, axis=2)
    return [
        Execution(
            times=step * np.arange(commands * hold + 1),
            states=states[b],
            knots=states[b, : count * hold + 1 : hold],
            rates=_after_limits(wanted[b], begins[b, :, _ELEVATOR], limits),
            step=planned.step,
            miss=float(miss[b]),
        )
        for b in range(batch)
    ]


def _after_limits(
    wanted: np.ndarray, elevator: np.ndarray, limits: tuple[float, ...]
) -> np.ndarray:
    pairs = zip(wanted, elevator, strict=True)
    return np.array([limited_rate(command, angle, *limits) for command, angle in pairs])


def capture(
    truth: GliderModel, flown: Execution, rng: np.random.Generator, name: str
) -> Flight:
    """Returns what motion capture logs of a flight, noise included.

    As in a real log, a new command shows in the first row after it was given.

    Args:
        truth: whose sensors show the pose.
        flown: the flight.
        rng: draws the noise.
        name: of the flight's file, flight_*.csv.

    Raises:
        InputError: the flight did not stay finite.
    """
    if not np.all(np.isfinite(flown.states)):
        raise InputError(f"{name}: the flight diverges; it cannot be logged.")
    time = np.arange(int(flown.times[-1] * CAPTURE_RATE + 1e-9) + 1) / CAPTURE_RATE
    states = np.stack(
        [np.interp(time, flown.times, column) for column in flown.states.T], axis=1
    )
    pose = slice(0, len(POSE_NAMES))
    path = CubicHermiteSpline(
        flown.times, flown.states[:, pose], flown.states[:, _RATES]
    )
    states[:, pose] = path(time)
    plant = GliderPlant(truth)
    shown = compose(plant.kinds, truth.field is not None).measure(
        states.T,
        parameter_vector(truth.parameters),
        plant.model.coefficients,
    )
    noise = rng.normal(size=(len(time), len(CAPTURE_NOISE))) * CAPTURE_NOISE
    latest = np.minimum((time / flown.step + 1e-9).astype(int), len(flown.rates) - 1)
    return Flight(
        name=name,
        time=time,
        pose=np.stack(shown, axis=1) + noise[:, pose],
        elevator=states[:, _ELEVATOR] + noise[:, -1],
        command=flown.rates[latest],
    )
