"""A funnel that proposed throws keep inside, and whether it is one for a campaign."""

import dataclasses
from pathlib import Path

import numpy as np

from glider.campaign.logs import Campaign
from glider.design.limits import LAUNCH, ThrowLimits
from glider.errors import InputError
from glider.physics.parameters import PARAMETER_NAMES
from glider.physics.state import NUM_STATES, STATE_NAMES, VELOCITY
from glider.sysid.replay.vehicle import Vehicle
from glider.verification.funnel.funnel import Funnel, load_funnel


@dataclasses.dataclass(frozen=True, kw_only=True)
class KnownFunnel:
    """A funnel, and what to call it.

    Its sets are those about its own nominal flight. Where it was made for a set of
    gliders, these are the sets of the one in the middle.

    Attributes:
        name: of its file.
        funnel: of the states of STATE_NAMES alone.
    """

    name: str
    funnel: Funnel

    @property
    def duration(self) -> float:
        """From the launch to the goal [s]."""
        return float(self.funnel.nominal.times[-1])

    @property
    def fastest(self) -> float:
        """Largest rate of the elevator along the nominal flight [rad/s]."""
        return float(np.max(np.abs(self.funnel.nominal.inputs)))

    @property
    def x(self) -> float:
        """Of the nominal launch [m]."""
        return float(self.funnel.center(0.0)[_X])

    @property
    def launch(self) -> np.ndarray:
        """Height [m], speed [m/s], climb, pitch [rad] of the nominal launch, (4,)."""
        start = self.funnel.center(0.0)
        xdot, zdot = start[VELOCITY]
        return np.array(
            [start[_Z], np.hypot(xdot, zdot), np.arctan2(zdot, xdot), start[_PITCH]]
        )

    @property
    def launch_widths(self) -> np.ndarray:
        """How far each of them alone may deviate in the first set, (4,)."""
        shape, (_, speed, climb, _) = self.funnel.shape(0.0), self.launch
        along = np.array([np.cos(climb), np.sin(climb)])
        directions = np.zeros((4, NUM_STATES))
        directions[0, _Z] = directions[3, _PITCH] = 1.0
        directions[1, VELOCITY] = along
        directions[2, VELOCITY] = speed * np.array([-along[1], along[0]])
        return 1.0 / np.sqrt(np.einsum("ki,ij,kj->k", directions, shape, directions))

    def with_launch(self, given: ThrowLimits | None) -> ThrowLimits:
        """Returns limits whose launch, where it is left open, is the first set's.

        How others were launched says nothing of where the certificate holds.

        Args:
            given: limits that hold; None for none.
        """
        given = given or ThrowLimits()
        own = np.stack(
            [self.launch - self.launch_widths, self.launch + self.launch_widths], axis=1
        )
        return dataclasses.replace(
            given,
            **{
                name: getattr(given, name) or pair.tolist()
                for name, pair in zip(LAUNCH, own, strict=True)
            },
        )


_X, _Z, _PITCH = (STATE_NAMES.index(name) for name in ("x", "z", "pitch"))


def known_funnel(funnel: Path | str | Funnel | KnownFunnel) -> KnownFunnel:
    """Returns a funnel with its name, loaded where a path is given.

    Raises:
        InputError: the file holds no funnel, or one with states of its glider's effects
            beside STATE_NAMES: other explanations do not have them.
    """
    if isinstance(funnel, KnownFunnel):
        return funnel
    name = "the funnel" if isinstance(funnel, Funnel) else str(funnel)
    if not isinstance(funnel, Funnel):
        funnel = load_funnel(funnel)
    if funnel.num_states != NUM_STATES:
        more = ", ".join(funnel.nominal.state_names[NUM_STATES:])
        raise InputError(
            f"{name}: its states are those of a glider and {more}; a funnel of a "
            "glider's own states alone is needed, for not every explanation has more."
        )
    return KnownFunnel(name=name, funnel=funnel)


def check_vehicle(known: KnownFunnel, campaign: Campaign, vehicle: Vehicle) -> None:
    """Raises InputError where a funnel is of another vehicle than a campaign.

    What the campaign does not tell of its vehicle is fitted: there is nothing to hold
    it against. A servo that can more than the funnel's keeps the funnel, too.
    """
    own = known.funnel.nominal.model.parameters
    for index, name in enumerate(PARAMETER_NAMES):
        told, meant = float(vehicle.theta[index]), float(getattr(own, name))
        if index not in vehicle.nuisance and not np.isclose(told, meant, atol=1e-12):
            raise InputError(
                f"{known.name}: it is a funnel of a glider whose {name} is {meant:g}; "
                f"the vehicle of {campaign.path} has {told:g}, and a funnel of that "
                "one is needed."
            )
    low, high, rate = own.servo
    travel, fastest = campaign.elevator_limits, campaign.elevator_rate_limit
    slack = 1e-9  # Of numbers that are written in decimals.
    if travel and (travel[0] > low + slack or travel[1] < high - slack):
        raise InputError(
            f"{known.name}: its feedback takes the elevator from {low:g} to {high:g} "
            f"rad; that of {campaign.path} goes from {travel[0]:g} to {travel[1]:g}, "
            "and a funnel of that one is needed."
        )
    if fastest is not None and fastest < rate - slack:
        raise InputError(
            f"{known.name}: its feedback turns the elevator by {rate:g} rad/s; that of "
            f"{campaign.path} turns by {fastest:g}, and a funnel of that one is needed."
        )
