"""A funnel that throws keep inside, checked, and of a campaign's vehicle."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np

from glider.campaign.logs import Campaign
from glider.errors import InputError, expect, show
from glider.experiments.throw_limits import LAUNCH, ThrowLimits
from glider.physics.confidence import describe_set
from glider.physics.parameters import PARAMETER_NAMES
from glider.physics.state import NUM_STATES, PITCH, POSITION, VELOCITY
from glider.sysid.replay.vehicle import Vehicle
from glider.verification.funnel.funnel import Funnel, load_funnel
from glider.verification.proof.check import Verdict, check_funnel
from glider.verification.proof.flight_proof import remainder_status
from glider.verification.proof.purpose import set_sizes


@dataclasses.dataclass(frozen=True, kw_only=True)
class KnownFunnel:
    """A funnel, its file, and whether its certificate was checked.

    Its sets are those about its nominal flight; where it was made for a set of gliders,
    those of the central one.
    """

    funnel: Funnel  #: Of the states of STATE_NAMES alone, from 0 s on.
    #: That it was loaded from; None where it was given as a Funnel.
    file: str | None = None
    #: What the check of its certificate found; None if it is not yet `checked`.
    verdict: Verdict | None = None

    @property
    def name(self) -> str:
        """What an error begins with."""
        return self.file or "the given funnel"

    @property
    def is_checked(self) -> bool:
        """Whether its certificate is known to hold."""
        return self.verdict is not None and self.verdict.holds

    @property
    def relied_on(self) -> dict[str, Any]:
        """What throws rely on, besides the sets, for JSON and sentences."""
        verdict, gliders = self.verdict, self.funnel.gliders
        return {
            "exact_at_times": verdict.times if verdict else 0,
            "remainder": remainder_status(self.funnel) if verdict else "unchecked",
            "remainder_seen": verdict.remainder_seen if verdict else None,
            "seed": verdict.seed if verdict else None,
            "every_flight_proven": False,
            "set_of_gliders": describe_set(gliders.confidence) if gliders else None,
            "set_compared": False,
            "inlet": set_sizes(self.funnel, 0.0),
        }

    @property
    def proof(self) -> str:
        """The command that proves it."""
        return f"glider check-funnel {self.file or 'FILE'} --prove"

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
            [start[_Z], np.hypot(xdot, zdot), np.arctan2(zdot, xdot), start[PITCH]]
        )

    @property
    def launch_widths(self) -> np.ndarray:
        """Largest deviation of each of them alone in the first set, (4,)."""
        shape, (_, speed, climb, _) = self.funnel.shape(0.0), self.launch
        along = np.array([np.cos(climb), np.sin(climb)])
        directions = np.zeros((4, NUM_STATES))
        directions[0, _Z] = directions[3, PITCH] = 1.0
        directions[1, VELOCITY] = along
        directions[2, VELOCITY] = speed * np.array([-along[1], along[0]])
        return 1.0 / np.sqrt(np.einsum("ki,ij,kj->k", directions, shape, directions))

    def with_launch(self, given: ThrowLimits | None) -> ThrowLimits:
        """Limits whose launch, where it is open, is that of the first set.

        Where the certificate holds does not depend on how flights were launched.
        """
        given = given or ThrowLimits()
        launch, widths = self.launch, self.launch_widths
        pairs = np.column_stack([launch - widths, launch + widths]).tolist()
        own = dict(zip(LAUNCH, pairs, strict=True))
        kept = {name: getattr(given, name) or pair for name, pair in own.items()}
        return dataclasses.replace(given, **kept)


_X, _Z = POSITION


def known_funnel(funnel: Path | str | Funnel | KnownFunnel) -> KnownFunnel:
    """A funnel with its file, loaded where a path is given, not yet `checked`.

    Raises:
        InputError: the file holds no funnel, or one that begins late, has states of
            effects, which other explanations lack, or sets that are no ellipsoids.
    """
    if isinstance(funnel, KnownFunnel):
        return funnel
    if isinstance(funnel, Funnel):
        known = KnownFunnel(funnel=funnel)
    else:
        known = KnownFunnel(funnel=load_funnel(funnel), file=str(funnel))
    nominal = known.funnel.nominal
    more = nominal.model.state_names[NUM_STATES:]
    what = f"{known.name}: its list of effects' states"
    expect(not more, what, more, "none, as not every explanation has them")
    begin, needed = nominal.times[0], "0 s, a funnel from the launch"
    expect(begin == 0.0, f"{known.name}: the time that it begins at", begin, needed)
    period, needed = known.funnel.settings.period, "0 s, as a tape may end at any time"
    expect(not period, f"{known.name}: the period of its commands", period, needed)
    looks = np.unique(np.linspace(nominal.times[:-1], nominal.times[1:], _LOOKS))
    least = np.linalg.eigvalsh(known.funnel.shape(looks)).min()
    expect(
        least > 0.0,
        f"{known.name}: the least eigenvalue of its S",
        least,
        "a positive definite S at all times, or its sets are no ellipsoids",
    )
    return known


_LOOKS = 5
"""Times at which S is checked, from one of a funnel's times to the next."""


def checked(known: KnownFunnel) -> KnownFunnel:
    """A funnel whose certificate holds, checked as by `check-funnel` without --prove.

    Exactly at all of its times, which takes some seconds. Between them, and for the
    full dynamics, it is sampled and not proven.

    Raises:
        InputError: it does not hold.
    """
    if known.is_checked:
        return known
    verdict = check_funnel(known.funnel)
    if not verdict.holds:
        fault = verdict.faults[0].rstrip(".")
        raise InputError(
            f"{known.name}: its certificate does not hold: {fault}; "
            "expected a funnel without faults, see check-funnel."
        )
    return dataclasses.replace(known, verdict=verdict)


def check_vehicle(known: KnownFunnel, campaign: Campaign, vehicle: Vehicle) -> None:
    """Raises InputError where a funnel is of another vehicle than a campaign.

    Unknown parameters of the vehicle are fitted and not compared. A servo that can do
    more than the funnel's keeps the funnel.
    """
    own = known.funnel.nominal.model.parameters
    for index, name in enumerate(PARAMETER_NAMES):
        found, expected = float(getattr(own, name)), float(vehicle.theta[index])
        same = index in vehicle.nuisance or np.isclose(found, expected, atol=1e-12)
        needed = f"{expected:g}, as the vehicle of {campaign.path}"
        expect(same, f"{known.name}: its glider's {name}", found, needed)
    low, high, rate = own.servo
    travel, fastest = campaign.elevator_limits, campaign.elevator_rate_limit
    slack = 1e-9  # Of numbers written in decimals.
    if travel:
        inside = travel[0] <= low + slack and travel[1] >= high - slack
        needed = f"at most {show(travel)} rad, as in {campaign.path}"
        what = f"{known.name}: the elevator's travel under its feedback"
        expect(inside, what, [low, high], needed)
    if fastest is not None:
        needed = f"{fastest:g} rad/s at most, as in {campaign.path}"
        what = f"{known.name}: the elevator's rate under its feedback"
        expect(rate <= fastest + slack, what, rate, needed)
