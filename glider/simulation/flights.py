"""Simulated flights, and what became of them."""

import dataclasses

import numpy as np

from glider.campaign.logs import Flight
from glider.physics.actuator_replay import latest_command
from glider.simulation.miss import PERCH_RADIUS


@dataclasses.dataclass(frozen=True, kw_only=True)
class FlownFlight:
    """One flight of a simulated glider."""

    times: np.ndarray
    """(K,) of the integrator's steps [s]."""

    states: np.ndarray
    """(K, n) of the glider."""

    rates: np.ndarray
    """(K,) elevator rate that the servo gives the glider [rad/s]."""

    miss: float
    """Least distance of the center of mass from the wire [m]."""

    forces: np.ndarray | None = None
    """(K, 2) of wing and elevator along their normals [N], if they were asked for."""

    log: Flight | None = None
    """Log of motion capture and of the commands, where there is one."""

    @property
    def perched(self) -> bool:
        """Whether the wire was within reach."""
        return self.miss < PERCH_RADIUS


@dataclasses.dataclass(frozen=True, kw_only=True)
class Flights:
    """Many flights of one glider under one policy, over the same time."""

    times: np.ndarray
    """(N + 1,) of the steps [s]."""

    miss: np.ndarray
    """(B,) least distance of the center of mass from the wire [m]."""

    ends: np.ndarray
    """(B, n) the last states."""

    paths: np.ndarray | None = None
    """(B, N + 1, n) all states, if they were asked for."""

    command_times: np.ndarray | None = None
    """(H,) when each command began [s], where commands are held."""

    commands: np.ndarray | None = None
    """(B, H) elevator rates that the servo made of them [rad/s], with paths."""

    @property
    def perched(self) -> np.ndarray:
        """(B,) whether the wire was within reach."""
        return self.miss < PERCH_RADIUS

    def flight(self, b: int) -> FlownFlight:
        """Returns one of them; the paths must be there, and commands that were held."""
        if self.paths is None or self.commands is None or self.command_times is None:
            raise ValueError("flights with paths and held commands are needed")
        latest = latest_command(self.command_times, self.times)
        return FlownFlight(
            times=self.times,
            states=self.paths[b],
            rates=self.commands[b, latest],
            miss=float(self.miss[b]),
        )

    def __len__(self) -> int:
        """Returns how many there are."""
        return len(self.miss)
