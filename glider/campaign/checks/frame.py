"""Do flights fall down, nose ahead, at the gravity and with the signs that are claimed?

All checks ask one fitted description of the flights, `Motions`. Its free fit determines
gravity, whose direction shows which way is down (its size is checked by `check_fall`).
`check_frame` refuses axes that are certainly turned; a turned angle is traced later
(`glider.sysid.search.signs`). `check_signs` refuses a mapping whose axes or signs the
flights contradict: the forces of the air must agree with the pitch as mapped, fitted
with either sign and with other columns in its place, and the elevator must turn the
glider, and follow its commands, in the direction that the mapping specifies.

Measured margins: over 20 simulated campaigns and a measured one the direction of
gravity is off by at most 0.07 rad, and with strong effects of the library by 0.55 rad
where it is determined at all; a marker 0.36 m off and a strong stall leave it
undetermined, which `_CLEARLY` detects. The wrong sign of the pitch raises the misfit by
1.57 to 12 from three flights on, the elevator's effect has its sign by 16 standard
errors or more, and its rate correlates with the commands by 0.94.
"""

import collections
import math
from collections.abc import Sequence

import numpy as np

from glider.campaign.checks import forces
from glider.campaign.checks.forces import Motions, check_fall, measure_motions
from glider.campaign.checks.rows import find_faults
from glider.campaign.checks.servo import (
    Elevator,
    check_follows,
    follow_sign,
    measure_elevators,
)
from glider.campaign.checks.travel import check_travel
from glider.campaign.logs import Campaign
from glider.physics.parameters import GliderParameters

_MIN_FLIGHTS = 3
"""Flights that show axes: one alone determines no gravity, and may fit anything."""
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
SIGNIFICANT = 6.0  # Standard errors above which the elevator's effect is known.
_DISAGREES = 1.2  # Ratio of misfits above which the data contradict the mapping.
_MIN_SIGN_ROWS = 30  # Accelerations that forces are fitted to, at least.
_ASTRAY = 1.0  # Median roll or yaw above which the body's axes are wrong [rad].
_ASIDE = 0.2  # Of gravity; throws: 0.04 sideways, with y and z exchanged 0.46.
_STEEP = 2.0  # Ratio of height to way above which forces must show what is up.
_AHEAD = 0.4  # Least mean cosine of the angle of attack: within 66° of the way.
_STRONGEST = 7.5
"""Strength of an elevator above which its angles are 57 times too small. Measured: 1.4
at most in 47 simulated campaigns, parts of them and strong effects; this is √57."""
_UNDECIDED = "the flights do not show which sign the {} has: check that it is right"

_UNITS = {
    1e-3: "mass in g",
    1e2: "wing_area in dm²",
    1e4: "wing_area in cm²",
    1e6: "wing_area in mm²",
}
"""Units of a vehicle by the factor that they make its wing's force per mass too large.
"""


def check_frame(campaign: Campaign, motions: Motions) -> None:
    """Refuses columns that are certainly turned or in another unit; angles pass."""
    if len(motions.joined.time) < _MIN_ROWS or len(campaign.flights) < _MIN_FLIGHTS:
        return
    _check_columns(campaign, motions)
    _check_path(campaign, motions)
    _check_down(campaign, motions)
    _check_ahead(campaign, motions)
    _check_force(campaign, motions)


def check_tail(campaign: Campaign, motions: Motions) -> tuple[str, ...]:
    """Refuses a vehicle whose elevator turns it by another order than measured.

    After lengths and times were checked, which are squared here.
    """
    names = {"elevator_area", "pitch_inertia"}
    if campaign.elevator != "servo" or not names <= campaign.vehicle.keys():
        return ()
    vehicle = vars(GliderParameters()) | campaign.vehicle
    arm = vehicle["hinge_offset"] + vehicle["elevator_offset"]
    area = vehicle["elevator_area"]
    inertia = vehicle["pitch_inertia"]
    given = vehicle["air_density"] * area * arm / inertia
    fit = forces.fit_elevator(campaign, motions)
    ratio = abs(fit.gain) / given
    if abs(fit.effect) > SIGNIFICANT and not 1.0 / _TAIL < ratio < _TAIL:
        campaign.refuse(
            f"the tail of 'elevator_area' {area:g} m², {arm:g} m "
            f"behind ('hinge_offset' + 'elevator_offset'), at a 'pitch_inertia' of "
            f"{inertia:g} kg m² contradicts the measured pitch accelerations by a "
            f"factor of {max(ratio, 1.0 / ratio):.2g}; expected m², m and kg m²."
        )
    return ()


