"""Do flights fall down, nose ahead, with the forces that the vehicle has?

All checks ask one fitted description of the flights, `Motions`. Its free fit determines
gravity, whose direction shows which way is down (its size is checked by `check_fall`).
`check_frame` refuses axes that are certainly turned, and columns or a vehicle in
another unit; a turned angle is traced later (`glider.sysid.search.signs`). The mapping
of an import is checked further, by `check_signs`.

Measured margins: over 20 simulated campaigns and a measured one the direction of
gravity is off by at most 0.07 rad, and with strong effects of the library by 0.55 rad
where it is determined at all; a marker 0.36 m off and a strong stall leave it
undetermined, which `_CLEARLY` detects.
"""

import math

import numpy as np

from glider.campaign.checks.forces import (
    Motions,
    fit_elevator,
    fit_forces,
    measure_motions,
)
from glider.campaign.logs import Campaign
from glider.physics.parameters import GliderParameters

_MIN_FLIGHTS = 3
"""Flights that show axes: one alone determines no gravity, and may fit anything."""
_MIN_ROWS = 60  # Accelerations that the constant is fitted to, at least.
_UPRIGHT = 1.1
"""Angle of the constant from straight down that passes [rad]: a frame may be tilted by
0.5 (frame_tilt), an exchange of axes turns it by 1.57."""
_LEAST = {"x": 0.01, "z": 0.01, "pitch": 1e-6}
"""Columns that change by less in every flight do not change [m, m, rad]."""
_CLEARLY = 1.25
"""Ratio of misfits, with gravity given and free, above which the data contradict it;
its square where flights are alike. Measured of 8 to 60 throws of one plan: 1.28 at most
of four gliders, 1.6 and more with x and z exchanged."""
_STILL = 0.11
"""Travel below which a pitch may be 57.3 times too small, as radians taken for degrees:
0.38 and more in 150 sets of one to forty flights [rad]."""
_PATH = 0.01
"""Median angle of attack below which the pitch is taken for that of the path [rad]; the
plate of the default glider needs 0.15 at 7 m/s to carry it."""
_FORCE = 10.0
"""Ratio of the wing's measured force to that of the vehicle, or its inverse, that
passes. The smallest step to another unit, of an area in dm², is 100, and 10 is halfway.
A wing's lift slope is at most 2 pi, 3.1 times that of the plate, and a mass half as
large doubles it; the largest mass of the library makes it 0.18 (tests: 0.18 to 7.2)."""
_TAIL = 30.0
"""The same for the elevator's effect on the pitch. Lengths in mm are 1000 times off,
areas in dm² 100 times; the strongest effects of the library make it 0.07 to 2.6."""
SIGNIFICANT = 6.0  # Standard errors above which the elevator's effect is known.

_UNITS = {
    1e-3: "mass in g",
    1e2: "wing_area in dm²",
    1e4: "wing_area in cm²",
    1e6: "wing_area in mm²",
}
"""Units of a vehicle by the factor that they make its wing's force per mass too large.
"""


def check_frame(campaign: Campaign, motions: Motions) -> None:
    """Refuses columns that are certainly turned or in another unit.

    Angles that may be so pass, and so do flights that are too few to show anything.
    """
    if len(motions.joined.time) < _MIN_ROWS or len(campaign.flights) < _MIN_FLIGHTS:
        return
    _check_columns(campaign)
    _check_unit_of_pitch(campaign, motions)
    _check_path(campaign, motions)
    _check_down(campaign, motions)
    _check_ahead(campaign, motions)
    _check_force(campaign, motions)


def check_tail(campaign: Campaign, motions: Motions) -> None:
    """Refuses a vehicle whose elevator turns it by another order than measured.

    With the air's density ρ, the elevator's area S, its distance l from the center of
    mass and the inertia I, the elevator turns the glider by ρ S l / I V² times its
    angle. Lengths and times must have been checked: they are squared here.
    """
    names = {"elevator_area", "pitch_inertia"}
    if campaign.elevator != "servo" or not names <= campaign.vehicle.keys():
        return
    vehicle = vars(GliderParameters()) | campaign.vehicle
    arm = vehicle["hinge_offset"] + vehicle["elevator_offset"]
    area = vehicle["elevator_area"]
    inertia = vehicle["pitch_inertia"]
    given = vehicle["air_density"] * area * arm / inertia
    fit = fit_elevator(campaign, motions)
    ratio = abs(fit.gain) / given
    if abs(fit.effect) > SIGNIFICANT and not 1.0 / _TAIL < ratio < _TAIL:
        campaign.refuse(
            f"the tail of 'elevator_area' {area:g} m², {arm:g} m "
            f"behind ('hinge_offset' + 'elevator_offset'), at a 'pitch_inertia' of "
            f"{inertia:g} kg m² contradicts the measured pitch accelerations by a "
            f"factor of {max(ratio, 1.0 / ratio):.2g}; expected m², m and kg m²."
        )


def calc_misfit(campaign: Campaign) -> float:
    """Misfit of the forces [m/s²] under the pitch and the gravity of a campaign.

    With a servo it is multiplied by the share of the pitch accelerations that the
    elevator and the flow do not explain.
    """
    motions = measure_motions(campaign.flights, {})
    misfit = fit_forces(motions.joined, campaign.gravity, signs=(1,)).misfit
    if campaign.elevator != "servo":
        return misfit
    turning = motions.joined.acceleration[:, 2]
    size = np.sqrt(np.mean(turning**2))
    left = fit_elevator(campaign, motions).misfit
    return misfit * left / max(size, 1e-12)


