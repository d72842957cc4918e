"""A simulated glider on the bus: launcher, true model, servo and cameras.

    python -m diagrams.programs.station.simulated SCENARIO.yaml

A process of its own. The glider is thrown whenever the station is ready; it has the
effects of its model, of which the station knows nothing.
"""

import argparse
import dataclasses
import heapq
import math
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from diagrams.programs.program import run
from diagrams.programs.station.bus import (
    COMMAND,
    COMMAND_FIELDS,
    OPERATOR,
    POSE,
    POSE_FIELDS,
    STATUS,
    Bus,
)
from diagrams.programs.station.processes import end_with, hasten
from diagrams.programs.station.scenario import Scenario, Simulation, load_scenario
from diagrams.programs.station.wire import Wire
from glider.campaign.motion_capture import MotionCapture
from glider.compiled.flight import Steps, fly_batch, make_tape
from glider.errors import expect
from glider.physics.model import GliderModel
from glider.physics.state import ELEVATOR, POSITION, VELOCITY
from glider.planning.problem import PerchingProblem
from glider.simulation.fly import STEP

_REST = 0.35
"""Time at rest before a throw and after it [s]."""

_LATE = 1.5
"""Delay of a frame that comes after the next one, in frames."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Landing:
    """How a throw ended, in truth."""

    miss: float  #: Least distance from the wire [m].
    perched: bool  #: Whether the hook holds the glider.


class Cameras:
    """Frames with noise that come late, twice, or not at all.

    Args:
        rate: of the frames [Hz].
        settings: delays, losses and clock.
        rng: of noise, delays and losses.
    """

    def __init__(
        self, rate: float, settings: Simulation, rng: np.random.Generator
    ) -> None:
        self.rate = rate
        self._settings = settings
        self._rng = rng
        self._noise = MotionCapture(rate=rate)
        self._coming: list[tuple[float, int, float, tuple[float, ...]]] = []
        self._count = 0

    def see(self, now: float, shown: np.ndarray) -> np.ndarray:
        """Adds noise to what is shown (4,) at a time [s]."""
        return shown + self._noise.draw(self._rng)

    def expose(self, now: float, shown: np.ndarray) -> None:
        """Takes a frame of what is shown (4,) at a time [s]."""
        cameras = self._settings
        rng = self._rng
        self._count += 1
        seen = self.see(now, shown)
        if rng.random() < cameras.lost:
            return
        delay = cameras.latency + rng.exponential(cameras.jitter)
        if rng.random() < cameras.late:
            delay += _LATE / self.rate
        stamp = now * (1.0 + cameras.clock_drift) + cameras.clock_offset
        frame = (now + delay, self._count, stamp, tuple(seen.tolist()))
        heapq.heappush(self._coming, frame)
        if rng.random() < cameras.duplicated:
            heapq.heappush(self._coming, frame)

    @property
    def next(self) -> float:
        """When the next frame arrives [s]."""
        return self._coming[0][0] if self._coming else math.inf

    def send(self, bus: Bus, now: float) -> None:
        """Puts the frames that have arrived on the bus."""
        while self.next <= now:
            _, number, stamp, seen = heapq.heappop(self._coming)
            bus.say(POSE, stamp, (float(number), *seen), POSE_FIELDS)


class SimulatedGlider:
    """A glider that is thrown when the station is ready; `advance` is called by a loop.

    Args:
        scenario: with a simulation.
        bus: of the station.
        start: time at which it begins to exist [s].
    """

    def __init__(self, scenario: Scenario, bus: Bus, start: float) -> None:
        truth = scenario.truth
        settings = scenario.simulation
        assert truth is not None and settings is not None
        varies = truth.is_time_varying
        expect(not varies, "the simulated glider", settings.truth, "one without time")
        self._truth: GliderModel = truth
        self._settings = settings
        self._problem: PerchingProblem = scenario.load_problem()
        self._rng = np.random.default_rng(settings.seed)
        self._cameras = Cameras(scenario.sensors.rate, settings, self._rng)
        self._elevator = scenario.sensors.elevator
        servo = scenario.servo
        limits = truth.parameters.servo
        hold = scenario.command_step
        self._wire = Wire(limits, servo.neutral, servo.timeout, hold)
        self._coming: list[tuple[float, ...]] = []  # Commands, by when they act [s].
        self._bus = bus
        self._time = start
        self._frame = 0
        self._start = start
        self._ready = math.nan  # Since when the station is.
        self.released = math.inf  #: Time of the next release, or of the last [s].
        self._miss = math.inf
        self.landings: list[_Landing] = []
        self._place()
        self._advance_flight(2.0 * STEP, 0.0)  # Compiles.
        self._place()
        bus.listen(COMMAND, self._on_command)
        bus.listen(STATUS, self._on_status)
        bus.listen(OPERATOR, self._on_operator)

    def _place(self) -> None:
        """Puts the glider into the launcher."""
        launch = self._problem.draw_launches(1, self._rng)[0]
        speed = float(np.linalg.norm(launch[VELOCITY]))
        self._launch = launch
        self._state = self._truth.initial_state(launch)
        self._push = speed / self._settings.acceleration
        self.released = math.inf
        self._landed = math.inf
        self._miss = math.inf
        self._ready = math.nan

    def _on_command(
        self, stamp: float, values: Sequence[float], names: Sequence[str]
    ) -> None:
        if len(values) == len(COMMAND_FIELDS):
            # By its own clock, which is ours: a busy computer would deliver it late.
            acts = stamp + self._settings.servo_latency
            heapq.heappush(self._coming, (acts, values[0], *values[2:]))

    def _on_operator(
        self, stamp: float, values: Sequence[float], names: Sequence[str]
    ) -> None:
        self._wire.operate(values, names, self._time)

    def _on_status(
        self, stamp: float, values: Sequence[float], names: Sequence[str]
    ) -> None:
        is_ready = bool(len(values)) and names[0] == "ready"
        if not is_ready and self._time < self.released - self._push:
            self._ready = math.nan
            self.released = math.inf
        elif is_ready and math.isnan(self._ready):
            self._ready = self._time
            self.released = self._time + _REST + self._push

    def advance(self, now: float) -> float:
        """Moves everything on to a time; returns when the next frame comes [s]."""
        while (due := self._start + self._frame / self._cameras.rate) <= now:
            self._move(due)
            self._cameras.expose(due, self._show())
            self._frame += 1
        self._cameras.send(self._bus, now)
        return min(due, self._cameras.next)

    def _move(self, until: float) -> None:
        """Moves the glider on to a time [s], through the commands that come."""
        while self._coming and self._coming[0][0] <= until:
            when, sender, rate, angle = heapq.heappop(self._coming)
            self._move_held(max(when, self._time))
            self._wire.obey(sender, rate, when, angle)
        self._move_held(until)

    def _move_held(self, until: float) -> None:
        if self._time < self.released < until:
            self._move_held(self.released)
        before = self._wire.angle
        angle = self._wire.advance(until)
        span = until - self._time
        self._time = until
        if until <= self.released:
            self._state[ELEVATOR] = angle
        elif until < self._landed:
            held = self._wire.rate
            mean = (angle - before) / max(span, 1e-9)
            self._advance_flight(span, held if self._wire.holds(until) else mean)
        if until > self._landed + _REST:
            self._place()

    def _advance_flight(self, span: float, rate: float) -> None:
        """Flies for a while under a rate [rad/s] that is held."""
        if span <= 0.0:
            return
        count = max(math.ceil(span / STEP), 1)
        count *= self._truth.count_laps(span / count)
        steps = Steps(count, span / count, every=count)
        tape = make_tape(np.array([[rate]]), count)
        wire = self._problem.wire
        flown = fly_batch(self._truth, self._state[None], steps, tape, wire=wire)
        misses = flown.miss
        arrivals = flown.arrivals
        miss = float(misses[0])
        before = self._state
        self._state = flown.states[0, -1].copy()
        away = np.array(wire) - self._state[POSITION]
        passes = away @ self._state[VELOCITY] <= 0.0
        self._miss = min(self._miss, miss)
        taken = False
        if passes and miss <= self._miss:
            taken = bool(self._problem.hook.takes(misses, arrivals)[0])
        low = self._state[POSITION[1]] < self._problem.z_limits[0]
        if not (taken or low or self._time > self.released + 2.0):
            return
        self.landings.append(_Landing(miss=self._miss, perched=taken))
        self._state = arrivals[0].copy() if taken else before
        self._landed = self._time

    def _show(self) -> np.ndarray:
        """What perfect cameras show (4,) now: x, z, pitch and elevator."""
        state = self._state.copy()
        left = self.released - self._time
        if left >= 0.0:
            pushed = self._push - min(left, self._push)
            # From rest to the launch's velocity at a constant acceleration.
            ran = 0.5 * pushed**2 / self._push - 0.5 * self._push
            moved = self._launch[VELOCITY] * ran
            state[POSITION] = self._launch[POSITION] + moved
        pose = self._truth.chain.measure(state, self._truth.numbers)
        angle = math.nan
        if self._elevator:
            angle = state[ELEVATOR]
        return np.array([*pose, angle])


def main(arguments: Sequence[str] | None = None) -> None:
    """Runs a simulated glider until it is ended."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenario", type=Path, help="scenario with a simulation")
    words = "process that it ends with (default: none)"
    parser.add_argument("--parent", type=int, metavar="PID", help=words)
    args = parser.parse_args(arguments)
    if args.parent is not None:
        end_with(args.parent)
    scenario = load_scenario(args.scenario)
    bus = Bus(scenario.address)
    glider = SimulatedGlider(scenario, bus, time.monotonic())
    hasten()
    while args.parent in (None, os.getppid()):
        now = time.monotonic()
        bus.handle()  # Of what was sent until now all comes before it moves on.
        bus.rest_until(glider.advance(now))


if __name__ == "__main__":
    sys.exit(run(main))