def calc_misfit(campaign: Campaign) -> float:
    """Misfit of forces [m/s²], times the share of moments that is left if a servo."""
    motions = forces.measure_motions(campaign.flights, {})
    motion = motions.joined
    down = np.array([0.0, -campaign.gravity])
    misfit = forces.fit_forces(motion, down, signs=(1,)).misfit
    if campaign.elevator != "servo":
        return misfit
    turning = float(np.sqrt(np.mean(motion.acceleration[:, 2] ** 2)))
    left = forces.fit_elevator(campaign, motions).misfit
    return misfit * left / max(turning, 1e-12)


def _check_columns(campaign: Campaign, motions: Motions) -> None:
    """Refuses a column that never moves, or a pitch in degrees."""
    travels = [np.ptp(flight.pose, axis=0) for flight in campaign.flights]
    widest = np.max(travels, axis=0)
    for travel, (name, least) in zip(widest, _LEAST.items(), strict=True):
        if travel < least:
            campaign.refuse(
                f"column '{name}' does not change in any flight; "
                "expected one that moves with the glider."
            )
    motion = motions.joined
    pitch = motion.pose[:, 2]
    degree = np.pi / 180.0
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
    other = motion._replace(pose=motion.pose * [1.0, 1.0, gain])
    if clearly * forces.fit_forces(other).misfit < motions.fit.misfit:
        campaign.refuse(
            f"column 'pitch' fits the motion {words} (it is read as {pitch.min():.3g} "
            f"to {pitch.max():.3g} rad); expected the unit that it is logged in, "
            "degrees or radians."
        )


def _check_path(campaign: Campaign, motions: Motions) -> None:
    """Refuses a pitch that was made from the path: it is no attitude."""
    motion = motions.joined
    vx, vz, _ = motion.velocity.T
    path = np.arctan2(vz, vx)
    pitch = motion.pose[:, 2]
    for down in (pitch, -pitch):
        apart = np.angle(np.exp(1j * (path + down)))
        median = float(np.median(np.abs(apart)))
        if median < _PATH:
            campaign.refuse(
                f"column 'pitch' is the direction of the path (they "
                f"differ by {median:.2g} rad); expected the measured attitude."
            )


def _check_down(campaign: Campaign, motions: Motions) -> None:
    """Refuses flights that fall up, or to a side."""
    fit = motions.fit
    gravity = campaign.gravity
    x, z = fit.constant
    if np.hypot(x, z + gravity) < _NEAR * gravity:
        return
    given = forces.fit_forces(motions.joined, np.array([0.0, -gravity]))
    angle = abs(float(np.arctan2(x, -z)))
    clearly = _CLEARLY**2 if motions.are_alike else _CLEARLY
    if given.misfit < clearly * fit.misfit or angle <= _UPRIGHT:
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
    is_back = bool(np.mean(motions.joined.velocity[:, 0]) < 0.0)
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
    measured = -float(motions.fit.forces[0])
    if measured <= 0.0 or 1.0 / _FORCE < measured / given < _FORCE:
        return
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


def check_signs(campaign: Campaign) -> tuple[str, ...]:
    """Reports what could not be decided; raises InputError where signs are wrong."""
    masks = find_faults(campaign).masks
    motions = measure_motions(campaign.flights, masks)
    _check_release(campaign)
    _check_climb(campaign, motions)
    check_frame(campaign, motions)
    if len(motions.joined.time) < _MIN_SIGN_ROWS:
        return ("too few rows to check the signs of the mapping",)
    undecided = _check_pitch(campaign, motions)
    elevators = measure_elevators(campaign, masks)
    if elevators:
        check_follows(campaign, elevators)
        undecided += _check_elevator(campaign, motions, elevators)
    undecided += check_fall(campaign, motions, says_unknown=True)
    undecided += check_travel(campaign, elevators)
    return undecided + check_tail(campaign, motions)


def _check_release(campaign: Campaign) -> None:
    """Refuses a body on its side or sideways, and flights that fall to a side."""
    early = []
    rolls = []
    bends = []
    for flight in campaign.flights:
        if flight.attitude is not None:
            time = flight.time - flight.time[0]
            across = np.column_stack([flight.attitude[:, 0], flight.pose[:, 1]])
            early.append(flight.attitude[time < forces.START, 1:])
            rolls.append(flight.attitude[:, 1])
            bends.append(2.0 * np.polyfit(time, across, 2)[0])
    if not early:
        return
    # Whole turns are none: an attitude may have jumped by half turns.
    angles = np.angle(np.exp(1j * np.concatenate(early)))
    median = np.median(np.abs(angles), axis=0)
    for name, field, angle in zip(
        ("roll", "yaw"), ("top", "nose"), median, strict=True
    ):
        if angle > _ASTRAY:
            campaign.refuse(
                f"frame: with these axes the {name} is "
                f"{np.degrees(angle):.0f}° at release; expected the right '{field}' "
                "(the axis of the body that points there), 'rotation' or 'up'."
            )
    bank = np.median(np.abs(np.concatenate(rolls)))
    aside, fall = np.abs(np.median(bends, axis=0))
    if aside > max(fall, campaign.gravity * (np.tan(bank) + _ASIDE)):
        campaign.refuse(
            f"frame: the flights fall sideways, at {aside:.3g} m/s², "
            "more than a bank explains; expected 'z' or 'up' to point up."
        )


