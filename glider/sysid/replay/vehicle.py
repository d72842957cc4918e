"""A campaign's vehicle, sorted into known and unknown parameters of a model.

Known parameters are taken as specified; unknown ones are fitted with the effects.
Without a mass, an area or an inertia, forces show only per mass: the mass is then set
to 1 kg, and areas and inertia are per kilogram.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from glider.campaign.logs import Campaign
from glider.physics.parameters import PARAMETER_NAMES, GliderParameters
from glider.sysid.replay.theta import LIBRARY_LAYOUT, SERVO_LOG, Layout

_PER_MASS = ("wing_area", "elevator_area", "pitch_inertia")
"""Parameters that forces and moments show only per mass."""

BASELINE_PARAMETERS = ("wing_area", "elevator_area", "pitch_inertia", "wing_offset")
"""Parameters of a flat-plate glider that flights can identify, given its mass."""

BASELINE_KINDS = ("mass", "inertia", "elevator_area", "center_of_pressure")
"""Effects that are other values of these: the refitted baseline includes them."""

_CONVENTIONAL = ("air_density", "gravity", "hinge_offset", "elevator_offset")
"""Parameters that default to the nominal glider's: they only scale the others."""

_OFFSET_SPREAD = 0.03
"""Distance of an unknown wing's center of pressure from the center of mass [m]."""

_RELATIVE_SPREAD = {"elevator_area": 0.1}
"""Spread of unknown areas and inertia over the default glider's, if not a half. A
tail's area shows in the moment only over the inertia."""

_TRAVEL_SPREAD = 0.2  # Of an elevator's travel over the commanded one.
_TRIM_SPREAD = 0.05  # Angle at which an elevator without a servo may stand [rad].
_MOMENT_SPREAD = 0.02
"""Moment that an unknown tail may make, as a coefficient of the wing's area [m]."""

_GYRO_BIAS = 0.05  # Spread of the bias of a gyro [rad/s].

PRIOR_SCALES = 4.0
"""Prior spread of effects' coefficients, in their scales, where there is no nominal
model to compare them with."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Vehicle:
    """A campaign's vehicle as the fits see it."""

    layout: Layout  #: Of theta.
    theta: np.ndarray  #: The nominal model, unknown entries at a start value.
    nuisance: tuple[int, ...]  #: Slots of theta that are unknown: fitted with all else.
    baseline_slots: tuple[int, ...]  #: Those that the flat-plate baseline refits.
    kinds: tuple[str, ...]  #: Effects that these logs could show.
    trim_is_known: bool  #: Whether the elevator's angle is the same in each flight.
    is_known: bool  #: Whether the nominal model is complete, with the elevator's angle.
    knows_forces: bool  #: Whether mass and areas are known: forces can be compared.
    prior_spread: np.ndarray | None  #: Of theta about the start, if any is unknown.
    of_log: Mapping[int, float]  #: Those of the servo's log, and standard errors.
    notes: tuple[str, ...]  #: What was assumed, for the report.
    is_per_mass: bool  #: Whether areas and inertia are per kilogram.

    @property
    def unknown(self) -> list[int]:
        """Slots of the glider's unknown parameters: nuisances but those of logs."""
        return [i for i in self.nuisance if i not in self.of_log]


