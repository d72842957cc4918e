"""Accelerations of flights explained by gravity and the forces of the air.

The air's force grows with the airspeed, gravity does not. So measured accelerations
are fitted, at the rows of all flights at once, by

    a = c + |v - w| R(pitch) A R(pitch)ᵀ (v - w) + thrust + offset

with any constant vector c, any wind w and any 2 x 2 matrix A of forces along the body
axis and normal to it: flat plates, drag, camber, a wrong mass, area or zero of the
pitch are all in A; thrust acts along the body axis, and the offset is that of the
tracked point from the center of mass. The constant c is gravity: it shows which way is
down, and as a fall of 9.81 m/s² the scale of positions and times.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from glider.campaign.checks.masks import Masks
from glider.campaign.checks.motion import Motion, calc_motion, robust_std
from glider.campaign.logs import Campaign, Flight

START = 0.3  # Time after its release in which a glider goes where its nose is [s].
_STRIDE = 3  # Rows from one acceleration to the next: those between add nothing new.
_ITERATIONS = 7
_WIND_AT = slice(7, 9)  # Columns of the wind, after forces, offsets and thrust.
_STEP = 0.01  # Of the wind, for slopes [m/s].
_WIND = 2.0  # Standard deviation of its prior, of the weight of one row [m/s].
_MAX_WIND = 6.0  # [m/s]
_ARM = 0.25  # Length of a tail over which an elevator's strength is compared [m].
_HUBER = 2.0  # Residual, in standard deviations, above which a weight decreases.


class ForceFit(NamedTuple):
    """Accelerations explained by a constant and forces of the air."""

    sign: int  #: Of the pitch, +1 as logged.
    constant: np.ndarray  #: (2,) in x and z of the log [m/s²].
    forces: np.ndarray  #: (4,) A: normal, along by normal flow; then by axial [1/m].
    wind: np.ndarray  #: (2,) [m/s]
    misfit: float  #: Robust RMS of what is left [m/s²].


class ElevatorFit(NamedTuple):
    """Pitch accelerations explained by the elevator and the flow."""

    effect: float  #: Of the elevator, in standard errors; trailing edge up: negative.
    misfit: float  #: Robust RMS of what is left [rad/s²].
    strength: float  #: Of the elevator, over that of the flow on a tail.
    gain: float  #: Of V² times the elevator [1/m²].


def usable_motion(flight: Flight, masks: Mapping[str, Masks]) -> Motion:
    """Motion over the usable rows of a flight; without its mask all are."""
    usable = masks[flight.name].usable if flight.name in masks else slice(None)
    return calc_motion(flight.time[usable], flight.pose[usable], stride=_STRIDE)


def join(motions: list[Motion]) -> Motion:
    """Motions of flights one after the other."""
    return Motion(*(np.concatenate(parts) for parts in zip(*motions, strict=True)))


def at_release(motions: Sequence[Motion]) -> Motion:
    """The first rows of each motion: later a glider may loop, or slide on its tail."""
    early = [m.time < m.time[:1] + START for m in motions]
    pairs = zip(motions, early, strict=True)
    return join([Motion(*(v[rows] for v in m)) for m, rows in pairs])


def fit_forces(
    motion: Motion, down: np.ndarray | None = None, signs: Sequence[int] = (1, -1)
) -> ForceFit:
    """Fits forces, with the best sign; the constant too, unless it is given [m/s²]."""
    return min((_fit(motion, s, down) for s in signs), key=lambda fit: fit.misfit)


def calc_heading(motion: Motion, sign: int) -> float:
    """Mean cosine of the angle of attack, weighted by speed²: 1 ahead."""
    body, _ = body_axes(sign * motion.pose[:, 2])
    velocity = motion.velocity[:, :2]
    along = np.sum(velocity * body, axis=1) * motion.speed
    return float(np.sum(along) / max(np.sum(motion.speed**2), 1e-12))


def body_axes(pitch: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Body axis and wing normal, (k, 2) each, in x and z."""
    body = np.stack([np.cos(pitch), -np.sin(pitch)], axis=1)
    normal = np.stack([np.sin(pitch), np.cos(pitch)], axis=1)
    return body, normal


