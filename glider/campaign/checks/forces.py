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

import dataclasses
import functools
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from glider.campaign.checks.masks import Masks, masks_of
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
_ALIKE = 0.2
"""Share of the variance of velocities that is between flights, below which they are
alike: less than 0.05 of throws of one plan, 0.56 to 0.87 of campaigns."""
_HUBER = 2.0  # Residual, in standard deviations, above which a weight decreases.


class ForceFit(NamedTuple):
    """Accelerations explained by a constant and forces of the air."""

    sign: int  #: Of the pitch, +1 as logged.
    constant: np.ndarray  #: (2,) in x and z of the log [m/s²].
    forces: np.ndarray  #: (4,) A: normal, along by normal flow; then by axial [1/m].
    wind: np.ndarray  #: (2,) [m/s]
    misfit: float  #: Robust RMS of what is left [m/s²].


class _ElevatorFit(NamedTuple):
    """Pitch accelerations explained by the elevator and the flow."""

    effect: float  #: Of the elevator, in standard errors; trailing edge up: negative.
    misfit: float  #: Robust RMS of what is left [rad/s²].
    strength: float  #: Of the elevator, over that of the flow on a tail.
    gain: float  #: Of V² times the elevator [1/m²].


@dataclasses.dataclass(frozen=True)
class Motions:
    """Motions of flights: the checks share one smoothing and one fit of the forces."""

    each: tuple[Motion, ...]  #: By flight; without rows where few are usable.

    @functools.cached_property
    def joined(self) -> Motion:
        """All motions, one after the other."""
        return join(self.each)

    @functools.cached_property
    def fit(self) -> ForceFit:
        """Forces and gravity, with the better sign of the pitch."""
        return fit_forces(self.joined)

    @property
    def are_alike(self) -> bool:
        """Whether flights repeat each other, as throws of one plan do: they are one."""
        shown = [motion for motion in self.each if len(motion.time)]
        rows = min(len(motion.time) for motion in shown)
        velocity = np.array([motion.velocity[:rows, :2] for motion in shown])
        total = np.var(velocity, axis=(0, 1)).sum()
        between = np.var(velocity, axis=0).mean(axis=0).sum()
        return bool(between < _ALIKE * total)

    def calc_heading(self, sign: int) -> float:
        """Heading at the release: later a glider may loop, or slide on its tail."""
        early = []
        for motion in self.each:
            rows = motion.time < motion.time[:1] + START
            early.append(Motion(*(values[rows] for values in motion)))
        return calc_heading(join(early).with_pitch(sign))


def measure_motions(flights: Iterable[Flight], masks: Mapping[str, Masks]) -> Motions:
    """Motions over the usable rows of flights; without its mask all are."""
    motions = []
    for flight in flights:
        usable = masks_of(flight, masks).usable
        time = flight.time[usable]
        motions.append(calc_motion(time, flight.pose[usable], stride=_STRIDE))
    return Motions(tuple(motions))


def join(motions: Sequence[Motion]) -> Motion:
    """Motions of flights one after the other."""
    return Motion(*map(np.concatenate, zip(*motions, strict=True)))


def fit_forces(
    motion: Motion, down: np.ndarray | None = None, signs: Sequence[int] = (1, -1)
) -> ForceFit:
    """Fits forces, with the best sign; the constant too, unless it is given [m/s²]."""
    fits = [_fit(motion, sign, down) for sign in signs]
    return min(fits, key=lambda fit: fit.misfit)


def calc_heading(motion: Motion) -> float:
    """Mean cosine of the angle of attack, weighted by speed²: 1 ahead."""
    body, _ = motion.axes
    along = np.sum(motion.velocity[:, :2] * body, axis=1)
    power = np.sum(motion.speed**2)
    return float(np.sum(along * motion.speed) / max(power, 1e-12))


