"""A station and a simulated glider in one process, in a time that is not real."""

import dataclasses
import functools

from pydrake.lcm import DrakeLcm

from diagrams.station.bus import COMMAND, Bus
from diagrams.station.controllers import Guidance, make_guidance
from diagrams.station.scenario import Scenario, Simulation
from diagrams.station.session import Session
from diagrams.station.simulated import SimulatedGlider
from diagrams.station.station import Station

LATEST = 1e-3
"""Longest step of the time [s]."""


@functools.cache
def guidance_for(controller: str = "tvlqr") -> Guidance:
    """Plan and controller of the nominal glider, made once."""
    return make_guidance(Scenario(controller=controller))


class Lockstep:
    """Runs both by turns, as two processes would; the bus is shared."""

    def __init__(self, folder, simulation=None, **changes):
        changes = {"simulation": simulation or Simulation(), **changes}
        self.scenario = dataclasses.replace(Scenario(), **changes)
        self.now = 100.0
        self.bus = Bus(DrakeLcm("memq://"))
        self.commands = []  # Time and message of each.
        self.bus.listen(COMMAND, self._hear)
        self.guidance = guidance_for(self.scenario.controller)
        self.session = Session(folder, self.scenario, self.guidance)
        self.lines = []
        self.station = self.make_station()
        self.glider = SimulatedGlider(self.scenario, self.bus, self.now)
        self.has_glider = self.has_station = True

    def make_station(self):
        return Station(
            self.scenario,
            self.guidance,
            self.bus,
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
            if self.has_glider:
                self.glider.advance(self.now)
            self.bus.handle()
            if self.has_station:
                self.station.tick()
        return until()

    def fly(self, throws=1):
        """Flies throws; returns them."""
        wanted = len(self.station.throws) + throws
        assert self.run(lambda: len(self.station.throws) >= wanted, 6.0 * throws), (
            self.station.state,
            self.station.reason,
        )
        return self.station.throws[-throws:]
