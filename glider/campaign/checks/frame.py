"""Do flights fall down, nose ahead, at the gravity that campaign.yaml specifies?

The fit of `forces` determines gravity, whose direction shows which way is down; its
size is checked in `fall`. The better sign of the pitch is taken: a turned angle is
traced later (`glider.sysid.search.signs`) and is no fault of the frame.

Measured margins: over 20 simulated campaigns and a measured one the direction of
gravity is off by at most 0.07 rad, and with strong effects of the library by 0.55 rad
where it is determined at all; a marker 0.36 m off and a strong stall leave it
undetermined, which `_CLEARLY` detects.
"""

import dataclasses
import math

import numpy as np

from glider.campaign.checks import forces
from glider.campaign.checks.forces import ForceFit
from glider.campaign.checks.masks import Masks
from glider.campaign.checks.motion import Motion, are_alike
from glider.campaign.logs import Campaign
from glider.errors import InputError
from glider.physics.parameters import GliderParameters

_MIN_FLIGHTS = 3  # One glide alone determines no gravity; a split needs as many.
_MIN_ROWS = 60  # Accelerations that the constant is fitted to, at least.
_UPRIGHT = 1.1
"""Angle of the constant from straight down that passes [rad]: a frame may be tilted by
0.5 (frame_tilt), an exchange of axes turns it by 1.57."""
_NEAR = 0.2  # Part of gravity by which the constant may be off without a question.
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
_SURELY = 6.0  # Standard errors above which the elevator's effect is known.
_UNITS = {
    1e-3: "mass in g",
    1e2: "wing_area in dm²",
    1e4: "wing_area in cm²",
    1e6: "wing_area in mm²",
}
"""Units of a vehicle by the factor that they make its wing's force per mass too large.
"""


def check_frame(
    campaign: Campaign, masks: dict[str, Masks]
) -> tuple[Campaign, tuple[str, ...]]:
    """Corrects axes that are certainly turned, not angles; refuses what cannot be."""
    motions = [forces.usable_motion(f, masks) for f in campaign.flights]
    motion = forces.join(motions)
    if len(motion.time) < _MIN_ROWS or len(campaign.flights) < _MIN_FLIGHTS:
        return campaign, ()
    fit = forces.fit_forces(motion)
    _check_columns(campaign, motion, fit)
    _check_attitude(campaign, motion)
    warnings: list[str] = []
    shown = [motion for motion in motions if len(motion.time)]
    clearly = _CLEARLY**2 if are_alike(shown) else _CLEARLY
    turned = _check_down(campaign, motion, fit, clearly, warnings)
    _check_time(campaign, motion, fit)
    turned = _check_ahead(turned, forces.at_release(motions), fit, warnings)
    _check_force(campaign, fit)
    return turned, tuple(warnings)


def check_tail(campaign: Campaign, masks: dict[str, Masks]) -> tuple[str, ...]:
    """Refuses a vehicle whose elevator turns it by another order than measured.

    After lengths and times were checked, which are squared here.
    """
    names = "elevator_area", "pitch_inertia"
    if campaign.elevator != "servo" or not {*names} <= campaign.vehicle.keys():
        return ()
    vehicle = vars(GliderParameters()) | campaign.vehicle
    arm = vehicle["hinge_offset"] + vehicle["elevator_offset"]
    area, inertia = (vehicle[name] for name in names)
    given = vehicle["air_density"] * area * arm / inertia
    motions = {f.name: forces.usable_motion(f, masks) for f in campaign.flights}
    fit = forces.fit_elevator(campaign, motions)
    ratio = abs(fit.gain) / given
    if abs(fit.effect) > _SURELY and not 1.0 / _TAIL < ratio < _TAIL:
        raise InputError(
            f"{campaign.path}: the tail of 'elevator_area' {area:g} m², {arm:g} m "
            f"behind ('hinge_offset' + 'elevator_offset'), at a 'pitch_inertia' of "
            f"{inertia:g} kg m² contradicts the measured pitch accelerations by a "
            f"factor of {max(ratio, 1.0 / ratio):.2g}; expected m², m and kg m²."
        )
    return ()


def _check_columns(campaign: Campaign, motion: Motion, fit: ForceFit) -> None:
    """Refuses a column that never moves, or a pitch in degrees."""
    for k, (name, least) in enumerate(_LEAST.items()):
        if all(np.ptp(f.pose[:, k]) < least for f in campaign.flights):
            raise InputError(
                f"{campaign.path}: column '{name}' does not change in any flight; "
                "expected one that moves with the glider."
            )
    pitch = motion.pose[:, 2]
    wide = np.ptp(np.percentile(pitch, [2, 98])) > np.pi
    degree = np.pi / 180.0
    for possible, gain, clearly, words in (
        (wide, degree, 2.0, "in degrees"),
        (np.ptp(pitch) < _STILL, 1.0 / degree, 1.2, "57.3 times as large"),
    ):
        other = motion._replace(pose=motion.pose * [1.0, 1.0, gain])
        if possible and clearly * forces.fit_forces(other).misfit < fit.misfit:
            raise InputError(
                f"{campaign.path}: column 'pitch' fits the motion {words} (it is read "
                f"as {pitch.min():.3g} to {pitch.max():.3g} rad); expected the unit "
                "that it is logged in, degrees or radians."
            )


