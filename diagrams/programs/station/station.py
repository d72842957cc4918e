"""The station: from poses on a bus to commands on it, throw after throw.

waiting -> ready -> flying -> waiting        a throw
                    flying -> stopped -> waiting   where something is not right

It waits until the glider rests, is ready until poses show free flight, and flies until
the glider passes the wire or the plan is over. Whatever is not right stops the flight:
the elevator goes to neutral at once, and stays there; the record goes on.
"""

import gc
import math
import time
from collections.abc import Callable, Sequence

import numpy as np

from diagrams.programs.station.autopilot import Autopilot
from diagrams.programs.station.bus import (
    COMMAND,
    COMMAND_FIELDS,
    POSE,
    POSE_FIELDS,
    STATUS,
    Bus,
)
from diagrams.programs.station.clocks import CameraClock
from diagrams.programs.station.controllers import Guidance
from diagrams.programs.station.operators import ARM, REPEAT, Operator
from diagrams.programs.station.safety import WaitReasons, Watch
from diagrams.programs.station.scenario import Scenario
from diagrams.programs.station.sender import Sender
from diagrams.programs.station.session import Session
from diagrams.programs.station.throw import Throw
from diagrams.programs.station.tracker import CommandTape, ReleaseDetector
from glider.physics.state import ELEVATOR, POSITION, VELOCITY
from glider.simulation.fly import AFTER

_WAITING = "waiting"
READY = "ready"
_FLYING = "flying"
STOPPED = "stopped"

_STATUS_PERIOD = REPEAT
"""Time between two messages of the state [s]."""

_RETRY = 1.0
"""Time after which a record is tried again [s]."""

_NEAR = 0.5
"""Distance within which a pass of the wire ends a flight [m]."""


