"""Angles that were logged with the other sign, turned back.

The effect ANGLE_SIGN of a model says which signs its logs have.
"""

import dataclasses

import numpy as np

from glider.campaign.logs import Campaign, Flight
from glider.physics.effects import ANGLE_SIGN, Effect
from glider.physics.model import GliderModel


@dataclasses.dataclass(frozen=True, kw_only=True)
class Signs:
    """The signs of the logged pitch, elevator and command, and their evidence.

    Attributes:
        pitch: +1, or -1 where the log has the other sign.
        elevator: likewise.
        command: likewise.
        evidence: log-likelihood gained by them [nats].
        share: of the error that they remove.
    """

    pitch: int = 1
    elevator: int = 1
    command: int = 1
    evidence: float = 0.0
    share: float = 0.0

    @property
    def are_right(self) -> bool:
        """Whether the log has the right signs."""
        return (self.pitch, self.elevator, self.command) == (1, 1, 1)

    @property
    def effect(self) -> Effect:
        """The signs as an effect of a model."""
        return ANGLE_SIGN(
            pitch=float(self.pitch),
            elevator=float(self.elevator),
            command=float(self.command),
        )


def turn(flight: Flight, signs: Signs) -> Flight:
    """Returns the flight with wrong signs undone."""
    elevator = flight.elevator
    if elevator is not None:
        elevator = elevator * signs.elevator
    command = flight.command
    if command is not None:
        command = command * signs.command
    return dataclasses.replace(
        flight,
        pose=flight.pose * np.array([1.0, 1.0, signs.pitch]),
        elevator=elevator,
        command=command,
    )


def turn_campaign(campaign: Campaign, signs: Signs) -> Campaign:
    """Returns the campaign with wrong signs undone."""
    flights = tuple(turn(flight, signs) for flight in campaign.flights)
    return dataclasses.replace(campaign, flights=flights)


def signs_of(model: GliderModel) -> Signs:
    """Returns the signs that a model says its logs have."""
    for effect in model.effects:
        if effect.kind.stage == "log":
            return Signs(**{name: round(v) for name, v in effect.to_dict().items()})
    return Signs()