def _fit(motion: Motion, sign: int, down: np.ndarray | None) -> ForceFit:
    """Fits by Gauss-Newton (the wind is not linear) with Huber's weights."""
    wind = np.zeros(2)
    forces = np.zeros(4)
    offset = offset_columns(motion, sign)
    thrust = body_axes(sign * motion.pose[:, 2])[0]
    free = np.eye(2)[: 2 if down is None else 0]
    constants = [np.tile(axis, (len(motion.time), 1)) for axis in free]
    target = motion.acceleration[:, :2] - (0.0 if down is None else down)
    weight = np.ones(target.size)
    for iteration in range(_ITERATIONS):
        flows = force_columns(motion, sign, wind)
        slopes = [
            np.tensordot(forces, force_columns(motion, sign, wind + step), 1)
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
        weight = huber_weights(rest)
        forces = solution[:4]
        if iteration > 0:  # Without forces a wind changes nothing.
            change = _STEP * solution[_WIND_AT]
            change *= min(1.0, 2.0 / max(float(np.hypot(*change)), 1e-12))
            wind = np.clip(wind + change, -_MAX_WIND, _MAX_WIND)
    misfit = float(np.sqrt(np.mean((weight * rest) ** 2)))
    constant = solution[_WIND_AT.stop :] if down is None else down
    return ForceFit(sign, constant, forces, wind, misfit)


def huber_weights(rest: np.ndarray) -> np.ndarray:
    """Square roots of Huber's weights of residuals (n,), by their own robust scale."""
    bound = _HUBER * (robust_std(rest) + 1e-9)
    return np.sqrt(np.minimum(1.0, bound / np.maximum(np.abs(rest), 1e-12)))


def force_columns(motion: Motion, sign: int, wind: np.ndarray) -> np.ndarray:
    """Accelerations (4, k, 2) by each entry of the matrix A."""
    body, normal = body_axes(sign * motion.pose[:, 2])
    air = motion.velocity[:, :2] - wind
    speed = np.hypot(air[:, 0], air[:, 1])
    flows = [(speed * np.sum(air * axis, axis=1))[:, None] for axis in (normal, body)]
    return np.stack([flow * force for flow in flows for force in (normal, body)])


def offset_columns(motion: Motion, sign: int) -> list[np.ndarray]:
    """Accelerations (k, 2) of points 1 m ahead of and above the center."""
    body, normal = body_axes(sign * motion.pose[:, 2])
    square = motion.velocity[:, 2:] ** 2
    turning = sign * motion.acceleration[:, 2:]
    return [-turning * normal - square * body, turning * body - square * normal]


def fit_elevator(campaign: Campaign, motions: Mapping[str, Motion]) -> ElevatorFit:
    """Fits pitch accelerations of flights, whose motions are given by name.

    pitchdd is fitted by V² (elevator, sin alpha, cos alpha, sin alpha cos alpha), V q
    and V times the elevator's rate with Huber's weights; trailing edge up turns the
    nose up, so the effect is negative.
    """
    columns = []
    targets = []
    for flight in campaign.flights:
        motion = motions[flight.name]
        if flight.elevator is None or len(motion.time) < 3:
            continue
        angle = np.interp(motion.time, flight.time, flight.elevator)
        speed, (vx, vz, rate) = motion.speed, motion.velocity.T
        alpha = np.arctan2(-vz, vx) - motion.pose[:, 2]
        lift = [angle, np.sin(alpha), np.cos(alpha), np.sin(alpha) * np.cos(alpha)]
        turning = [speed * rate, speed * np.gradient(angle, motion.time)]
        columns.append(np.column_stack([speed**2 * c for c in lift] + turning))
        targets.append(motion.acceleration[:, 2])
    design = np.concatenate(columns)
    target = np.concatenate(targets)
    weight = np.ones(len(target))
    for _ in range(_ITERATIONS):
        weighted = design * weight[:, None]
        solution = np.linalg.lstsq(weighted, target * weight, rcond=None)[0]
        rest = target - design @ solution
        weight = huber_weights(rest)
    misfit = float(np.sqrt(np.mean((weight * rest) ** 2)))
    std = misfit * np.sqrt(np.linalg.pinv(weighted.T @ weighted)[0, 0])
    tail = max(abs(solution[1]), abs(solution[4]) / _ARM, 1e-12)
    effect = solution[0] / max(std, 1e-12)
    strength = abs(solution[0]) / tail
    return ElevatorFit(float(effect), misfit, float(strength), float(solution[0]))