class Station:
    """Turns poses into commands; `on_pose` and `tick` are called by a loop.

    Args:
        scenario: the session.
        guidance: plan and controller.
        bus: that poses come from and commands go to.
        session: folder of the records.
        show: is given each line for the operator.
        clock: ours [s].
        wait: waits until a time of this clock; None: sleeps.
    """

    def __init__(
        self,
        scenario: Scenario,
        guidance: Guidance,
        bus: Bus,
        session: Session,
        *,
        show: Callable[[str], object] = print,
        clock: Callable[[], float] = time.monotonic,
        wait: Callable[[float], object] | None = None,
    ) -> None:
        self.scenario = scenario
        self.guidance = guidance
        self.bus = bus
        self._show = show
        self._clock = clock
        sensors = scenario.sensors
        self._session = session
        self._camera = CameraClock(sensors.latency)
        tape = CommandTape()
        self._autopilot = Autopilot(guidance.autopilot, tape)
        launch = np.array(guidance.problem.launch)[POSITION]
        self._release = ReleaseDetector(scenario.release, launch)
        limits = guidance.model.parameters.servo
        self._operator = Operator(bus, clock)
        self._was_killed = False
        own = self._operator.id
        self._sender = Sender(scenario, limits, own, bus, tape, clock, wait)
        self._watch = Watch(scenario.limits, limits, self._operator)
        self.state = _WAITING
        self.reason = "no pose yet"
        self.throws: list[Throw] = []
        self._throw = Throw(guidance.problem)
        # Of the last usable pose.
        self._handled = -math.inf
        self._received = -math.inf
        self._status = -math.inf
        self._retry = -math.inf
        self._waits = WaitReasons()
        self._passed = False
        self._warm_up()
        bus.listen(POSE, self.on_pose)
        bus.listen(COMMAND, self.on_command)

    def _warm_up(self) -> None:
        """Runs whatever flies once, so that nothing is compiled in flight."""
        plan = self.guidance.plan
        first = plan.states[0]
        self._autopilot.start(0.0, self.guidance.nearest(first), first)
        for k in (1, 2):
            self._autopilot.take_pose(0.01 * k, plan.states[k][:4])
        self._autopilot.command(0.03)
        warm = Throw(self.guidance.problem)
        for k in range(3):
            warm.add_state(0.01 * k, plan.states[k])
        warm.describe()
        # What is there stays: to look through it before each throw takes so long that
        # the last pose is stale then.
        gc.collect()
        gc.freeze()

    @property
    def in_flight(self) -> bool:
        """Whether a throw is in the air."""
        return self.state in (_FLYING, STOPPED)

    # ------------------------------------------------------------------ messages

    def on_pose(
        self, stamp: float, values: Sequence[float], names: Sequence[str]
    ) -> None:
        """Takes a frame of the cameras."""
        if len(values) != len(POSE_FIELDS):
            self._watch.reason = f"a pose of {len(values)} numbers"
            return
        received = self._clock()
        pose = np.array(values[1:])
        when = self._camera.to_ours(stamp, received)
        lead = self._camera.calc_lead(when, received)
        fault = self._watch.check_pose(when, pose, lead)
        is_flight = self.in_flight
        if not fault:
            self._camera.learn(stamp, received)
            if self.state == _FLYING:
                self._follow(when, pose)
            elif not is_flight:
                is_flight = self._wait_for_release(when, pose)
            self._received = received
            self._handled = self._clock()
        if is_flight or (self.state == READY and self._release.pushed):
            fields = dict(zip(POSE_FIELDS, values, strict=True))
            self._session.add(
                "/pose",
                received,
                stamp=stamp,
                received=received,
                time=when,
                **fields,
                fault=fault,
                free=is_flight and self.state == _FLYING,
                shows_elevator=math.isfinite(pose[ELEVATOR]),
            )

    def on_command(
        self, stamp: float, values: Sequence[float], names: Sequence[str]
    ) -> None:
        """Hears commands: all should be our own."""
        if len(values) == len(COMMAND_FIELDS) and values[0] != self._sender.id:
            self._watch.rival = self._clock()

    def operate(self, name: str) -> None:
        """Kills or arms for the operator of this station, here and on the bus."""
        self._operator.say(name)
        if name == ARM and self._operator.kills:
            self._show("not armed: another operator stopped it")

    # --------------------------------------------------------------------- states

    def tick(self) -> float:
        """Does what is due; returns when to call again, at the latest [s]."""
        now = self._clock()
        sender = self._sender
        fault = self._watch.find_fault(now)
        self._operator.repeat()
        is_killed = bool(self._operator.kills)
        if self._was_killed and not is_killed:
            self._show("armed again")
        self._was_killed = is_killed
        if not fault and self.state != _WAITING:
            fault = self._session.fault
        if fault:
            if self.state == _FLYING:
                self._stop(fault)
            elif self.state != STOPPED:
                self._enter(_WAITING, fault)
        elif self.state == _WAITING and not self._release.rests:
            self._enter(_WAITING, "the glider does not rest")
        elif self.state == _WAITING and now > self._retry:
            self._make_ready()
        if self.state == _FLYING:
            if now >= sender.due - self.guidance.lead:
                self._command()
        elif now >= sender.due:
            self._send(math.nan)
        duration = self.guidance.plan.duration + AFTER
        is_over = self._passed or now > self._autopilot.begin + duration
        if self.in_flight and is_over:
            self._finish()
        if now > self._status + _STATUS_PERIOD:
            self._send_status()
        if self.state == _WAITING and self._waits.is_to_be_shown(self.reason, now):
            self._show(f"waiting: {self.reason}")
        self._session.write()
        if self._session.fault and self.state == _FLYING:
            self._stop(self._session.fault)
        due = sender.due
        if self.state == _FLYING:
            due -= self.guidance.lead
        stale = self._watch.seen + self.scenario.limits.stale
        if stale > now:
            due = min(due, stale)
        return due

    def _make_ready(self) -> None:
        """Opens the record and arms; without room for a record there is no throw."""
        fault = ""
        needs_elevator = self.scenario.sensors.elevator
        if needs_elevator and not self._release.shows_elevator:
            fault = "the elevator is not seen ('sensors: {elevator: false}' does so)"
        elif not self._session.open():
            fault = self._session.fault
        if fault:
            self._retry = self._clock() + _RETRY
            self._enter(_WAITING, fault)
        else:
            self._release.pushed = False
            self._enter(READY, "")

    def _wait_for_release(self, when: float, pose: np.ndarray) -> bool:
        """Takes a pose in the hand; returns whether free flight has begun."""
        if not self._release.add(when, pose) or self.state != READY:
            return False
        start = self._release.state
        if not math.isfinite(start[ELEVATOR]):
            start[ELEVATOR] = self._sender.angle
        state = self.guidance.model.initial_state(start)
        elapsed = self.guidance.nearest(state)
        self._autopilot.start(when, elapsed, state)
        self._throw = Throw(self.guidance.problem)
        self._throw.add_state(when, state)
        self._sender.due = self._clock() + self.guidance.lead
        self._enter(_FLYING, f"free at {elapsed:.3f} s of the plan")
        planned = self.guidance.state_at(elapsed)
        fault = self._release.find_fault(start, planned)
        if fault:
            self._stop(fault)
        return True

    def _follow(self, when: float, pose: np.ndarray) -> None:
        """Takes a pose in flight."""
        self._autopilot.take_pose(when, pose)
        state = self._autopilot.read("estimate")
        nis, distance, turned = self._autopilot.read("surprise").tolist()
        self._watch.count_pose(distance, turned)
        self._throw.add_state(when, state)
        self._session.add("/estimate", when, time=when, state=state.tolist(), nis=nis)
        away = np.array(self.guidance.problem.wire) - state[POSITION]
        is_leaving = away @ state[VELOCITY] <= 0.0
        self._passed = is_leaving and math.hypot(*away) < _NEAR
        if self.scenario.command_rate is None:
            self._sender.due = self._clock()

    def _command(self) -> None:
        """Computes a command for the time at which it will act, and sends it."""
        began = self._clock()
        sender = self._sender
        due = sender.due
        acts = max(due, began) + self.scenario.servo.latency
        rate = self._autopilot.command(acts)
        ready = self._clock()
        if not math.isfinite(rate):
            self._stop("the controller gave no number")
            return
        if ready < due:
            sender.wait_until_due()
        sent = self._clock()
        late = self._watch.count_command(sent - due)
        waited = max(began - self._handled, 0.0)
        waited += max(sent - ready, 0.0)
        given = self._send(rate, asked=rate, late=late)
        latency = given - self._received - waited
        self._throw.add_command(latency, late)

    def _send(self, rate: float, **more: object) -> float:
        """Sends a rate [rad/s], or NaN: to neutral; returns when it was on the bus."""
        command = self._sender.send(rate)
        if self.in_flight:
            more["received"] = self._received
            self._session.add("/command", command["sent"], **command, **more)
        return command["given"]

    def _stop(self, reason: str) -> None:
        """Sends the elevator to neutral, now, and for the rest of the throw."""
        self._send(math.nan)
        self._throw.reason = reason
        self._throw.stopped = self._clock() - self._autopilot.begin
        self._enter(STOPPED, reason)

    def _finish(self) -> None:
        """Ends a throw, its record too, and waits for the next one."""
        self._send(math.nan)
        throw = self._throw
        self.throws = [*self.throws, self._throw]
        self._release.reset()
        self._watch.reset()
        self._passed = False
        self._enter(_WAITING, "the glider does not rest")
        self._session.finish(throw, self._clock())
        self._show(f"throw {len(self.throws)}: {throw.describe()}")

    def _enter(self, state: str, reason: str) -> None:
        """Changes the state, and says so on the bus and in the record."""
        if (state, reason) == (self.state, self.reason):
            return
        if state == READY:  # No garbage is collected in flight.
            gc.collect()
            gc.disable()
        elif state == _WAITING:
            gc.enable()
        now = self._clock()
        is_new = state != self.state
        self.state = state
        self.reason = reason
        if is_new:
            self._waits = WaitReasons()
        if state == READY and is_new and self.scenario.simulation is None:
            self._show("ready: throw now")
        if is_new or now > self._status + _STATUS_PERIOD:
            self._session.add("/event", now, state=state, reason=reason)
            self._send_status()

    def _send_status(self) -> None:
        now = self._clock()
        self._status = now
        is_ready = float(self.state == READY)
        numbers = len(self.throws), is_ready
        words = self.state, self.reason
        self.bus.say(STATUS, now, numbers, words)

    def close(self) -> None:
        """Ends a throw, or a record that holds none; the elevator goes to neutral."""
        if self.state == _FLYING:
            self._stop("the station was ended")
        if self.in_flight:
            self._finish()
        self._send(math.nan)
        self._enter(_WAITING, "the station was ended")
        gc.unfreeze()
        self._session.close()
