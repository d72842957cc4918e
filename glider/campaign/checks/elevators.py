"""What logs show of elevators and their commands, without the masked rows."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from glider.campaign.checks.masks import Masks, masks_of
from glider.campaign.logs import Campaign
from glider.physics.servo import NO_LIMITS, Servo, elevator_path

_WINDOW = 0.04  # Time over which a rate is taken [s].


class Elevator(NamedTuple):
    """The elevator of one flight, and the commands that are known.

    Where gaps hide commands, both are those of one piece of the flight.
    """

    name: str  #: Of the flight.
    time: np.ndarray  #: (k,) of the angles [s].
    angle: np.ndarray  #: (k,) [rad]
    command_time: np.ndarray  #: (n,) of the commands; each row has a new one [s].
    command: np.ndarray  #: (n,) [rad/s]

    @property
    def ordered_travel(self) -> float:
        """Travel that the commands ask for [rad]."""
        return travel_of(self.follow(self.command_time))

    def follow(
        self, query: np.ndarray, servo: Servo = NO_LIMITS, lag: float = 0.0
    ) -> np.ndarray:
        """Angles of a servo with a lag [s] behind the commands, at any times [rad]."""
        tape = self.command_time, self.command
        start = float(self.angle[0]) if len(self.angle) else 0.0
        return elevator_path(*tape, query, servo, time_constant=lag, start=start)


def measure_elevators(
    campaign: Campaign, masks: Mapping[str, Masks]
) -> tuple[Elevator, ...]:
    """Elevators of a campaign's flights; none without a servo."""
    elevators = []
    for flight in campaign.flights if campaign.elevator == "servo" else ():
        assert flight.elevator is not None and flight.command is not None
        mask = masks_of(flight, masks)
        rows = ~(mask.elevator | mask.beyond)
        piece = slice(mask.first, mask.last)
        angles = flight.time[rows], flight.elevator[rows]
        commands = flight.time[piece], flight.command[piece]
        elevators.append(Elevator(flight.name, *angles, *commands))
    return tuple(elevators)


def travel_of(angles: np.ndarray) -> float:
    """Range of angles (k,) [rad]; 0 without any."""
    return float(np.ptp(angles)) if len(angles) else 0.0


def mean_rates(
    time: np.ndarray, angle: np.ndarray, window: float = _WINDOW
) -> tuple[np.ndarray, np.ndarray]:
    """Ends (2, k) of windows [s] in a log (n,), and by how much the angle changes."""
    begin = np.arange(time[0], time[-1] - window, 0.5 * _WINDOW)
    ends = np.stack([begin, begin + window])
    return ends, np.diff(np.interp(ends, time, angle), axis=0)[0]
