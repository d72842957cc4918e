"""Do flights fall down, nose ahead, at the gravity that campaign.yaml tells?

The air's force grows with the airspeed, gravity does not. So measured accelerations
are fitted, at all flights' rows at once, by

    a = c + |v - w| R(pitch) A R(pitch)ᵀ (v - w) + thrust + offset

with any constant vector c, any wind w and any 2 x 2 matrix A, of forces along the body
axis and normal to it: flat plates, drag, camber, a wrong mass, area or zero of the
pitch are all in A; thrust acts along the body axis, and the offset is that of the
tracked point from the center of mass. The constant c is gravity, and says which way is
down; it also knows the units, for a fall of 9.81 m/s² tells the scale of positions and
times. The fit is done with
either sign of the pitch and the better one taken: a turned angle is traced later
(`glider.sysid.search.signs`) and is no fault of the frame.

Measured margins: over 20 simulated campaigns and a measured one the direction of c is
off by at most 0.07 rad and its size by 12 %. With strong effects of the library (winds
of 3 m/s, a tilt of 0.5 rad, a thrust of the glider's weight) it is off by 0.55 rad and
by 38 % (half the mass) where it is determined at all; a marker 0.36 m off and a strong
stall leave it undetermined, which `_CLEARLY` knows.
"""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from glider.campaign.checks.masks import Masks
from glider.campaign.checks.motion import Motion, calc_motion
from glider.campaign.logs import Campaign, Flight
from glider.errors import InputError
from glider.physics.parameters import GliderParameters

_STRIDE = 3  # Rows from one acceleration to the next: those between are no news.
_MIN_FLIGHTS = 3  # One glide alone determines no gravity; a split needs as many.
_MIN_ROWS = 60  # Accelerations that the constant is fitted to, at least.
_UPRIGHT = 1.1
"""Angle of the constant from straight down that passes [rad]: a frame may be tilted by
0.5 (frame_tilt), an exchange of axes turns it by 1.57."""
_NEAR = 0.2  # Part of gravity by which the constant may be off without a question.
_SIZE = 1.9
"""Ratio of the constant to gravity, or its inverse, that passes."""
_LEAST = {"x": 0.01, "z": 0.01, "pitch": 1e-6}
"""Columns that change by less in every flight do not change [m, m, rad]."""
_CLEARLY = 1.25
"""Ratio of misfits, with gravity as told and with the constant free, from which on the
data contradict what is told."""
_PATH = 0.01
"""Median angle of attack below which the pitch is taken for that of the path [rad]; the
plate of the default glider needs 0.15 at 7 m/s to carry it."""
_ITERATIONS = 7
_WIND_AT = slice(7, 9)  # Columns of the wind, after forces, offsets and thrust.
_STEP = 0.01  # Of the wind, for slopes [m/s].
_WIND = 2.0  # Standard deviation of its prior, of the weight of one row [m/s].
_MAX_WIND = 6.0  # [m/s]
_FORCE = 10.0
"""Ratio of the wing's measured force to that of the vehicle, or its inverse, that
passes: mass and areas may be off by 6 (the library's bounds)."""


class ForceFit(NamedTuple):
    """Accelerations explained by a constant and forces of the air."""

    sign: int  # Of the pitch, +1 as logged.
    constant: np.ndarray  # (2,) in x and z of the log [m/s²].
    forces: np.ndarray  # (4,) A: normal, along by normal flow; alike by axial [1/m].
    wind: np.ndarray  # (2,) [m/s]
    misfit: float  # Robust RMS of what is left [m/s²].


