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

from diagrams.station.bus import (
    COMMAND,
    COMMAND_FIELDS,
    OPERATOR,
    POSE,
    POSE_FIELDS,
    STATUS,
    Bus,
)
from diagrams.station.clocks import CameraClock
from diagrams.station.controllers import Guidance
from diagrams.station.safety import Watch
from diagrams.station.scenario import Scenario
from diagrams.station.session import Session
from diagrams.station.throw import Throw
from diagrams.station.throw_log import ThrowLog
from diagrams.station.tracker import ReleaseDetector, Tracker
from diagrams.station.wire import Wire
from glider.physics.state import POSITION, VELOCITY
from glider.simulation.fly import AFTER

WAITING, READY, FLYING, STOPPED = "waiting", "ready", "flying", "stopped"

STATUS_PERIOD = 0.2
"""Time between two messages of the state [s]."""

PATIENCE = 2.0
"""Time of waiting after which the operator is shown why [s]."""

NEAR = 0.5
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
        wait: waits until a time of this clock.
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
        self.scenario, self.guidance, self.bus = scenario, guidance, bus
        self.session, self._show, self._clock = session, show, clock
        self._wait = wait or (lambda until: _wait(until, clock))
        sensors, servo = scenario.sensors, scenario.servo
        rate = scenario.command_rate or sensors.rate
        self._period = 1.0 / rate
        self._camera = CameraClock(sensors.latency)
        self._watch = Watch(scenario.limits)
        self._tracker = Tracker(guidance.model, sensors)
        launch = np.array(guidance.problem.launch)[POSITION]
        self._release = ReleaseDetector(**vars(scenario.release), launch=launch)
        self._wire = Wire(
            guidance.model.parameters.servo,
            servo.neutral,
            servo.timeout,
            hold=self._period,
        )
        self._sender = float(np.random.default_rng().integers(1 << 48))
        self.state, self.reason = WAITING, "no pose yet"
        self.throws: list[Throw] = []
        self._throw = Throw(guidance.problem)
        self._log: ThrowLog | None = None
        self._begin = self._due = 0.0  # Time 0 of the plan, and of the next command.
        self._handled = self._received = -math.inf  # Of the last usable pose.
        self._given = -math.inf  # When the last command was on the bus.
        self._status = self._retry = -math.inf
        self._since = clock()  # When this state began.
        self._is_hinted = self._passed = False
        self._number = 0  # Of the last command.
        self._warm_up()
        bus.listen(POSE, self.on_pose)
        bus.listen(COMMAND, self.on_command)
        bus.listen(OPERATOR, self.on_operator)

    def _warm_up(self) -> None:
        """Runs whatever flies once, so that nothing is compiled in flight."""
        plan = self.guidance.plan
        self._tracker.start(0.0, plan.states[0][:7])
        for k in (1, 2):
            self._tracker.update(0.01 * k, plan.states[k][:4])
        state = self._tracker.predict(0.03)
        controller = self.guidance.controller
        controller.start(self.guidance.nearest(state))
        controller.command(0.03, state)
        warm = Throw(self.guidance.problem)
        for k in range(3):
            warm.add_state(0.01 * k, plan.states[k])
        warm.describe()

    @property
    def in_flight(self) -> bool:
        """Whether a throw is in the air."""
        return self.state in (FLYING, STOPPED)

    # ------------------------------------------------------------------ messages

    def on_pose(
        self, stamp: float, values: Sequence[float], names: Sequence[str]
    ) -> None:
        """Takes a frame of the cameras."""
        if len(values) != len(POSE_FIELDS):
            return
        received = self._clock()
        pose = np.array(values[1:])
        when = self._camera.to_ours(stamp, received)
        fault = self._watch.check.find_fault(when, pose)
        is_flight = self.in_flight
        if not fault:
            self._watch.seen = received
            if self.state == FLYING:
                self._follow(when, pose)
            elif not is_flight:
                is_flight = self._wait_for_release(when, pose)
            self._received, self._handled = received, self._clock()
        if is_flight or (self.state == READY and self._release.pushed):
            self._record(
                "/pose",
                received,
                stamp=stamp,
                received=received,
                time=when,
                **dict(zip(POSE_FIELDS, values, strict=True)),
                fault=fault,
                free=is_flight and self.state == FLYING,
            )

    def on_command(
        self, stamp: float, values: Sequence[float], names: Sequence[str]
    ) -> None:
        """Hears commands: all should be our own."""
        if len(values) == len(COMMAND_FIELDS) and values[0] != self._sender:
            self._watch.rival = self._clock()

    def on_operator(
        self, stamp: float, values: Sequence[float], names: Sequence[str]
    ) -> None:
        """Takes "kill" or "arm", from the keyboard or the bus."""
        if "kill" in names:
            self._watch.locked = "the operator stopped it"
        elif "arm" in names:
            self._watch.locked = ""

    # --------------------------------------------------------------------- states

    def tick(self) -> float:
        """Does what is due; returns when to call again, at the latest [s]."""
        now = self._clock()
        if fault := self._watch.find_fault(now):
            if self.state == FLYING:
                self._stop(fault)
            elif self.state != STOPPED:
                self._enter(WAITING, fault)
        elif self.state == WAITING and self._release.rests and now > self._retry:
            self._make_ready()
        if self.state == FLYING:
            if now >= self._due - self.guidance.controller.lead:
                self._command()
        elif now >= self._due:
            self._send(self._wire.to_neutral(now), now)
        over = self._begin + self.guidance.plan.duration + AFTER
        if self.in_flight and (self._passed or now > over):
            self._finish()
        if now > self._status + STATUS_PERIOD:
            self._send_status()
        is_long = self.state == WAITING and now > self._since + PATIENCE
        if is_long and not self._is_hinted:
            self._is_hinted = True
            self._show(f"waiting: {self.reason}")
        lead = self.guidance.controller.lead if self.state == FLYING else 0.0
        stale = self._watch.seen + self.scenario.limits.stale
        return min(self._due - lead, stale) if stale > now else self._due - lead

    def _make_ready(self) -> None:
        """Opens the record and arms; without room for a record there is no throw."""
        now = self._clock()
        try:
            self._log = self._log or self.session.new_log()
        except OSError as error:
            self._retry = now + 1.0
            self._enter(WAITING, f"no record can be written: {error.strerror}")
            return
        gc.collect()
        gc.freeze()
        gc.disable()
        self._release.pushed = False
        self._enter(READY, "")

    def _wait_for_release(self, when: float, pose: np.ndarray) -> bool:
        """Takes a pose in the hand; returns whether free flight has begun."""
        if not self._release.add(when, pose) or self.state != READY:
            return False
        self._tracker.start(when, self._release.poses.state)
        elapsed = self.guidance.nearest(self._tracker.mean)
        self.guidance.controller.start(elapsed)
        self._throw = Throw(self.guidance.problem)
        self._throw.add_state(when, self._tracker.mean)
        self._begin = when - elapsed
        self._due = self._clock()
        self._enter(FLYING, f"free at {elapsed:.3f} s of the plan")
        return True

    def _follow(self, when: float, pose: np.ndarray) -> None:
        """Takes a pose in flight."""
        tracker = self._tracker
        tracker.update(when, pose)
        self._watch.count_pose(tracker.distance, tracker.turned)
        state = tracker.mean
        self._throw.add_state(when, state)
        self._record(
            "/estimate", when, time=when, state=state.tolist(), nis=tracker.nis
        )
        away = np.array(self.guidance.problem.wire) - state[POSITION]
        self._passed = away @ state[VELOCITY] <= 0.0 and math.hypot(*away) < NEAR
        if self.scenario.command_rate is None:
            self._due = self._clock()

    def _command(self) -> None:
        """Computes a command for the time at which it will act, and sends it."""
        began, servo = self._clock(), self.scenario.servo
        acts = max(self._due, began) + servo.latency
        state = self._tracker.predict(acts)
        rate = self.guidance.controller.command(acts - self._begin, state)
        ready = self._clock()
        if not math.isfinite(rate):
            self._stop("the controller gave no number")
            return
        if ready < self._due:
            self._wait(self._due)
        sent = self._clock()
        late = self._watch.count_command(sent - self._due)
        waited = max(began - self._handled, 0.0) + max(sent - ready, 0.0)
        self._send(self._wire.command(rate, sent), sent, asked=rate, late=late)
        self._throw.add_command(self._given - self._received - waited, late)

    def _send(self, rate: float, now: float, **more: object) -> None:
        """Puts a rate [rad/s] on the bus, and in flight into the record."""
        self._number += 1
        angle, acts = self._wire.angle, now + self.scenario.servo.latency
        self.bus.say(
            COMMAND, now, (self._sender, self._number, rate, angle), COMMAND_FIELDS
        )
        self._given = self._clock()
        self._tracker.tape.add(acts, rate)
        step = self._period * (1.0 if self.scenario.command_rate else 1.5)
        self._due = self._due + step if self._due + step > now else now + step
        if self.in_flight:
            times = {"sent": now, "acts": acts, "received": self._received}
            self._record("/command", now, **times, rate=rate, angle=angle, **more)

    def _stop(self, reason: str) -> None:
        """Sends the elevator to neutral, now, and for the rest of the throw."""
        now = self._clock()
        self._send(self._wire.to_neutral(now), now)
        self._throw.reason, self._throw.stopped = reason, now - self._begin
        self._enter(STOPPED, reason)

    def _finish(self) -> None:
        """Ends the record of a throw, and makes it a flight."""
        now = self._clock()
        self._send(self._wire.to_neutral(now), now)
        throw, self.throws = self._throw, [*self.throws, self._throw]
        self._release.reset()
        self._watch.reset()
        self._passed = False
        self._enter(WAITING, "the glider does not rest")
        gc.enable()
        gc.unfreeze()
        log, self._log = self._log, None
        if log is not None:
            try:
                log.add("/event", now, state="result", **throw.key_figures())
                log.close()
                throw.file = self.session.save(log.path)
            except OSError as error:
                words = f"its record ends early: {error.strerror}"
                throw.reason = throw.reason or words
        self._show(f"throw {len(self.throws)}: {throw.describe()}")

    def _enter(self, state: str, reason: str) -> None:
        """Changes the state, and says so on the bus and in the record."""
        if (state, reason) == (self.state, self.reason):
            return
        now, is_new = self._clock(), state != self.state
        self.state, self.reason = state, reason
        if is_new:
            self._since, self._is_hinted = now, False
        if is_new or now > self._status + STATUS_PERIOD:
            self._record("/event", now, state=state, reason=reason)
            self._send_status()

    def _send_status(self) -> None:
        now = self._status = self._clock()
        numbers = len(self.throws), float(self.state == READY)
        self.bus.say(STATUS, now, numbers, (self.state, self.reason))

    def _record(self, topic: str, when: float, **values: object) -> None:
        """Appends to the record; where that fails the throw stops, not the station."""
        if self._log is None:
            return
        try:
            self._log.add(topic, when, **values)
        except OSError as error:
            self._log.abandon()
            self._log = None
            if self.state == FLYING:
                self._stop(f"the record cannot be written: {error.strerror}")

    def close(self) -> None:
        """Ends a throw, or a record that holds none."""
        if self.state == FLYING:
            self._stop("the station was ended")
        if self.in_flight:
            self._finish()
        if self._log is not None:
            self._log.close()
            self._log.path.unlink()
            self._log = None


def _wait(until: float, clock: Callable[[], float]) -> None:
    """Sleeps until a time of a clock."""
    time.sleep(max(until - clock(), 0.0))