def _check_climb(campaign: Campaign, motions: Motions) -> None:
    """Refuses flights along the vertical whose fall does not confirm it."""
    ways = [flight.pose[-1, :2] - flight.pose[0, :2] for flight in campaign.flights]
    along, up = np.median(np.abs(ways), axis=0)
    if up <= _STEEP * along:
        return
    if len(motions.joined.time) >= _MIN_SIGN_ROWS:
        x, z = motions.fit.constant
        if np.hypot(x, z + campaign.gravity) < _NEAR * campaign.gravity:
            return
    campaign.refuse(
        f"frame: the flights go {up:.3g} m along 'up' and "
        f"{along:.3g} m along the throw, which forces do not confirm; expected "
        "most of the way along the throw ('up', 'forward', or a column 'y')."
    )


def _check_pitch(campaign: Campaign, motions: Motions) -> tuple[str, ...]:
    """Refuses a pitch with the wrong sign, or another angle in its place."""
    heading = motions.calc_heading(1)
    if heading < _AHEAD:
        campaign.refuse(
            f"the nose is {np.degrees(np.arccos(heading)):.0f}° off "
            "the way that the flights go; expected pitch 0 to mean the nose along the "
            "throw (frame: nose, pitch)."
        )
    motion = motions.joined
    down = np.array([0.0, -campaign.gravity])
    own = forces.fit_forces(motion, down, signs=(1,)).misfit
    turned = forces.fit_forces(motion, down, signs=(-1,)).misfit
    if turned * _DISAGREES < own:
        campaign.refuse(
            f"frame: the sign of the pitch is reversed: with the "
            f"sign turned the forces fit {own / turned:.2g} times as well (pitch: "
            "nose_up or nose_down; with attitudes: nose, top or rotation)."
        )
    if len(campaign.flights) >= _MIN_FLIGHTS:
        for name, angle in _join_other_angles(campaign, motions).items():
            pose = np.column_stack([motion.pose[:, :2], angle])
            misfit = forces.fit_forces(motion._replace(pose=pose), down).misfit
            if misfit * _DISAGREES < own:
                campaign.refuse(
                    f"columns: with '{name}' in its place the pitch "
                    f"fits the motion {own / misfit:.2g} times as well; are they "
                    "exchanged?"
                )
    return (_UNDECIDED.format("pitch"),) if own * _DISAGREES > turned else ()


def _join_other_angles(campaign: Campaign, motions: Motions) -> dict[str, np.ndarray]:
    """The other logged angles at the rows of the joined motions."""
    angles = collections.defaultdict(list)
    for flight, motion in zip(campaign.flights, motions.each, strict=True):
        logged = {"elevator": flight.elevator}
        if flight.attitude is not None:
            logged |= {"roll": flight.attitude[:, 1], "yaw": flight.attitude[:, 2]}
        for name, values in logged.items():
            if values is not None:
                angles[name].append(np.interp(motion.time, flight.time, values))
    return {name: np.concatenate(parts) for name, parts in angles.items()}


def _check_elevator(
    campaign: Campaign, motions: Motions, elevators: Sequence[Elevator]
) -> tuple[str, ...]:
    """Refuses an elevator or commands of the wrong sign."""
    fit = forces.fit_elevator(campaign, motions)
    if fit.strength > _STRONGEST and abs(fit.effect) > SIGNIFICANT:
        campaign.refuse(
            f"columns: the elevator turns the glider "
            f"{fit.strength:.0f} times as much as a tail at these angles can; expected "
            "the unit that it and its commands are logged in (degrees or radians)."
        )
    if fit.effect > SIGNIFICANT:
        campaign.refuse(
            f"a positive elevator turns the nose down (by "
            f"{fit.effect:.0f} standard errors); expected another sign (frame: "
            "elevator) or another 'clock'."
        )
    if follow_sign(elevators) < 0:
        campaign.refuse(
            "frame: the elevator turns against its commands; "
            "expected the sign of one to be the other (command, elevator)."
        )
    return (_UNDECIDED.format("elevator"),) if fit.effect > -SIGNIFICANT else ()