def check_frame(
    campaign: Campaign, masks: dict[str, Masks]
) -> tuple[Campaign, tuple[str, ...]]:
    """Turns axes that are surely turned, and says so; refuses what cannot be.

    Angles are left as they are logged.

    Args:
        campaign: of flights in any axes.
        masks: rows to leave out, by the name of the flight.

    Raises:
        InputError: axes, units or gravity are wrong in a way that is not mended.
    """
    gravity = campaign.vehicle.get("gravity", GliderParameters().gravity)
    motion = join([usable_motion(f, masks) for f in campaign.flights])
    if len(motion.time) < _MIN_ROWS or len(campaign.flights) < _MIN_FLIGHTS:
        return campaign, ()
    _check_columns(campaign, motion)
    _check_attitude(campaign, motion)
    fit = fit_forces(motion)
    warnings: list[str] = []
    turned = _check_down(campaign, motion, fit, gravity, warnings)
    _check_time(campaign, motion, fit, gravity)
    turned = _check_ahead(turned, motion, fit, warnings)
    _check_force(campaign, fit)
    return turned, tuple(warnings)


def usable_motion(flight: Flight, masks: dict[str, Masks]) -> Motion:
    """Returns the motion over the rows of a flight that may be used."""
    usable = masks[flight.name].usable
    return calc_motion(flight.time[usable], flight.pose[usable], stride=_STRIDE)


def join(motions: list[Motion]) -> Motion:
    """Returns the motions of flights one after the other."""
    return Motion(*(np.concatenate(parts) for parts in zip(*motions, strict=True)))


def fit_forces(
    motion: Motion, down: np.ndarray | None = None, signs: Sequence[int] = (1, -1)
) -> ForceFit:
    """Fits the constant and the forces with the better sign of the pitch.

    Args:
        motion: of many flights.
        down: the constant [m/s²], where it is not to be fitted.
        signs: of the pitch that are tried.
    """
    return min((_fit(motion, s, down) for s in signs), key=lambda fit: fit.misfit)


def calc_heading(motion: Motion, sign: int) -> float:
    """Returns the mean cosine of the angle of attack, weighted by speed²: 1 ahead."""
    body, _ = _axes(sign * motion.pose[:, 2])
    velocity = motion.velocity[:, :2]
    along = np.sum(velocity * body, axis=1) * motion.speed
    return float(np.sum(along) / max(np.sum(motion.speed**2), 1e-12))


