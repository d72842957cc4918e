"""Noise of a campaign's channels, and what smooths them."""

import dataclasses
from collections.abc import Mapping

import numpy as np

from glider.campaign.checks.masks import Masks
from glider.campaign.logs import Campaign, Flight
from glider.physics.actuator_replay import command_steps, elevator_path
from glider.sysid.replay.smoothing import Smoothing, estimate_noise


@dataclasses.dataclass(frozen=True, kw_only=True)
class Noise:
    """Standard deviation of the measurements, and what smooths them.

    Attributes:
        position: of x and z [m].
        pitch: [rad].
        elevator: [rad]; 0 without a servo.
        smoothing: of the channels x, z, pitch.
    """

    position: float
    pitch: float
    elevator: float
    smoothing: tuple[Smoothing, ...]


def measure_noise(
    campaign: Campaign, masks: Mapping[str, Masks] | None = None
) -> Noise:
    """Finds the noise of a campaign's channels from all its flights.

    Args:
        campaign: the flights.
        masks: name of a flight to its rows that are set aside; none by default.
    """
    masks = masks or {}
    usable = [
        masks[f.name].usable if f.name in masks else np.ones(len(f.time), dtype=bool)
        for f in campaign.flights
    ]
    times = [f.time[u] for f, u in zip(campaign.flights, usable, strict=True)]
    poses = [f.pose[u] for f, u in zip(campaign.flights, usable, strict=True)]
    smoothing = estimate_noise(times, poses)
    position = float(np.sqrt(np.mean([s.noise**2 for s in smoothing[:2]])))
    elevator = 0.0
    if campaign.elevator == "servo":
        turned = [
            ~masks[f.name].elevator
            if f.name in masks
            else np.ones(len(f.time), dtype=bool)
            for f in campaign.flights
        ]
        pairs = [
            (f, u)
            for f, u in zip(campaign.flights, turned, strict=True)
            if np.count_nonzero(u) >= _FEWEST_ROWS
        ]
        times = [f.time[u] for f, u in pairs]
        errors = [_elevator_error(f, campaign.command_rate)[u] for f, u in pairs]
        if pairs:
            elevator = estimate_noise(times, [e[:, None] for e in errors])[0].noise
    return Noise(
        position=max(position, _LEAST_POSITION),
        pitch=max(smoothing[2].noise, _LEAST_ANGLE),
        elevator=max(elevator, _LEAST_ANGLE),
        smoothing=smoothing,
    )


_FEWEST_ROWS = 10
"""Rows of an elevator below which a flight shows nothing of its noise."""

_LEAST_POSITION = 1e-6
_LEAST_ANGLE = 1e-5
"""Least noise of a log [m, rad]; a computed column has no noise at all."""


def _elevator_error(flight: Flight, command_rate: float | None) -> np.ndarray:
    """Logged elevator minus the integrated commands [rad]."""
    assert flight.command is not None and flight.elevator is not None
    switches, commands = command_steps(flight.time, flight.command, command_rate)
    return flight.elevator - elevator_path(switches, commands, flight.time)
