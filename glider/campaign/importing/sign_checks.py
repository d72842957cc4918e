"""Do the flights fly in the frame that a mapping specifies? Refused, with why, if not.

Beside axes, units and the fall (`glider.campaign.checks.frame`) signs are checked: the
forces of the air must agree with the pitch as mapped (fitted with either sign, and with
other columns in its place), and the elevator must turn the glider, and follow its
commands, in the direction that the mapping specifies.

Measured: over 20 simulated campaigns and a measured one the wrong sign of the pitch
raises the misfit by 1.57 to 12 from three flights on, the elevator's effect has its
sign by 16 standard errors or more, and its rate correlates with the commands by 0.94.
"""

from collections.abc import Sequence

import numpy as np

from glider.campaign.checks import forces
from glider.campaign.checks.clocks import check_clocks, follow_sign
from glider.campaign.checks.elevators import Elevator, measure_elevators
from glider.campaign.checks.fall import check_fall
from glider.campaign.checks.forces import Motions, fit_elevator, measure_motions
from glider.campaign.checks.frame import check_frame, check_tail
from glider.campaign.checks.motion import Motion
from glider.campaign.checks.rows import find_faults
from glider.campaign.checks.travel import check_travel
from glider.campaign.logs import Campaign
from glider.errors import InputError

CLEARLY = 1.2  # Ratio of misfits above which the data contradict the mapping.
SIGNIFICANT = 6.0  # Standard errors above which the elevator's effect has a sign.
MIN_FLIGHTS = 3  # One flight alone may fit anything.
_MIN_ROWS = 30  # Accelerations that forces are fitted to, at least.
_ASTRAY = 1.0  # Median roll or yaw above which the body's axes are wrong [rad].
_ASIDE = 0.2  # Of gravity; throws: 0.04 sideways, with y and z exchanged 0.46.
_STEEP = 2.0  # Ratio of height to way above which forces must show what is up.
_AHEAD = 0.4  # Least mean cosine of the angle of attack: within 66° of the way.
_STRONGEST = 7.5
"""Strength of an elevator above which its angles are 57 times too small. Measured: 1.4
at most in 47 simulated campaigns, parts of them and strong effects; this is √57."""
_UNDECIDED = "the flights do not show which sign the {} has: check that it is right"


def check_signs(campaign: Campaign) -> tuple[str, ...]:
    """Reports what could not be decided; raises InputError where signs are wrong."""
    masks = find_faults(campaign).masks
    motions = measure_motions(campaign.flights, masks)
    motion = motions.joined
    _check_attitude(campaign, motion)
    turned, warnings = check_frame(campaign, motions)
    if turned is not campaign:
        axis = "forward" if "'x'" in warnings[0] else "up"
        raise InputError(
            f"{campaign.path}: frame: '{axis}' has the wrong sign: "
            f"{warnings[0].partition(':')[0]}."
        )
    if len(motion.time) < _MIN_ROWS:
        return ("too few rows to check the signs of the mapping",)
    undecided = _check_pitch(campaign, motions)
    elevators = measure_elevators(campaign, masks)
    if elevators:
        check_clocks(campaign, elevators)
        undecided += _check_elevator(campaign, motions, elevators)
    undecided += check_fall(campaign, motions, says_unknown=True)
    return undecided + check_travel(campaign, elevators) + check_tail(campaign, motions)


def misfit_of(campaign: Campaign) -> float:
    """Misfit of forces [m/s²], times the share of moments that is left if a servo."""
    motions = measure_motions(campaign.flights, {})
    motion = motions.joined
    down = [0.0, -campaign.gravity]
    misfit = forces.fit_forces(motion, np.array(down), signs=(1,)).misfit
    if campaign.elevator != "servo":
        return misfit
    turning = float(np.sqrt(np.mean(motion.acceleration[:, 2] ** 2)))
    return misfit * fit_elevator(campaign, motions).misfit / max(turning, 1e-12)


def _check_attitude(campaign: Campaign, motion: Motion) -> None:
    """Refuses a body on its side or sideways, flights up or down, falls to a side."""
    tracks = [
        (f.time - f.time[0], np.column_stack([f.attitude, f.pose[:, 1]]))
        for f in campaign.flights
        if f.attitude is not None
    ]
    if tracks:
        early = np.concatenate([track[time < forces.START] for time, track in tracks])
        # Whole turns are none: an attitude may have jumped by half turns.
        roll, yaw = np.median(np.abs(np.angle(np.exp(1j * early[:, 1:3]))), axis=0)
        for name, angle, field in (("roll", roll, "top"), ("yaw", yaw, "nose")):
            if angle > _ASTRAY:
                raise InputError(
                    f"{campaign.path}: frame: with these axes the {name} is "
                    f"{np.degrees(angle):.0f}° at release; expected the right "
                    f"'{field}' (the axis of the body that points there), 'rotation' "
                    "or 'up'."
                )
        roll = np.median(np.abs(np.concatenate([track[:, 1] for _, track in tracks])))
        bends = [2.0 * np.polyfit(time, y[:, [0, 3]], 2)[0] for time, y in tracks]
        aside, fall = np.abs(np.median(bends, axis=0))
        if aside > max(fall, campaign.gravity * (np.tan(roll) + _ASIDE)):
            raise InputError(
                f"{campaign.path}: frame: the flights fall sideways, at {aside:.3g} "
                "m/s², more than a bank explains; expected 'z' or 'up' to point up."
            )
    ways = [f.pose[-1, :2] - f.pose[0, :2] for f in campaign.flights]
    along, up = np.median(np.abs(ways), axis=0)
    if up > _STEEP * along and not _shows_up(campaign, motion):
        raise InputError(
            f"{campaign.path}: frame: the flights go {up:.3g} m along 'up' and "
            f"{along:.3g} m along the throw, which forces do not confirm; expected "
            "most of the way along the throw ('up', 'forward', or a column 'y')."
        )


