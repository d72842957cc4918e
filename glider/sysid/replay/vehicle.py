"""A campaign's vehicle, sorted into known and unknown parameters of a model.

Known parameters are taken as specified; unknown ones are fitted with the effects.
Without a mass, an area or an inertia, forces show only per mass: the mass is then set
to 1 kg, and areas and inertia are per kilogram.
"""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from glider.campaign.logs import CLOCK_STD, Campaign
from glider.physics.effects import ELEVATOR_SCALE
from glider.physics.parameter_space import ParameterSpace
from glider.physics.parameters import GliderParameters
from glider.sysid import constants
from glider.sysid.replay.log_space import LIBRARY_SPACE, SERVO_LOG

_PER_MASS = ("wing_area", "elevator_area", "pitch_inertia")
"""Parameters that forces and moments show only per mass."""

_BASELINE_PARAMETERS = (*_PER_MASS, "wing_offset")
"""Parameters of a flat-plate glider that flights can identify, given its mass."""

_CONVENTIONAL = ("air_density", "gravity", "hinge_offset", "elevator_offset")
"""Parameters that default to the nominal glider's: they only scale the others."""


# Prior spreads (c). Of the drift between the clocks of poses and servo over a session
# [s]: clocks differ by 20 parts in a million, and a session lasts some minutes.
_DRIFT_SPREAD = 5e-3
_WING_SPREAD = 0.03  # Of the distance of a wing from the center of mass [m].


@dataclasses.dataclass(frozen=True, kw_only=True)
class Vehicle:
    """A campaign's vehicle as the fits see it.

    Attributes:
        space: of theta.
        parameters: the nominal glider, unknown ones at a start value.
        theta: the same as a vector of the space, without effects.
        nuisance: slots of theta that are unknown, fitted with all else, and their prior
            spreads.
        of_log: those of the log, and their standard errors.
        kinds: effects that these logs could show.
        per_flight_trims: whether the elevator stands elsewhere in each flight.
        is_known: whether the nominal model is complete, with the elevator's angle.
        knows_forces: whether mass and areas are known: forces can be compared.
        notes: what was assumed, for the report.
        is_per_mass: whether areas and inertia are per kilogram.
    """

    space: ParameterSpace
    parameters: GliderParameters
    theta: np.ndarray
    nuisance: Mapping[int, float]
    of_log: Mapping[int, float]
    kinds: tuple[str, ...]
    per_flight_trims: bool
    is_known: bool
    knows_forces: bool
    notes: tuple[str, ...]
    is_per_mass: bool

    @property
    def unknown(self) -> list[int]:
        """Slots of the glider's unknown parameters: nuisances but those of logs."""
        return [i for i in self.nuisance if i not in self.of_log]

    @property
    def baseline_slots(self) -> tuple[int, ...]:
        """Slots that the flat-plate baseline refits."""
        of_plate = self.space.places(_BASELINE_PARAMETERS)
        return tuple(sorted({*self.nuisance, *of_plate}))


