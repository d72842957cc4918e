"""Do flights contradict the axes and signs of an import's mapping?

`check_signs` repeats the checks of the frame and adds those of what a mapping decides:
the axes of the body, the vertical, the sign of the pitch (the forces of the air must
agree with it as mapped, fitted with either sign and with other columns in its place),
and the elevator, which must turn the glider, and follow its commands, in the direction
that the mapping specifies. What the flights do not show it reports.

Measured margins: the wrong sign of the pitch raises the misfit by 1.57 to 12 from three
flights on, the elevator's effect has its sign by 16 standard errors or more, and its
rate correlates with the commands by 0.94.
"""

import collections
from collections.abc import Sequence

import numpy as np

from glider.campaign.checks.fall import check_fall
from glider.campaign.checks.forces import (
    START,
    Motions,
    fit_elevator,
    fit_forces,
    measure_motions,
)
from glider.campaign.checks.frame import SIGNIFICANT, check_frame, check_tail
from glider.campaign.checks.rows import find_faults
from glider.campaign.checks.servo import (
    Elevator,
    check_follows,
    follow_sign,
    measure_elevators,
)
from glider.campaign.checks.travel import check_travel
from glider.campaign.logs import Campaign

_MIN_FLIGHTS = 3  # One alone may fit any angle in place of its pitch.
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
    check_tail(campaign, motions)
    return undecided


def _check_release(campaign: Campaign) -> None:
    """Refuses a body on its side or sideways, and flights that fall to a side."""
    early = []
    rolls = []
    bends = []
    for flight in campaign.flights:
        if flight.attitude is not None:
            time = flight.time - flight.time[0]
            across = np.column_stack([flight.attitude[:, 0], flight.pose[:, 1]])
            early.append(flight.attitude[time < START, 1:])
            rolls.append(flight.attitude[:, 1])
            bends.append(2.0 * np.polyfit(time, across, 2)[0])
    if not early:
        return

    # Whole turns are none: an attitude may have jumped by half turns.
    angles = np.angle(np.exp(1j * np.concatenate(early)))
    roll, yaw = np.median(np.abs(angles), axis=0)
    for name, field, angle in (("roll", "top", roll), ("yaw", "nose", yaw)):
        if angle > _ASTRAY:
            campaign.refuse(
                f"frame: with these axes the {name} is "
                f"{np.degrees(angle):.0f}° at release; expected the right '{field}' "
                "(the axis of the body that points there), 'rotation' or 'up'."
            )

    # Flights may fall to a side as fast as down, or as a bank explains.
    bank = np.median(np.abs(np.concatenate(rolls)))
    aside, fall = np.abs(np.median(bends, axis=0))
    most = campaign.gravity * (np.tan(bank) + _ASIDE)
    if aside > max(fall, most):
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
    has_rows = len(motions.joined.time) >= _MIN_SIGN_ROWS
    if has_rows and motions.confirm(campaign.gravity):
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
    gravity = campaign.gravity
    own = fit_forces(motion, gravity, signs=(1,)).misfit
    turned = fit_forces(motion, gravity, signs=(-1,)).misfit
    if turned * _DISAGREES < own:
        campaign.refuse(
            f"frame: the sign of the pitch is reversed: with the "
            f"sign turned the forces fit {own / turned:.2g} times as well (pitch: "
            "nose_up or nose_down; with attitudes: nose, top or rotation)."
        )
    if len(campaign.flights) >= _MIN_FLIGHTS:
        _check_other_angles(campaign, motions, own)
    return (_UNDECIDED.format("pitch"),) if own * _DISAGREES > turned else ()


def _check_other_angles(campaign: Campaign, motions: Motions, own: float) -> None:
    """Refuses a pitch whose misfit is clearly larger than that of another column."""
    angles = collections.defaultdict(list)
    for flight, motion in zip(campaign.flights, motions.each, strict=True):
        logged = {}
        if flight.elevator is not None:
            logged["elevator"] = flight.elevator
        if flight.attitude is not None:
            _, logged["roll"], logged["yaw"] = flight.attitude.T
        for name, values in logged.items():
            angles[name].append(np.interp(motion.time, flight.time, values))

    joined = motions.joined
    for name, parts in angles.items():
        pose = np.column_stack([joined.pose[:, :2], np.concatenate(parts)])
        misfit = fit_forces(joined._replace(pose=pose), campaign.gravity).misfit
        if misfit * _DISAGREES < own:
            campaign.refuse(
                f"columns: with '{name}' in its place the pitch "
                f"fits the motion {own / misfit:.2g} times as well; are they "
                "exchanged?"
            )


def _check_elevator(
    campaign: Campaign, motions: Motions, elevators: Sequence[Elevator]
) -> tuple[str, ...]:
    """Refuses an elevator or commands of the wrong sign."""
    fit = fit_elevator(campaign, motions)
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
