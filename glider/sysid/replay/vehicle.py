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

from glider.campaign.logs import Campaign
from glider.compiled.theta import LIBRARY_LAYOUT, SERVO_LOG, Layout
from glider.physics.parameters import PARAMETER_NAMES, GliderParameters
from glider.sysid import constants

_PER_MASS = ("wing_area", "elevator_area", "pitch_inertia")
"""Parameters that forces and moments show only per mass."""

BASELINE_PARAMETERS = (*_PER_MASS, "wing_offset")
"""Parameters of a flat-plate glider that flights can identify, given its mass."""

BASELINE_KINDS = ("mass", "inertia", "elevator_area", "center_of_pressure")
"""Effects that are other values of these: the refitted baseline includes them."""

_CONVENTIONAL = ("air_density", "gravity", "hinge_offset", "elevator_offset")
"""Parameters that default to the nominal glider's: they only scale the others."""

_OF_AREA = ("mass", "added_mass", "wind", "wind_shear", "position_scale")
_CONFOUNDED = {
    # Air that moves with the wing is like its area and its lift by pitch rate, a wind
    # that all flights share like its area, camber and drag, and lengths that are
    # measured too large like its area.
    "mass": _OF_AREA,
    "wing_area": _OF_AREA,
    "elevator_area": ("elevator_area", "elevator_scale"),
    # A tracked point ahead of the center of mass shows in the pitch acceleration, as do
    # errors of the moment: it could be anywhere.
    "wing_offset": ("marker_offset",),
    # The pitch damping of a glider of unknown moment is one more unknown.
    "pitch_inertia": ("inertia", "pitch_damping"),
}
"""Effects that flights do not distinguish from a parameter that is unknown."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Vehicle:
    """A campaign's vehicle as the fits see it."""

    layout: Layout  #: Of theta.
    theta: np.ndarray  #: The nominal model, unknown entries at a start value.
    #: Slots of theta that are unknown, fitted with all else, and their prior spread.
    nuisance: Mapping[int, float]
    of_log: Mapping[int, float]  #: Those of the log, and their standard errors.
    kinds: tuple[str, ...]  #: Effects that these logs could show.
    per_flight_trims: bool  #: Whether the elevator stands elsewhere in each flight.
    is_known: bool  #: Whether the nominal model is complete, with the elevator's angle.
    knows_forces: bool  #: Whether mass and areas are known: forces can be compared.
    notes: tuple[str, ...]  #: What was assumed, for the report.
    is_per_mass: bool  #: Whether areas and inertia are per kilogram.

    @property
    def unknown(self) -> list[int]:
        """Slots of the glider's unknown parameters: nuisances but those of logs."""
        return [i for i in self.nuisance if i not in self.of_log]

    @property
    def baseline_slots(self) -> tuple[int, ...]:
        """Slots that the flat-plate baseline refits."""
        index = self.layout.index
        of_plate = {index["parameters", name] for name in BASELINE_PARAMETERS}
        return tuple(sorted({*self.nuisance, *of_plate}))


def make_vehicle(campaign: Campaign, layout: Layout = LIBRARY_LAYOUT) -> Vehicle:
    """Sorts a campaign's vehicle into known and unknown."""
    known, elevator = campaign.vehicle.keys(), campaign.elevator
    is_per_mass = known.isdisjoint(("mass", *_PER_MASS))
    unknown = [name for name in BASELINE_PARAMETERS if name not in known]
    if "mass" not in known and not is_per_mass:
        unknown.append("mass")
    slots = [("parameters", name) for name in unknown]
    of_log = _of_log(campaign, layout)
    dropped, notes = _hidden(campaign, layout)
    dropped |= {layout.slots[slot][0] for slot in of_log}
    if elevator == "fixed" or (elevator != "servo" and "elevator_area" in known):
        slots.append(("elevator_trim", "angle"))
    elif elevator != "servo":
        # An unknown tail at an unknown angle could look like camber and drag: all
        # flights share a moment alone.
        slots.append(("pitch_moment", "coefficient"))
        dropped.add("pitch_moment")
    if "pitch_inertia" in unknown:
        slots.append(("pitch_damping", "coefficient"))
    theta = layout.default_theta(_parameters(campaign, is_per_mass))
    spreads = dict(of_log)
    for slot in slots:
        i = layout.index[slot]
        share = constants.TAIL_SPREAD if slot[1] == "elevator_area" else 0.5
        spreads[i] = constants.UNKNOWN_SPREAD.get(slot, share * float(theta[i]))
    if is_per_mass:
        notes.append(
            "No mass or area is specified: the mass is set to 1 kg, "
            "so areas and inertia are per kg."
        )
    notes += [
        f"'{name}' is not specified; {theta[layout.index['parameters', name]]:g} is "
        "assumed."
        for name in _CONVENTIONAL
        if name not in known
    ]
    return Vehicle(
        layout=layout,
        theta=theta,
        knows_forces={"mass", "wing_area", "elevator_area"} <= known,
        nuisance=dict(sorted(spreads.items())),
        of_log=of_log,
        kinds=tuple(kind for kind in layout.kinds if kind not in dropped),
        per_flight_trims=elevator == "fixed_per_flight",
        is_known="mass" in known and not unknown and elevator != "fixed",
        notes=tuple(notes),
        is_per_mass=is_per_mass,
    )