def make_vehicle(campaign: Campaign, space: ParameterSpace = LIBRARY_SPACE) -> Vehicle:
    """Sorts a campaign's vehicle into known and unknown.

    Args:
        campaign: what it specifies and logs.
        space: of the models to fit.
    """
    known = campaign.vehicle.keys()
    is_per_mass = known.isdisjoint(("mass", *_PER_MASS))
    unknown = [name for name in _BASELINE_PARAMETERS if name not in known]
    if "mass" not in known and not is_per_mass:
        unknown.append("mass")

    servo = campaign.servo
    log_spreads = (
        servo.clock_std,
        servo.command_std,
        _DRIFT_SPREAD * (servo.clock_std > 0.0),
        constants.TAIL_SPREAD * (servo.angle == "reconstructed"),
    )
    slots = *space.slots_of(SERVO_LOG.kind), *space.slots_of(ELEVATOR_SCALE.kind)
    pairs = zip(slots, log_spreads, strict=True)
    facts = _facts(campaign)
    has_servo = "servo" in facts
    of_log = {slot: spread for slot, spread in pairs if spread and has_servo}

    dropped, notes = _hidden(campaign, space, facts)
    dropped |= {space.owners[slot] for slot in of_log}
    parameters = _parameters(campaign, is_per_mass)
    theta = space.pack(parameters)
    spreads = dict(of_log)
    for name in unknown:
        slot = space.index[name]
        share = constants.TAIL_SPREAD if name == "elevator_area" else 0.5
        spreads[slot] = share * float(theta[slot])
        if name == "wing_offset":  # Its start is zero.
            spreads[slot] = _WING_SPREAD

    for kind in space.kinds.values():
        if kind.unknown_without is not None:
            fact, spread = kind.unknown_without
            if fact not in facts:
                spreads[space.slots_of(kind.kind)[0]] = spread

    if is_per_mass:
        notes.append(
            "No mass or area is specified: the mass is set to 1 kg, "
            "so areas and inertia are per kg."
        )

    notes += [
        f"'{name}' is not specified; {theta[space.index[name]]:g} is assumed."
        for name in _CONVENTIONAL
        if name not in known
    ]
    return Vehicle(
        space=space,
        parameters=parameters,
        theta=theta,
        knows_forces={"mass", "wing_area", "elevator_area"} <= known,
        nuisance=dict(sorted(spreads.items())),
        of_log=of_log,
        kinds=tuple(kind for kind in space.kinds if kind not in dropped),
        per_flight_trims=campaign.elevator == "fixed_per_flight",
        is_known="mass" in known and not unknown and campaign.elevator != "fixed",
        notes=tuple(notes),
        is_per_mass=is_per_mass,
    )


def _facts(campaign: Campaign) -> set[str]:
    """Returns those of FACTS that a campaign gives."""
    facts = {*campaign.vehicle}
    if campaign.has_moving_elevator:
        return facts | {"servo", "elevator_angle", "tail"}
    if campaign.elevator != "fixed_per_flight":
        return facts | {"tail"}
    # An unknown tail at an unknown angle could look like camber and drag: all flights
    # share a moment alone.
    return facts | {"tail" if "elevator_area" in facts else "elevator_angle"}


def _hidden(
    campaign: Campaign, space: ParameterSpace, facts: set[str]
) -> tuple[set[str], list[str]]:
    """Returns the effects that a campaign's logs cannot show, and notes about them."""
    servo = campaign.servo
    notes = []
    dropped = {SERVO_LOG.kind}
    for kind in space.kinds.values():
        if any(facts.isdisjoint(need.split(" or ")) for need in kind.needs):
            dropped.add(kind.kind)

    if "servo" not in facts:
        dropped.update(kind.kind for kind in space.replayed)
    elif servo.command == "reconstructed":
        actuators = [e.kind for e in space.kinds.values() if e.stage == "actuator"]
        dropped.update(actuators)
        notes.append(
            f"{', '.join(actuators)} were not tried: the commands were reconstructed "
            "from the measured elevator."
        )

    std = math.hypot(servo.clock_std, servo.command_std)
    if std > 2.0 * CLOCK_STD:
        notes.append(
            f"The servo's times are known to ± {1e3 * std:.2g} ms only: a delay that "
            "this explains cannot be found."
        )

    if "wing_offset" not in facts:
        notes.append("The tracked point is assumed to be the center of mass.")
    return dropped, notes


def _parameters(campaign: Campaign, is_per_mass: bool) -> GliderParameters:
    """The vehicle's parameters, those of the default glider where unknown.

    Per mass its area and inertia are those of 1 kg. The servo's limits are the
    campaign's alone.
    """
    assumed: dict[str, Any] = dataclasses.asdict(GliderParameters())
    if is_per_mass:
        assumed |= {name: assumed[name] / assumed["mass"] for name in _PER_MASS}
        assumed["mass"] = 1.0
    limits = campaign.elevator_limits
    assumed["elevator_limits"] = None if limits is None else list(limits)
    assumed["elevator_rate_limit"] = campaign.elevator_rate_limit
    return GliderParameters(**{**assumed, **campaign.vehicle})
