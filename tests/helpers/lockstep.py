"""A station and a simulated glider in one process, in a time that is not real."""

import dataclasses
import functools

from pydrake.lcm import DrakeLcm

from diagrams.programs.station.bus import COMMAND, Bus
from diagrams.programs.station.controllers import Guidance, make_guidance
from diagrams.programs.station.scenario import Scenario, Simulation
from diagrams.programs.station.session import Session
from diagrams.programs.station.simulated import SimulatedGlider
from diagrams.programs.station.station import Station

LATEST = 1e-3
"""Longest step of the time [s]."""


@functools.cache
def guidance_for(controller: str = "tvlqr") -> Guidance:
    """Plan and controller of the nominal glider, made once."""
    return make_guidance(Scenario(controller=controller))


class Plug(Bus):
    """One participant's end of the bus, which can be pulled."""

    def __init__(self, lcm):
        super().__init__(lcm)
        self.is_in = True

    def listen(self, channel, handler):
        super().listen(channel, lambda *args: handler(*args) if self.is_in else None)


class Lockstep:
    """Runs both by turns, as two processes would; the bus is shared."""

    def __init__(self, folder, simulation=None, controller_system=None, **changes):
        changes = {"simulation": simulation or Simulation(), **changes}
        self.scenario = dataclasses.replace(Scenario(), **changes)
        self.now = 100.0
        self.lcm = DrakeLcm("memq://")
        self.bus = Bus(self.lcm)
        self.commands = []  # Time and message of each.
        self.bus.listen(COMMAND, self._hear)
        self.guidance = (
            make_guidance(self.scenario, controller_system)
            if self.scenario.commands or controller_system
            else guidance_for(self.scenario.controller)
        )
        self.folder = folder
        self.lines, self.session = [], None
        self.start_station()
        self.start_glider()

    def start_glider(self):
        self.glider_bus = Plug(self.lcm)
        self.glider = SimulatedGlider(self.scenario, self.glider_bus, self.now)

    def start_station(self):
        if self.session is not None:
            self.session._lock.close()  # As when the process died.
        self.session = Session(
            self.folder, self.scenario, self.guidance, self.lines.append
        )
        self.station_bus = Plug(self.lcm)
        self.station = Station(
            self.scenario,
            self.guidance,
            self.station_bus,
            self.session,
            show=self.lines.append,
            clock=lambda: self.now,
            wait=lambda until: None,
        )

    def _hear(self, stamp, values, names):
        self.commands.append((self.now, *values))

    def run(self, until, longest=6.0):
        """Runs until a condition holds, or so many seconds; returns whether it does."""
        end = self.now + longest
        while not until() and self.now < end:
            self.now += LATEST
            if self.glider_bus.is_in:
                self.glider.advance(self.now)
            self.bus.handle()
            if self.station_bus.is_in:
                self.station.tick()
        return until()

    def run_into_flight(self, seconds):
        """Runs until the glider has flown so long; returns the time then."""
        assert self.run(lambda: 0.0 < self.now - self.glider.released < 1.0)
        self.run(lambda: self.now - self.glider.released >= seconds)
        assert self.station.state == "flying", self.station.reason
        return self.now

    def neutral_since(self, begin, end):
        """When commands began to turn the elevator to neutral, for good."""
        since = end
        for when, _, _, rate, _ in reversed(self.commands):
            if when <= end:
                if when < begin or rate == rate:  # NaN: to neutral.
                    break
                since = when
        return since

    def fly(self, throws=1):
        """Flies throws; returns them."""
        wanted = len(self.station.throws) + throws
        assert self.run(lambda: len(self.station.throws) >= wanted, 6.0 * throws), (
            self.station.state,
            self.station.reason,
        )
        return self.station.throws[-throws:]