def _fit(motion: Motion, sign: int, down: np.ndarray | None) -> ForceFit:
    """Fits by Gauss-Newton (the wind is not linear) with Huber's weights."""
    motion = motion.with_pitch(sign)
    wind = np.zeros(2)
    forces = np.zeros(4)
    thrust, _ = motion.axes
    others = [*offset_columns(motion), thrust]
    acceleration = motion.acceleration[:, :2]
    constants = []
    if down is None:
        constants = [np.broadcast_to(axis, acceleration.shape) for axis in np.eye(2)]
    else:
        acceleration = acceleration - down
    target = acceleration.reshape(-1)
    weight = np.ones(len(target))
    for iteration in range(_ITERATIONS):
        flows = force_columns(motion, wind)
        slopes = []
        for step in _STEP * np.eye(2):
            change = force_columns(motion, wind + step) - flows
            slopes.append(np.tensordot(forces, change, 1))
        columns = [*flows, *others, *slopes, *constants]
        design = np.stack(columns, axis=2).reshape(len(target), -1)
        prior = np.zeros((2, design.shape[1]))
        prior[:, _WIND_AT] = np.eye(2) * _STEP / _WIND
        rows = np.concatenate([design * weight[:, None], prior])
        values = np.concatenate([target * weight, -wind / _WIND])
        solution = np.linalg.lstsq(rows, values, rcond=None)[0]
        rest = target - design @ solution
        weight = _huber_weights(rest)
        forces = solution[:4]
        if iteration > 0:  # Without forces a wind changes nothing.
            change = _STEP * solution[_WIND_AT]
            change *= min(1.0, 2.0 / max(float(np.hypot(*change)), 1e-12))
            wind = np.clip(wind + change, -_MAX_WIND, _MAX_WIND)
    constant = solution[_WIND_AT.stop :] if down is None else down
    return ForceFit(sign, constant, forces, wind, _rms(weight * rest))


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _huber_weights(rest: np.ndarray) -> np.ndarray:
    """Square roots of Huber's weights of residuals (n,), by their own robust scale."""
    bound = _HUBER * (robust_std(rest) + 1e-9)
    return np.sqrt(np.minimum(1.0, bound / np.maximum(np.abs(rest), 1e-12)))


def fit_robustly(
    design: np.ndarray, target: np.ndarray, iterations: int = _ITERATIONS
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Coefficients, residuals (n,) and weights (n,) of a fit with Huber's weights."""
    weight = np.ones(len(target))
    for _ in range(iterations):
        rows = design * weight[:, None]
        solution = np.linalg.lstsq(rows, target * weight, rcond=None)[0]
        rest = target - design @ solution
        weight = _huber_weights(rest)
    return solution, rest, weight


def force_columns(motion: Motion, wind: np.ndarray) -> np.ndarray:
    """Accelerations (4, k, 2) by each entry of the matrix A."""
    body, normal = motion.axes
    air = motion.velocity[:, :2] - wind
    speed = np.linalg.norm(air, axis=1)
    columns = []
    for axis in (normal, body):
        flow = speed * np.sum(air * axis, axis=1)
        columns += [flow[:, None] * normal, flow[:, None] * body]
    return np.stack(columns)


def offset_columns(motion: Motion) -> list[np.ndarray]:
    """Accelerations (k, 2) of points 1 m ahead of and above the center."""
    body, normal = motion.axes
    square = motion.velocity[:, 2:] ** 2
    turning = motion.acceleration[:, 2:]
    return [-turning * normal - square * body, turning * body - square * normal]


def fit_elevator(campaign: Campaign, motions: Motions) -> _ElevatorFit:
    """Fits the pitch accelerations of flights.

    pitchdd is fitted by V² (elevator, sin alpha, cos alpha, sin alpha cos alpha), V q
    and V times the elevator's rate with Huber's weights; trailing edge up turns the
    nose up, so the effect is negative.
    """
    designs = []
    targets = []
    for flight, motion in zip(campaign.flights, motions.each, strict=True):
        if flight.elevator is None or len(motion.time) < 3:
            continue
        angle = np.interp(motion.time, flight.time, flight.elevator)
        vx, vz, rate = motion.velocity.T
        alpha = np.arctan2(-vz, vx) - motion.pose[:, 2]
        across = np.sin(alpha)
        along = np.cos(alpha)
        lift = np.stack([angle, across, along, across * along])
        turning = np.stack([rate, np.gradient(angle, motion.time)])
        speed = motion.speed
        designs.append(np.concatenate([speed**2 * lift, speed * turning]).T)
        targets.append(motion.acceleration[:, 2])
    design = np.concatenate(designs)
    solution, rest, weight = fit_robustly(design, np.concatenate(targets))
    misfit = _rms(weight * rest)
    weighted = design * weight[:, None]
    variance = np.linalg.pinv(weighted.T @ weighted)[0, 0]
    std = max(misfit * np.sqrt(variance), 1e-12)
    tail = max(abs(solution[1]), abs(solution[4]) / _ARM, 1e-12)
    gain = float(solution[0])
    return _ElevatorFit(gain / std, misfit, abs(gain) / tail, gain)
