"""A funnel that throws keep inside: whether it is one, and one for a campaign."""

import dataclasses
from pathlib import Path

import numpy as np

from glider.campaign.logs import Campaign
from glider.errors import InputError
from glider.experiments.throw_limits import LAUNCH, ThrowLimits
from glider.physics.parameters import PARAMETER_NAMES
from glider.physics.state import NUM_STATES, STATE_NAMES, VELOCITY
from glider.sysid.replay.vehicle import Vehicle
from glider.verification.funnel.funnel import Funnel, load_funnel
from glider.verification.proof.check import check_funnel


@dataclasses.dataclass(frozen=True, kw_only=True)
class KnownFunnel:
    """A funnel, where it comes from, and whether it was looked at.

    Its sets are those about its own nominal flight. Where it was made for a set of
    gliders, these are the sets of the one in the middle.

    Attributes:
        funnel: of the states of STATE_NAMES alone, from 0 s on.
        file: that it was loaded from; None where it was given as a Funnel.
        is_checked: whether its certificate is known to hold, see `checked`.
    """

    funnel: Funnel
    file: str | None = None
    is_checked: bool = False

    @property
    def name(self) -> str:
        """What an error begins with."""
        return self.file or "the given funnel"

    @property
    def words(self) -> str:
        """What it is called in a sentence."""
        return f"the funnel of {self.file}" if self.file else "the given funnel"

    @property
    def proof(self) -> str:
        """The command that proves it."""
        return f"python -m glider check-funnel {self.file or 'FILE'} --prove"

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
    """Returns a funnel and where it comes from, loaded where a path is given.

    Whether its certificate holds is for `checked`.

    Raises:
        InputError: the file holds no funnel, or one that begins late, with states of
            its glider's effects beside STATE_NAMES (other explanations do not have
            them), or with sets that are none.
    """
    if isinstance(funnel, KnownFunnel):
        return funnel
    if isinstance(funnel, Funnel):
        known = KnownFunnel(funnel=funnel)
    else:
        known = KnownFunnel(funnel=load_funnel(funnel), file=str(funnel))
    nominal = known.funnel.nominal
    if known.funnel.num_states != NUM_STATES:
        more = ", ".join(nominal.state_names[NUM_STATES:])
        raise InputError(
            f"{known.name}: its states are those of a glider and {more}; a funnel of a "
            "glider's own states alone is needed, for not every explanation has more."
        )
    if nominal.times[0] != 0.0:
        raise InputError(
            f"{known.name}: it begins at {nominal.times[0]:.3g} s; one from the "
            "launch on, at 0 s, is needed."
        )
    looks = np.unique(np.linspace(nominal.times[:-1], nominal.times[1:], _LOOKS))
    least = np.linalg.eigvalsh(known.funnel.shape(looks)).min(axis=1)
    bad = np.flatnonzero(~(least > 0.0))
    if len(bad):
        raise InputError(
            f"{known.name}: its S has the eigenvalue {least[bad[0]]:.3g} at "
            f"{looks[bad[0]]:.3g} s, and its set there is no ellipsoid; a funnel with "
            "a positive definite S at all times is needed."
        )
    return known


_LOOKS = 5
"""Looks at S from one of a funnel's times to the next."""


def checked(known: KnownFunnel) -> KnownFunnel:
    """Returns a funnel whose certificate holds, as `check-funnel` says without --prove.

    Exactly at all of its times, which takes some seconds: a file may say anything.
    Between them, and of the full dynamics, it looks and does not prove.

    Raises:
        InputError: it does not hold.
    """
    if known.is_checked:
        return known
    faults = check_funnel(known.funnel).faults
    if faults:
        raise InputError(
            f"{known.name}: its certificate does not hold: {faults[0].rstrip('.')}; "
            "a funnel that check-funnel finds no fault with is needed."
        )
    return dataclasses.replace(known, is_checked=True)


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