def _shows_up(campaign: Campaign, motion: Motion) -> bool:
    """Whether the forces fit clearly better than with another axis up."""
    if len(motion.time) < _MIN_ROWS:
        return False
    down = np.array([0.0, -campaign.gravity])
    own = forces.fit_forces(motion, down, signs=(1,)).misfit
    return own * CLEARLY < min(_with_other_ups(campaign, motion).values())


def _with_other_ups(campaign: Campaign, motion: Motion) -> dict[str, float]:
    """Misfits with other axes of the flights up."""
    ways = {"-z": [0.0, 1.0], "x": [-1.0, 0.0], "-x": [1.0, 0.0]}
    downs = {axis: campaign.gravity * np.array(way) for axis, way in ways.items()}
    return {a: forces.fit_forces(motion, down).misfit for a, down in downs.items()}


def _check_pitch(campaign: Campaign, motions: Motions) -> tuple[str, ...]:
    """Refuses a pitch with the wrong sign, or another angle in its place."""
    motion = motions.joined
    down = np.array([0.0, -campaign.gravity])
    heading = motions.calc_heading(1)
    if heading < _AHEAD:
        raise InputError(
            f"{campaign.path}: the nose is {np.degrees(np.arccos(heading)):.0f}° off "
            "the way that the flights go; expected pitch 0 to mean the nose along the "
            "throw (frame: nose, pitch)."
        )
    many = len(campaign.flights) >= MIN_FLIGHTS
    own = forces.fit_forces(motion, down, signs=(1,)).misfit
    turned = forces.fit_forces(motion, down, signs=(-1,)).misfit
    for axis, misfit in _with_other_ups(campaign, motion).items():
        if many and misfit * CLEARLY < min(own, turned):
            raise InputError(
                f"{campaign.path}: frame: 'up' is wrong: with {axis} of the flights in "
                f"its place the forces fit {min(own, turned) / misfit:.2g} times as "
                "well."
            )
    if turned * CLEARLY < own:
        raise InputError(
            f"{campaign.path}: frame: the sign of the pitch is reversed: with the "
            f"sign turned the forces fit {own / turned:.2g} times as well (pitch: "
            "nose_up or nose_down; with attitudes: nose, top or rotation)."
        )
    for name, other in _other_angles(campaign, motions).items():
        pose = np.column_stack([motion.pose[:, :2], other])
        misfit = forces.fit_forces(motion._replace(pose=pose), down).misfit
        if many and misfit * CLEARLY < own:
            raise InputError(
                f"{campaign.path}: columns: with '{name}' in its place the pitch fits "
                f"the motion {own / misfit:.2g} times as well; are they exchanged?"
            )
    return (_UNDECIDED.format("pitch"),) if own * CLEARLY > turned else ()


def _other_angles(campaign: Campaign, motions: Motions) -> dict[str, np.ndarray]:
    """The other logged angles at the rows of the joined motions."""
    angles: dict[str, list[np.ndarray]] = {}
    for flight, motion in zip(campaign.flights, motions.each, strict=True):
        none = None, None, None
        _, roll, yaw = none if flight.attitude is None else flight.attitude.T
        for name, values in ("roll", roll), ("yaw", yaw), ("elevator", flight.elevator):
            if values is not None:
                at = np.interp(motion.time, flight.time, values)
                angles.setdefault(name, []).append(at)
    return {name: np.concatenate(parts) for name, parts in angles.items()}


def _check_elevator(
    campaign: Campaign, motions: Motions, elevators: Sequence[Elevator]
) -> tuple[str, ...]:
    """Refuses an elevator or commands of the wrong sign."""
    effect, _, strength, _ = fit_elevator(campaign, motions)
    if strength > _STRONGEST and abs(effect) > SIGNIFICANT:
        raise InputError(
            f"{campaign.path}: columns: the elevator turns the glider {strength:.0f} "
            "times as much as a tail at these angles can; expected the unit that it "
            "and its commands are logged in (degrees or radians)."
        )
    if effect > SIGNIFICANT:
        raise InputError(
            f"{campaign.path}: a positive elevator turns the nose down (by "
            f"{effect:.0f} standard errors); expected another sign (frame: elevator) "
            "or another 'clock'."
        )
    if follow_sign(elevators) < 0:
        raise InputError(
            f"{campaign.path}: frame: the elevator turns against its commands; "
            "expected the sign of one to be the other (command, elevator)."
        )
    return (_UNDECIDED.format("elevator"),) if effect > -SIGNIFICANT else ()