def _check_attitude(campaign: Campaign, motion: Motion) -> None:
    """Refuses a pitch that was made from the path: it is no attitude."""
    velocity = motion.velocity[:, :2]
    fast = motion.speed > 0.5 * np.median(motion.speed)
    for sign in (1, -1):
        body, normal = forces.body_axes(sign * motion.pose[:, 2])
        across = np.sum(velocity * normal, 1)
        along = np.sum(velocity * body, 1)
        median = float(np.median(np.abs(np.arctan2(across, along))[fast]))
        if median < _PATH:
            raise InputError(
                f"{campaign.path}: column 'pitch' is the direction of the path (they "
                f"differ by {median:.2g} rad); expected the measured attitude."
            )


def _check_down(
    campaign: Campaign,
    motion: Motion,
    fit: ForceFit,
    clearly: float,
    warnings: list[str],
) -> Campaign:
    """Turns z up; refuses another direction of the fall."""
    (x, z), gravity = fit.constant, campaign.gravity
    if np.hypot(x, z + gravity) < _NEAR * gravity:
        return campaign
    given = forces.fit_forces(motion, np.array([0.0, -gravity]))
    if given.misfit < clearly * fit.misfit:
        return campaign
    size = float(np.hypot(x, z))
    angle = float(np.arctan2(x, -z))
    if abs(angle) <= _UPRIGHT:
        return campaign
    if np.pi - abs(angle) > _UPRIGHT:
        toward = "+x" if x > 0.0 else "-x"
        raise InputError(
            f"{campaign.path}: the flights fall along {toward}, at {size:.3g} m/s²; "
            "expected 'z' to point up and 'x' along the throw (are they exchanged?)."
        )
    warnings.append(
        f"column 'z' pointed down (the flights fell along +z at {size:.3g} m/s²): "
        "it was turned; the angles were kept as they are"
    )
    return _turn(campaign, z=True)


def _check_time(campaign: Campaign, motion: Motion, fit: ForceFit) -> None:
    """Refuses flights that gain energy from still air: time runs backwards.

    A few glides do not determine gravity too: it must hold with the given one as well.
    """
    down = np.array([0.0, np.copysign(campaign.gravity, fit.constant[1])])

    def pushes(fit: ForceFit) -> bool:  # Measured: -0.7 or less.
        return bool(fit.forces[0] + fit.forces[3] > 0.2)

    if pushes(fit) and pushes(forces.fit_forces(motion, down)):
        raise InputError(
            f"{campaign.path}: the air pushes the gliders along instead of slowing "
            "them; expected rows in the order of time (do they run backwards?)."
        )


def _check_ahead(
    campaign: Campaign, motion: Motion, fit: ForceFit, warnings: list[str]
) -> Campaign:
    """Turns x ahead; refuses flights tail first."""
    heading = forces.calc_heading(motion, fit.sign)
    back = np.mean(motion.velocity[:, 0]) < 0.0
    if back and heading < 0.0:
        warnings.append(
            "column 'x' pointed backwards (the flights went along -x, tail first): "
            "it was turned; the angles were kept as they are"
        )
        return _turn(campaign, x=True)
    if back:
        raise InputError(
            f"{campaign.path}: the flights go along -x, with the nose there; "
            "expected 'x' to point along the throw."
        )
    if heading < 0.0:
        raise InputError(
            f"{campaign.path}: the flights go tail first (column 'pitch' is off by "
            "half a turn); expected pitch 0 to mean the nose along x."
        )
    return campaign


def _check_force(campaign: Campaign, fit: ForceFit) -> None:
    """Refuses a vehicle whose wing force is of another order than measured.

    An area or a mass alone counts too: the other is fitted about that of the nominal
    glider. Without both, forces per mass say all.
    """
    if campaign.vehicle.keys().isdisjoint(("wing_area", "mass")):
        return
    usual = GliderParameters()
    vehicle = vars(usual) | campaign.vehicle
    mass, area, density = (vehicle[n] for n in ("mass", "wing_area", "air_density"))
    given = density * area / mass
    measured = -float(fit.forces[0])
    if measured <= 0.0 or 1.0 / _FORCE < measured / given < _FORCE:
        return
    excess = given / measured
    unit = min(_UNITS, key=lambda factor: abs(math.log(excess / factor)))
    hint = f" ({_UNITS[unit]}?)"
    if abs(math.log(density / usual.air_density)) > math.log(_FORCE):
        unit = excess
        hint = f" at an air_density of {density:g} kg/m³"
    elif abs(math.log(excess / unit)) > math.log(_FORCE):
        unit = excess
        hint = ""
    assumed = [n for n in ("mass", "wing_area") if n not in campaign.vehicle]
    hint += f"; '{assumed[0]}' is not specified, that is assumed" if assumed else ""
    raise InputError(
        f"{campaign.path}: the wing loading {mass:g} kg / {area:g} m² = "
        f"{mass / area:.2g} kg/m² contradicts the measured forces by a factor of "
        f"{max(unit, 1.0 / unit):.0f}{hint}; expected kg, m² and kg/m³."
    )


def _turn(campaign: Campaign, *, x: bool = False, z: bool = False) -> Campaign:
    """Turns an axis of the campaign, and y with it: the frame stays right-handed.

    Of the measured attitude y turns, with the angle about the axis that turns.
    """
    signs = [-1.0 if x else 1.0, -1.0 if z else 1.0]
    flights = []
    for flight in campaign.flights:
        attitude = flight.attitude
        if attitude is not None:
            attitude = attitude * [-1.0, *signs]
        pose = flight.pose * [*signs, 1.0]
        flights.append(dataclasses.replace(flight, pose=pose, attitude=attitude))
    return dataclasses.replace(campaign, flights=tuple(flights))