def _hidden(campaign: Campaign, layout: Layout) -> tuple[set[str], list[str]]:
    """Effects that a campaign's logs cannot show, and what to say of them."""
    unknown, servo, notes = _CONFOUNDED.keys() - campaign.vehicle, campaign.servo, []
    dropped = {kind for name in unknown for kind in _CONFOUNDED[name]}
    dropped |= {name for name, kind in layout.kinds.items() if kind.stage == "log"}
    dropped.add(SERVO_LOG.kind)
    if campaign.elevator != "servo":
        dropped |= {kind.kind for kind in layout.replayed_kinds}
        dropped |= {"elevator_trim", "elevator_scale", "elevator_blowback"}
        if "elevator_area" in unknown:  # How the flow meets it is one with its size.
            dropped |= {"downwash", "stalled_downwash", "lagged_downwash", "tail_wake"}
    elif servo.command == "reconstructed":
        actuators = [e.kind for e in layout.kinds.values() if e.stage == "actuator"]
        dropped |= {*actuators}
        notes.append(
            f"{', '.join(actuators)} were not tried: the commands were reconstructed "
            "from the measured elevator."
        )
    if servo.clock_std or servo.command_std:
        std = math.hypot(servo.clock_std, servo.command_std)
        notes.append(
            f"The servo's times are known to ± {1e3 * std:.2g} ms only: a delay that "
            "this explains cannot be found."
        )
    if "wing_offset" in unknown:
        notes.append("The tracked point is assumed to be the center of mass.")
    return dropped, notes


def _parameters(campaign: Campaign, is_per_mass: bool) -> GliderParameters:
    """The vehicle's parameters, those of the default glider where unknown."""
    assumed: dict[str, Any] = dataclasses.asdict(GliderParameters())
    if is_per_mass:
        assumed |= {name: assumed[name] / assumed["mass"] for name in _PER_MASS}
        assumed["mass"] = 1.0
    return GliderParameters(**{**assumed, **campaign.vehicle})


def _of_log(campaign: Campaign, layout: Layout) -> dict[int, float]:
    """Slots of theta that a log leaves open, and their spread."""
    servo = campaign.servo
    has_gyro = any(flight.pitch_rate is not None for flight in campaign.flights)
    travel = constants.TAIL_SPREAD * (servo.angle == "reconstructed")
    bias = constants.Z * constants.NOISE["rate"][0] * has_gyro
    spreads = servo.clock_std, servo.command_std, bias, travel
    slots = *layout.slots_of(SERVO_LOG.kind), *layout.slots_of("elevator_scale")
    return {slot: spread for slot, spread in zip(slots, spreads, strict=True) if spread}


def parameters_of(theta: np.ndarray, campaign: Campaign) -> GliderParameters:
    """Returns theta's parameters as a vehicle's, with the campaign's limits."""
    limits = campaign.elevator_limits
    return GliderParameters(
        **dict(zip(PARAMETER_NAMES, theta.tolist(), strict=False)),
        elevator_limits=None if limits is None else list(limits),
        elevator_rate_limit=campaign.elevator_rate_limit,
    )