def _check_columns(campaign: Campaign) -> None:
    """Refuses a column that never moves."""
    travels = [np.ptp(flight.pose, axis=0) for flight in campaign.flights]
    widest = np.max(travels, axis=0)
    for travel, (name, least) in zip(widest, _LEAST.items(), strict=True):
        if travel < least:
            campaign.refuse(
                f"column '{name}' does not change in any flight; "
                "expected one that moves with the glider."
            )


def _check_unit_of_pitch(campaign: Campaign, motions: Motions) -> None:
    """Refuses a pitch in degrees, or one that was taken for degrees.

    A pitch that spans an implausible angle is converted; it is refused if forces then
    fit clearly better.
    """
    motion = motions.joined
    pitch = motion.pose[:, 2]
    degree = np.deg2rad(1.0)
    if np.ptp(np.percentile(pitch, [2, 98])) > np.pi:
        gain = degree
        clearly = 2.0
        words = "in degrees"
    elif np.ptp(pitch) < _STILL:
        gain = 1.0 / degree
        clearly = 1.2
        words = "57.3 times as large"
    else:
        return
    converted = motion._replace(pose=motion.pose * [1.0, 1.0, gain])
    if clearly * fit_forces(converted).misfit < motions.fit.misfit:
        campaign.refuse(
            f"column 'pitch' fits the motion {words} (it is read as {pitch.min():.3g} "
            f"to {pitch.max():.3g} rad); expected the unit that it is logged in, "
            "degrees or radians."
        )


def _check_path(campaign: Campaign, motions: Motions) -> None:
    """Refuses a pitch that was made from the path: it is no attitude.

    The path may count as positive up or down; whole turns are none.
    """
    motion = motions.joined
    pitch = motion.pose[:, 2]
    vx, vz, _ = motion.velocity.T
    path = np.arctan2(vz, vx)
    for down in (pitch, -pitch):
        apart = np.angle(np.exp(1j * (path + down)))
        median = np.median(np.abs(apart))
        if median < _PATH:
            campaign.refuse(
                f"column 'pitch' is the direction of the path (they "
                f"differ by {median:.2g} rad); expected the measured attitude."
            )


def _check_down(campaign: Campaign, motions: Motions) -> None:
    """Refuses flights that fall up, or to a side.

    The free constant must point elsewhere, and gravity along -z fit clearly worse:
    forces of the air may stand in for a part of the constant.
    """
    if motions.confirm(campaign.gravity):
        return
    free = motions.fit
    x, z = free.constant
    angle = abs(np.arctan2(x, -z))
    given = fit_forces(motions.joined, campaign.gravity)
    clearly = _CLEARLY**2 if motions.are_alike else _CLEARLY
    if given.misfit < clearly * free.misfit or angle <= _UPRIGHT:
        return
    fall = np.hypot(x, z)
    if np.pi - angle <= _UPRIGHT:
        campaign.refuse(
            f"frame: 'up' has the wrong sign: the flights fall along "
            f"+z, at {fall:.3g} m/s²; expected column 'z' to point up."
        )
    toward = "+x" if x > 0.0 else "-x"
    campaign.refuse(
        f"the flights fall along {toward}, at {fall:.3g} m/s²; "
        "expected 'z' to point up and 'x' along the throw (are they exchanged?)."
    )


def _check_ahead(campaign: Campaign, motions: Motions) -> None:
    """Refuses flights along -x, or tail first."""
    is_ahead = motions.calc_heading(motions.fit.sign) >= 0.0
    is_back = np.mean(motions.joined.velocity[:, 0]) < 0.0
    if is_back and is_ahead:
        campaign.refuse(
            "the flights go along -x, with the nose there; "
            "expected 'x' to point along the throw."
        )
    if is_back:
        campaign.refuse(
            "frame: 'forward' has the wrong sign: the flights go "
            "along -x, tail first; expected column 'x' to point along the throw (do "
            "the rows run backwards?)."
        )
    if not is_ahead:
        campaign.refuse(
            "the flights go tail first (column 'pitch' is off by "
            "half a turn); expected pitch 0 to mean the nose along x."
        )


def _check_force(campaign: Campaign, motions: Motions) -> None:
    """Refuses a vehicle whose wing force is of another order than measured.

    Per mass and V² it is ρ S / m by the air's density, the wing's area and the mass.
    An area or a mass alone counts too: the other is fitted about that of the nominal
    glider. Without both, forces per mass say all.
    """
    assumed = [name for name in ("mass", "wing_area") if name not in campaign.vehicle]
    if len(assumed) == 2:
        return
    usual = GliderParameters()
    vehicle = vars(usual) | campaign.vehicle
    mass = vehicle["mass"]
    area = vehicle["wing_area"]
    density = vehicle["air_density"]
    given = density * area / mass
    measured = -motions.fit.forces[0]
    if measured <= 0.0 or 1.0 / _FORCE < measured / given < _FORCE:
        return

    # Name the unit that comes closest, unless the density is at fault.
    excess = given / measured
    unit = min(_UNITS, key=lambda factor: abs(math.log(excess / factor)))
    hint = ""
    if abs(math.log(density / usual.air_density)) > math.log(_FORCE):
        hint = f" at an air_density of {density:g} kg/m³"
    elif abs(math.log(excess / unit)) <= math.log(_FORCE):
        hint = f" ({_UNITS[unit]}?)"
        excess = unit
    if assumed:
        hint += f"; '{assumed[0]}' is not specified, that is assumed"
    campaign.refuse(
        f"the wing loading {mass:g} kg / {area:g} m² = "
        f"{mass / area:.2g} kg/m² contradicts the measured forces by a factor of "
        f"{max(excess, 1.0 / excess):.0f}{hint}; expected kg, m² and kg/m³."
    )