def make_vehicle(campaign: Campaign, layout: Layout = LIBRARY_LAYOUT) -> Vehicle:
    """Sorts a campaign's vehicle into known and unknown."""
    index = layout.index
    known = dict(campaign.vehicle)
    has_scale = any(name in known for name in _PER_MASS)
    is_per_mass = "mass" not in known and not has_scale
    assumed, notes = _assumptions(known, is_per_mass)
    parameters = GliderParameters(**{**assumed, **_servo_of(campaign), **known})
    unknown = [name for name in BASELINE_PARAMETERS if name not in known]
    if "mass" not in known and has_scale:
        unknown.append("mass")
    nuisance = [index["parameters", name] for name in unknown]
    dropped = {name for name, kind in layout.kinds.items() if kind.stage == "log"}
    of_log = _of_log(campaign, layout)
    dropped |= {SERVO_LOG.kind, *(layout.slots[slot][0] for slot in of_log)}
    if campaign.elevator != "servo":
        dropped |= {kind.kind for kind in layout.replayed_kinds}
        dropped |= {"elevator_trim", "elevator_scale", "elevator_blowback"}
        if "elevator_area" in unknown:  # How the flow meets it is one with its size.
            dropped |= {"downwash", "stalled_downwash", "tail_wake"}
    elif campaign.servo.command == "reconstructed":
        hidden = [e.kind for e in layout.kinds.values() if e.stage == "actuator"]
        dropped |= {*hidden}
        notes.append(
            f"{', '.join(hidden)} were not tried: the commands were reconstructed from "
            "the measured elevator."
        )
    nuisance += of_log
    if clock := math.hypot(campaign.servo.clock_std, campaign.servo.command_std):
        notes.append(
            f"The servo's times are known to ± {1e3 * clock:.2g} ms only: a delay that "
            "this explains cannot be found."
        )
    if campaign.elevator == "fixed" or (
        campaign.elevator == "fixed_per_flight" and "elevator_area" not in unknown
    ):
        nuisance.append(index["elevator_trim", "angle"])
    elif campaign.elevator == "fixed_per_flight":
        # An unknown tail at an unknown angle could look like camber and drag: all
        # flights share a moment alone.
        nuisance.append(index["pitch_moment", "coefficient"])
        dropped.add("pitch_moment")
    if "mass" not in known or "wing_area" in unknown:
        # Air that moves with the wing is like its area and its lift by pitch rate, a
        # wind that all flights share like its area, camber and drag, and lengths that
        # are measured too large like its area.
        dropped |= {"mass", "added_mass", "wind", "wind_shear", "position_scale"}
    if "wing_offset" in unknown:
        # A tracked point ahead of it shows in the pitch acceleration, as do errors of
        # the moment: it could be anywhere.
        dropped.add("marker_offset")
        notes.append("The tracked point is assumed to be the center of mass.")
    if "pitch_inertia" in unknown:
        # The pitch damping of a glider of unknown moment is one more unknown.
        nuisance.append(index["pitch_damping", "coefficient"])
        dropped |= {"pitch_damping", "inertia"}
    if "elevator_area" in unknown:
        dropped |= {"elevator_area", "elevator_scale"}
    theta = layout.default_theta(parameters)
    of_plate = (index["parameters", name] for name in BASELINE_PARAMETERS)
    return Vehicle(
        layout=layout,
        theta=theta,
        knows_forces={"mass", "wing_area", "elevator_area"} <= set(known),
        prior_spread=_prior_spread(layout, theta, unknown, of_log),
        nuisance=tuple(sorted(nuisance)),
        baseline_slots=tuple(sorted({*nuisance, *of_plate})),
        kinds=tuple(kind for kind in layout.kinds if kind not in dropped),
        trim_is_known=campaign.elevator != "fixed_per_flight",
        is_known="mass" in known and not unknown and campaign.elevator != "fixed",
        of_log=of_log,
        notes=tuple(notes),
        is_per_mass=is_per_mass,
    )


def _assumptions(
    known: Mapping[str, Any], is_per_mass: bool
) -> tuple[dict[str, Any], list[str]]:
    """The parameters that are assumed where they are unknown, and notes."""
    assumed: dict[str, Any] = dataclasses.asdict(GliderParameters())
    notes = []
    if is_per_mass:
        for name in _PER_MASS:
            assumed[name] /= assumed["mass"]
        assumed["mass"] = 1.0
        notes.append(
            "No mass or area is specified: the mass is set to 1 kg, "
            "so areas and inertia are per kg."
        )
    notes += [
        f"'{name}' is not specified; {assumed[name]:g} is assumed."
        for name in _CONVENTIONAL
        if name not in known
    ]
    return assumed, notes


def _of_log(campaign: Campaign, layout: Layout) -> dict[int, float]:
    """Slots of theta that are unknowns of a log, with their standard errors."""
    servo = campaign.servo
    has_gyro = any(flight.pitch_rate is not None for flight in campaign.flights)
    travel = _TRAVEL_SPREAD * (servo.angle == "reconstructed")
    spreads = servo.clock_std, servo.command_std, _GYRO_BIAS * has_gyro, travel
    slots = *layout.slots_of(SERVO_LOG.kind), *layout.slots_of("elevator_scale")
    return {slot: std for slot, std in zip(slots, spreads, strict=True) if std}


def _prior_spread(
    layout: Layout,
    theta: np.ndarray,
    unknown: Sequence[str],
    of_log: Mapping[int, float],
) -> np.ndarray | None:
    """Prior spread of theta; None where nothing is unknown."""
    if not unknown and not of_log:
        return None
    spread = PRIOR_SCALES * layout.scale
    spread[list(of_log)] = list(of_log.values())
    for name in unknown:
        i = layout.index["parameters", name]
        relative = _RELATIVE_SPREAD.get(name, 0.5)
        spread[i] = _OFFSET_SPREAD if name == "wing_offset" else relative * theta[i]
    spread[layout.index["elevator_trim", "angle"]] = _TRIM_SPREAD
    spread[layout.index["pitch_moment", "coefficient"]] = _MOMENT_SPREAD
    return spread


def parameters_of(theta: np.ndarray, campaign: Campaign) -> GliderParameters:
    """Returns theta's parameters as a vehicle's, with the campaign's limits."""
    values = dict(zip(PARAMETER_NAMES, theta.tolist(), strict=False))
    return GliderParameters(**values, **_servo_of(campaign))


def _servo_of(campaign: Campaign) -> dict[str, Any]:
    """The servo's limits as parameters, None where they are not specified."""
    limits = campaign.elevator_limits
    return {
        "elevator_limits": None if limits is None else list(limits),
        "elevator_rate_limit": campaign.elevator_rate_limit,
    }
