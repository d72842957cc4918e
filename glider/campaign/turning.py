"""Angles that were logged with the other sign, turned back."""

import dataclasses

import numpy as np

from glider.campaign.logs import Campaign, Flight
from glider.physics.effects import ANGLE_SIGN, Effect
from glider.physics.model import GliderModel


@dataclasses.dataclass(frozen=True, kw_only=True)
class Signs:
    """The signs of the logged pitch, elevator and command, and their evidence."""

    pitch: int = 1  #: +1, or -1 where the log has the other sign.
    elevator: int = 1  #: Likewise.
    command: int = 1  #: Likewise.
    evidence: float = 0.0  #: Log-likelihood gained by them [nats].
    share: float = 0.0  #: Of the error that they remove.

    @property
    def are_right(self) -> bool:
        """Whether the log has the right signs."""
        return (self.pitch, self.elevator, self.command) == (1, 1, 1)

    @property
    def effect(self) -> Effect:
        """The signs as an effect of a model."""
        names = (c.name for c in ANGLE_SIGN.coefficients)
        return ANGLE_SIGN(**{name: float(getattr(self, name)) for name in names})


def turn(flight: Flight, signs: Signs) -> Flight:
    """Returns the flight with wrong signs undone."""
    factors = {
        "pose": np.array([1.0, 1.0, signs.pitch]),
        "elevator": signs.elevator,
        "command": signs.command,
    }
    logged = {name: getattr(flight, name) for name in factors}
    turned = {n: v * factors[n] for n, v in logged.items() if v is not None}
    return dataclasses.replace(flight, **turned)


def turn_campaign(campaign: Campaign, signs: Signs) -> Campaign:
    """Returns the campaign with wrong signs undone."""
    flights = tuple(turn(f, signs) for f in campaign.flights)
    return dataclasses.replace(campaign, flights=flights)


def signs_of(model: GliderModel) -> Signs:
    """Returns the signs that a model says its logs have."""
    for effect in model.effects:
        if effect.kind.stage == "log":
            return Signs(**{name: round(v) for name, v in effect.to_dict().items()})
    return Signs()
