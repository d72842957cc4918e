"""Simulated campaigns with a known truth, to test the pipeline on.

Flights are launched, commanded, flown finely, measured with noise and logged in
the format of real ones.
"""

import dataclasses
import functools

import numpy as np

from glider.campaign.logs import Campaign, Flight, campaign_of
from glider.campaign.motion_capture import MotionCapture
from glider.campaign.turning import signs_of, turn
from glider.compiled.actuators import replayed_path
from glider.compiled.replay import OFFSET, log_path, roll_out
from glider.physics.effects import NO_GAUSSIANS, Gaussians
from glider.physics.held_commands import latest_command
from glider.physics.model import GliderModel
from glider.physics.parameter_space import ParameterSpace
from glider.physics.servo import Servo
from glider.sysid.replay.log_space import (
    log_space_of,
    resting_states,
    sensed,
    vector_of,
)

FINE = 10
"""Integration steps between two rows of the log."""


@dataclasses.dataclass(kw_only=True)
class CampaignPlan:
    """Plan of a simulated campaign: how to fly and how to measure."""

    flights: int = 40  #: Number of launches.
    duration: float = 0.86  #: Of each flight [s].
    capture: MotionCapture = MotionCapture()  #: Motion capture that measures.
    command_rate: float = 50.0  #: Of the elevator-rate commands [Hz].
    #: Mean launch state.
    launch: tuple[float, ...] = (-3.5, 0.1, 0.0, 0.0, 7.0, 0.0, 0.0)
    #: Standard deviation of the launch states.
    launch_spread: tuple[float, ...] = (0.05, 0.12, 0.06, 0.0, 0.3, 0.2, 0.3)

    def simulate(
        self, model: GliderModel, rng: np.random.Generator, name: str = "simulated"
    ) -> Campaign:
        """Flies and logs a campaign of a glider whose truth is `model`.

        The campaign's vehicle has the model's parameters: its effects stay undeclared.
        """
        names = [f"flight_{i:03d}.csv" for i in range(self.flights)]
        flights = [_fly(model, self, rng, flight) for flight in names]
        rates = self.capture.rate, self.command_rate
        return campaign_of(name, model.parameters, flights, *rates)


def random_commands(
    count: int, period: float, servo: Servo, rng: np.random.Generator
) -> np.ndarray:
    """Returns a wandering tape of elevator rates that keeps inside the travel."""
    low, high, rate_limit = servo
    middle = 0.5 * (low + high)
    half = 0.4 * (high - low)
    tape = np.empty(count)
    rate = rng.normal(0.0, 4.0)
    angle = 0.0
    for k in range(count):
        if rng.random() < 0.1:
            rate = rng.normal(0.0, 7.0)
        rate = 0.9 * rate + rng.normal(0.0, 1.5)
        pull = -12.0 * max(abs(angle - middle) - 0.7 * half, 0.0)
        rate += pull * np.sign(angle - middle)
        tape[k] = np.clip(rate, -0.9 * rate_limit, 0.9 * rate_limit)
        if not low < angle + tape[k] * period < high:
            tape[k] = 0.0
        angle += tape[k] * period
    return tape


def _fly(
    model: GliderModel, plan: CampaignPlan, rng: np.random.Generator, name: str
) -> Flight:
    servo = model.parameters.servo
    rows = round(plan.duration * plan.capture.rate) + 1
    time = np.arange(rows) / plan.capture.rate
    switches = np.arange(int(plan.duration * plan.command_rate) + 1) / plan.command_rate
    commands = random_commands(len(switches), 1.0 / plan.command_rate, servo, rng)
    launch = np.asarray(plan.launch) + rng.normal(size=7) * plan.launch_spread
    flight = fly_commands(
        log_space_of(model),
        vector_of(model),
        launch,
        switches,
        commands,
        time,
        servo=servo,
        gaussians=model.gaussians,
        name=name,
    )
    return turn(measured(flight, plan.capture, rng), signs_of(model))


def measured(
    flight: Flight, capture: MotionCapture, rng: np.random.Generator
) -> Flight:
    """Returns a flight with the noise of its sensors."""
    pose = flight.pose + rng.normal(size=flight.pose.shape) * capture.std[:3]
    assert flight.elevator is not None
    elevator = flight.elevator + rng.normal(size=len(flight.time)) * capture.elevator
    return dataclasses.replace(flight, pose=pose, elevator=elevator)


def fly_commands(
    space: ParameterSpace,
    theta: np.ndarray,
    launch: np.ndarray,
    switches: np.ndarray,
    commands: np.ndarray,
    time: np.ndarray,
    *,
    servo: Servo,
    rest: float = 0.0,
    gaussians: Gaussians = NO_GAUSSIANS,
    fine: int = FINE,
    name: str = "flight",
) -> Flight:
    """Flies a launch under a tape of commands, and logs it without noise.

    Args:
        space: of theta.
        theta: the glider's numbers.
        launch: (7,) state at the first time; its elevator is where the tape has it.
        switches: (k,) when each command begins, the first at 0 [s].
        commands: (k,) elevator rates, each held until the next [rad/s].
        time: (n,) of the log's rows, from 0, equal steps [s].
        servo: limits of the servo.
        rest: where it stands before the first command [rad].
        gaussians: of the free functions.
        fine: integration steps between two rows.
        name: of the flight.
    """
    replay = space.replay(theta)
    path = functools.partial(
        replayed_path, replay, switches, commands, servo=servo, start=rest
    )
    rows = len(time)
    fine_rate = fine * (rows - 1) / time[-1]
    before = int(np.ceil(max(replay.latency, 0.0) * fine_rate))
    fine_times = np.arange(-before, (rows - 1) * fine + 1) / fine_rate
    here = path(fine_times)
    middle = path(0.5 * (fine_times[1:] + fine_times[:-1]))
    elevator = np.stack([here[:-1], middle, here[1:]], axis=1)
    rate = np.diff(here) * fine_rate
    states = fly_path(space, theta, launch, fine_times, elevator, rate, gaussians)
    shown = sensed(space, states, theta, gaussians)
    pose = np.stack(
        [np.interp(time - replay.latency, fine_times, c) for c in shown.T], axis=1
    )
    command = commands[latest_command(switches, time)]
    return Flight(name=name, time=time, pose=pose, elevator=path(time), command=command)


def fly_path(
    space: ParameterSpace,
    theta: np.ndarray,
    launch: np.ndarray,
    times: np.ndarray,
    elevator: np.ndarray,
    rate: np.ndarray,
    gaussians: Gaussians = NO_GAUSSIANS,
) -> np.ndarray:
    """Returns the states (n, space.num_states) along a path of the elevator.

    Times are (n,) [s], angles of the elevator (n - 1, 3) at the start, middle and end
    of each interval [rad], its rates (n - 1,) [rad/s]; the rest is as in
    `fly_commands`.
    """
    start = np.zeros(space.num_states)
    start[:7] = launch
    start[OFFSET] = elevator[0, 0]
    start[7:] = resting_states(space, times[0], start, rate[0], theta)
    start[OFFSET] = 0.0
    path = log_path(times, elevator, rate)
    return roll_out(space.flown, path, start, theta, gaussians)