def _axes(pitch: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns body axis and wing normal, (k, 2) each, in x and z."""
    body = np.stack([np.cos(pitch), -np.sin(pitch)], axis=1)
    normal = np.stack([np.sin(pitch), np.cos(pitch)], axis=1)
    return body, normal


def _fit(motion: Motion, sign: int, down: np.ndarray | None) -> ForceFit:
    """Fits by Gauss-Newton (the wind is not linear) with Huber's weights."""
    wind, forces = np.zeros(2), np.zeros(4)
    offset = _offset_columns(motion, sign)
    thrust = _axes(sign * motion.pose[:, 2])[0]
    constants = [np.tile(axis, (len(motion.time), 1)) for axis in np.eye(2)]
    if down is not None:
        constants = []
    target = motion.acceleration[:, :2] - (0.0 if down is None else down)
    weight = np.ones(target.size)
    for iteration in range(_ITERATIONS):
        flows = _force_columns(motion, sign, wind)
        slopes = [
            np.tensordot(forces, _force_columns(motion, sign, wind + step), 1)
            - np.tensordot(forces, flows, 1)
            for step in _STEP * np.eye(2)
        ]
        columns = [*flows, *offset, thrust, *slopes, *constants]
        design = np.stack(columns, axis=2).reshape(target.size, -1)
        prior = np.zeros((2, design.shape[1]))
        prior[:, _WIND_AT] = np.eye(2) * _STEP / _WIND
        solution = np.linalg.lstsq(
            np.concatenate([design * weight[:, None], prior]),
            np.concatenate([target.reshape(-1) * weight, -wind / _WIND]),
            rcond=None,
        )[0]
        rest = target.reshape(-1) - design @ solution
        scale = 1.4826 * np.median(np.abs(rest)) + 1e-9
        weight = np.sqrt(np.minimum(1.0, 2.0 * scale / np.maximum(np.abs(rest), 1e-12)))
        forces = solution[:4]
        if iteration > 0:  # The first has no forces yet that a wind could change.
            change = _STEP * solution[_WIND_AT]
            change *= min(1.0, 2.0 / max(float(np.hypot(*change)), 1e-12))
            wind = np.clip(wind + change, -_MAX_WIND, _MAX_WIND)
    misfit = float(np.sqrt(np.mean((weight * rest) ** 2)))
    constant = solution[_WIND_AT.stop :] if down is None else down
    return ForceFit(sign, constant, forces, wind, misfit)


def _force_columns(motion: Motion, sign: int, wind: np.ndarray) -> np.ndarray:
    """Returns accelerations (4, k, 2) by each entry of the matrix A."""
    body, normal = _axes(sign * motion.pose[:, 2])
    air = motion.velocity[:, :2] - wind
    speed = np.hypot(air[:, 0], air[:, 1])
    return np.stack(
        [
            (speed * np.sum(air * flow, axis=1))[:, None] * force
            for flow in (normal, body)
            for force in (normal, body)
        ]
    )


def _offset_columns(motion: Motion, sign: int) -> list[np.ndarray]:
    """Returns accelerations (k, 2) of points 1 m ahead of and above the center."""
    body, normal = _axes(sign * motion.pose[:, 2])
    square = motion.velocity[:, 2:] ** 2
    turning = sign * motion.acceleration[:, 2:]
    return [-turning * normal - square * body, turning * body - square * normal]


def _check_columns(campaign: Campaign, motion: Motion) -> None:
    """Refuses a column that never moves, or a pitch in degrees."""
    for k, (name, least) in enumerate(_LEAST.items()):
        if all(np.ptp(f.pose[:, k]) < least for f in campaign.flights):
            raise InputError(
                f"{campaign.path}: column '{name}' does not change in any flight; "
                "one that moves with the glider is needed."
            )
    pitch = motion.pose[:, 2]
    scale = np.pi / 180.0
    factor = np.array([1.0, 1.0, scale])
    as_degrees = motion._replace(pose=motion.pose * factor)
    wide = np.ptp(np.percentile(pitch, [2, 98])) > np.pi
    if wide and fit_forces(as_degrees).misfit * 2.0 < fit_forces(motion).misfit:
        raise InputError(
            f"{campaign.path}: column 'pitch' fits the motion in degrees "
            f"(from {pitch.min():.3g} to {pitch.max():.3g}); radians are needed."
        )


def _check_attitude(campaign: Campaign, motion: Motion) -> None:
    """Refuses a pitch that was made from the path: it tells nothing of the attitude."""
    velocity = motion.velocity[:, :2]
    fast = motion.speed > 0.5 * np.median(motion.speed)
    for sign in (1, -1):
        body, normal = _axes(sign * motion.pose[:, 2])
        across, along = np.sum(velocity * normal, 1), np.sum(velocity * body, 1)
        median = float(np.median(np.abs(np.arctan2(across, along))[fast]))
        if median < _PATH:
            raise InputError(
                f"{campaign.path}: column 'pitch' is the direction of the path (they "
                f"differ by {median:.2g} rad); the measured attitude is needed."
            )


def _check_down(
    campaign: Campaign,
    motion: Motion,
    fit: ForceFit,
    gravity: float,
    warnings: list[str],
) -> Campaign:
    """Returns the campaign with z up; refuses another direction or size of the fall."""
    x, z = fit.constant
    if np.hypot(x, z + gravity) < _NEAR * gravity:
        return campaign
    told = fit_forces(motion, np.array([0.0, -gravity]))
    if told.misfit < _CLEARLY * fit.misfit:
        return campaign
    size, angle = float(np.hypot(x, z)), float(np.arctan2(x, -z))
    small = size < gravity / _SIZE
    if small or size > _SIZE * gravity:
        raise InputError(
            f"{campaign.path}: where the air is slow the flights accelerate by "
            f"{size:.3g} m/s², and 'gravity' is {gravity:.4g}; positions in meters, "
            "times in seconds, z along the vertical and the right gravity are needed."
        )
    if abs(angle) <= _UPRIGHT:
        return campaign
    if np.pi - abs(angle) > _UPRIGHT:
        toward = "+x" if x > 0.0 else "-x"
        raise InputError(
            f"{campaign.path}: the flights fall along {toward}, at {size:.3g} m/s²; "
            "column 'z' must point up and 'x' along the throw (are they exchanged?)."
        )
    warnings.append(
        f"column 'z' pointed down (the flights fell along +z at {size:.3g} m/s²): "
        "it was turned, and the angles left as they are"
    )
    return _turn(campaign, z=True)


def _check_time(
    campaign: Campaign, motion: Motion, fit: ForceFit, gravity: float
) -> None:
    """Refuses flights that gain energy from still air: time runs backwards.

    A few glides alone do not determine forces and gravity at once: it must hold with
    gravity as told, too.
    """
    down = np.array([0.0, np.copysign(gravity, fit.constant[1])])
    if _pushes(fit) and _pushes(fit_forces(motion, down)):
        raise InputError(
            f"{campaign.path}: the air pushes the gliders along instead of slowing "
            "them; rows in the order of time are needed (do they run backwards?)."
        )


def _pushes(fit: ForceFit) -> bool:
    """Whether the force of the air does work on the glider; measured: -0.7 or less."""
    return bool(fit.forces[0] + fit.forces[3] > 0.2)


def _check_ahead(
    campaign: Campaign, motion: Motion, fit: ForceFit, warnings: list[str]
) -> Campaign:
    """Returns the campaign with x ahead; refuses flights tail first."""
    heading, back = calc_heading(motion, fit.sign), np.mean(motion.velocity[:, 0]) < 0.0
    if back and heading < 0.0:
        warnings.append(
            "column 'x' pointed backwards (the flights went along -x, tail first): "
            "it was turned, and the angles left as they are"
        )
        return _turn(campaign, x=True)
    if back:
        raise InputError(
            f"{campaign.path}: the flights go along -x, with the nose there; "
            "column 'x' must point along the throw."
        )
    if heading < 0.0:
        raise InputError(
            f"{campaign.path}: the flights go tail first (column 'pitch' is off by "
            "half a turn); pitch 0 must mean the nose along x."
        )
    return campaign


def _check_force(campaign: Campaign, fit: ForceFit) -> None:
    """Refuses a vehicle whose force of the wing is of another order than measured."""
    names = ("air_density", "wing_area", "mass")
    if not all(name in campaign.vehicle for name in names):
        return
    density, area, mass = (campaign.vehicle[name] for name in names)
    told, measured = density * area / mass, -float(fit.forces[0])
    if measured > 0.0 and not 1.0 / _FORCE < measured / told < _FORCE:
        raise InputError(
            f"{campaign.path}: the wing's force is {measured:.3g} V² sin alpha "
            f"and air_density * wing_area / mass is {told:.3g}; "
            "kg/m³, m² and kg are needed in campaign.yaml."
        )


def _turn(campaign: Campaign, *, x: bool = False, z: bool = False) -> Campaign:
    """Returns the campaign with an axis turned, and y too: a frame stays right-handed.

    Of the measured attitude y turns, with the angle about the axis that turns.
    """
    pose = np.array([-1.0 if x else 1.0, -1.0 if z else 1.0, 1.0])
    attitude = np.array([-1.0, -1.0 if x else 1.0, -1.0 if z else 1.0])
    flights = tuple(
        dataclasses.replace(
            f,
            pose=f.pose * pose,
            attitude=None if f.attitude is None else f.attitude * attitude,
        )
        for f in campaign.flights
    )
    return dataclasses.replace(campaign, flights=flights)
