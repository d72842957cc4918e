"""Accelerations of flights explained by gravity and the forces of the air.

The air's force grows with the airspeed, gravity does not. So measured accelerations
are fitted, at the rows of all flights at once, by

    a = c + |v - w| R(pitch) A R(pitch)ᵀ (v - w) + thrust + offset

with any constant vector c, any wind w and any 2 x 2 matrix A of forces along the body
axis and normal to it: flat plates, drag, camber, a wrong mass, area or zero of the
pitch are all in A; thrust acts along the body axis, and the offset is that of the
tracked point from the center of mass. The constant c is gravity: it shows which way is
down (`frame`), and as a fall of 9.81 m/s² the scale of positions and times (`fall`).

The elevator's effect is fitted to the pitch accelerations in the same way. All fits
limit the influence of faulty rows by Huber's weights.
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
GRAVITY = slice(7, 9)  # Columns of a constant, after forces, offsets and thrust.
_STRIDE = 3  # Rows from one acceleration to the next: those between add nothing new.
_ITERATIONS = 7
_STEP = 0.01  # Of the wind, for slopes [m/s].
_WIND = 2.0  # Standard deviation of its prior, of the weight of one row [m/s].
_MAX_WIND = 6.0  # [m/s]
_LARGEST_CHANGE = 2.0  # Of the wind in one iteration [m/s].
_ARM = 0.25  # Length of a tail over which an elevator's strength is compared [m].
_ALIKE = 0.2
"""Share of the variance of velocities that is between flights, below which they are
alike: less than 0.05 of throws of one plan, 0.56 to 0.87 of campaigns."""
_NEAR = 0.2  # Part of gravity by which the constant may be off without a question.
_HUBER = 2.0  # Residual, in standard deviations, above which a weight decreases.


class _ForceFit(NamedTuple):
    """Accelerations explained by a constant and forces of the air.

    Attributes:
        sign: of the pitch, +1 as logged.
        constant: (2,) the constant c in x and z of the log [m/s²].
        forces: (4,) the matrix A, by normal flow (normal, then axial force), then by
            axial flow [1/m].
        wind: (2,) w [m/s].
        misfit: RMS of the weighted residuals [m/s²].
    """

    sign: int
    constant: np.ndarray
    forces: np.ndarray
    wind: np.ndarray
    misfit: float


class _ElevatorFit(NamedTuple):
    """Pitch accelerations explained by the elevator and the flow.

    Attributes:
        effect: of the elevator, in standard errors; trailing edge up: negative.
        misfit: RMS of the weighted residuals [rad/s²].
        strength: effect of the elevator's angle over that of the flow's on a tail.
        gain: coefficient of V² times the elevator [1/m²].
    """

    effect: float
    misfit: float
    strength: float
    gain: float


@dataclasses.dataclass(frozen=True)
class Motions:
    """Motions of flights: the checks share one smoothing and one fit of the forces.

    Attributes:
        each: by flight; without rows where too few are usable.
    """

    each: tuple[Motion, ...]

    @functools.cached_property
    def joined(self) -> Motion:
        """All motions, one after the other."""
        columns = zip(*self.each, strict=True)
        return Motion(*map(np.concatenate, columns))

    @functools.cached_property
    def fit(self) -> _ForceFit:
        """Forces and gravity, with the better sign of the pitch."""
        return fit_forces(self.joined)

    @property
    def are_alike(self) -> bool:
        """Whether flights repeat each other, as throws of one plan do: they are one.

        Velocities at the same row of all flights then differ by little of what they
        vary along a flight.
        """
        shown = [motion for motion in self.each if len(motion.time)]
        rows = min(len(motion.time) for motion in shown)
        velocity = np.array([motion.velocity[:rows, :2] for motion in shown])
        total = np.var(velocity, axis=(0, 1)).sum()
        between = np.var(velocity, axis=0).mean(axis=0).sum()
        return between < _ALIKE * total

    def confirm(self, gravity: float) -> bool:
        """Whether the free constant is gravity [m/s²] along -z, but for a part."""
        x, z = self.fit.constant
        return np.hypot(x, z + gravity) < _NEAR * gravity

    def calc_heading(self, sign: int) -> float:
        """Mean cosine of the angle of attack, weighted by speed²: 1 ahead.

        Only the first `START` seconds of each flight count: later a glider may loop, or
        slide on its tail.

        Args:
            sign: of the pitch, +1 as logged.
        """
        is_early = np.concatenate([m.time < m.time[:1] + START for m in self.each])
        motion = self.joined.with_pitch(sign)
        body, _ = motion.axes
        velocity = motion.velocity[is_early, :2]
        speed = np.maximum(motion.speed[is_early], 1e-12)
        along = np.sum(velocity * body[is_early], axis=1)
        return np.sum(along * speed) / np.sum(speed**2)


def measure_motions(flights: Iterable[Flight], masks: Mapping[str, Masks]) -> Motions:
    """Motions over the usable rows of flights.

    Args:
        flights: in the order of the result's motions.
        masks: by the name of a flight; without one all its rows are usable.
    """
    motions = []
    for flight in flights:
        usable = masks_of(flight, masks).usable
        time = flight.time[usable]
        pose = flight.pose[usable]
        motions.append(calc_motion(time, pose, stride=_STRIDE))
    return Motions(tuple(motions))


def fit_forces(
    motion: Motion, gravity: float | None = None, signs: Sequence[int] = (1, -1)
) -> _ForceFit:
    """Fits the forces of the air, and the constant unless gravity is given.

    Args:
        motion: of all flights, at k rows.
        gravity: along -z [m/s²]; None: the constant is any vector.
        signs: of the pitch that are tried; the one with the least misfit is returned.
    """
    fits = [_fit_with_sign(motion, sign, gravity) for sign in signs]
    return min(fits, key=lambda fit: fit.misfit)


def _fit_with_sign(motion: Motion, sign: int, gravity: float | None) -> _ForceFit:
    """Fits by Gauss-Newton, as the wind is not linear, with Huber's weights.

    Unknown are the coefficients of the first columns of `make_force_design`, up to the
    constant or without it, and the change of the wind in `_STEP`. Two rows more are the
    prior of the wind.
    """
    motion = motion.with_pitch(sign)
    constant = np.zeros(2)
    count = GRAVITY.stop
    if gravity is not None:
        constant = np.array([0.0, -gravity])
        count = GRAVITY.start
    target = np.ravel(motion.acceleration[:, :2] - constant)

    prior = np.eye(2, count + 2, count) * _STEP / _WIND
    wind = np.zeros(2)
    solution = np.zeros(count + 2)
    weight = np.ones(len(target) + 2)
    for iteration in range(_ITERATIONS):
        columns = [make_force_design(motion, wind)[:, :count]]
        forces = _calc_forces(motion, wind)  # The wind changes them alone.
        for step in _STEP * np.eye(2):
            change = _calc_forces(motion, wind + step) - forces
            columns.append(np.tensordot(solution[:4], change, 1).reshape(-1, 1))
        design = np.concatenate([np.hstack(columns), prior])
        values = np.append(target, -wind / _WIND)
        solution, rest, weight = _fit_weighted(design, values, weight)
        if iteration > 0:  # Without forces a wind changes nothing.
            change = _STEP * solution[count:]
            size = max(np.hypot(*change), 1e-12)
            change *= min(1.0, _LARGEST_CHANGE / size)
            wind = np.clip(wind + change, -_MAX_WIND, _MAX_WIND)

    if gravity is None:
        constant = solution[GRAVITY]
    return _ForceFit(sign, constant, solution[:4], wind, _rms(weight * rest))


def _rms(values: np.ndarray) -> float:
    return np.sqrt(np.mean(values**2))


def fit_robustly(
    design: np.ndarray, target: np.ndarray, iterations: int = _ITERATIONS
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Fits `design @ coefficients = target` with Huber's weights.

    A residual counts in full up to `_HUBER` robust standard deviations of all, beyond
    that by their ratio to it.

    Args:
        design: (n, c).
        target: (n,).
        iterations: how often the weights follow the residuals.

    Returns:
        Coefficients (c,), residuals (n,), and square roots of the weights (n,).
    """
    weight = np.ones(len(target))
    for _ in range(iterations):
        solution, rest, weight = _fit_weighted(design, target, weight)
    return solution, rest, weight


def _fit_weighted(
    design: np.ndarray, target: np.ndarray, weight: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """One iteration of `fit_robustly`.

    Args:
        design: (n, c).
        target: (n,).
        weight: (n,) square roots of the weights.

    Returns:
        Coefficients (c,), residuals (n,), and square roots of the next weights (n,).
    """
    rows = design * weight[:, None]
    solution = np.linalg.lstsq(rows, target * weight, rcond=None)[0]
    rest = target - design @ solution
    bound = _HUBER * (robust_std(rest) + 1e-9)
    ratio = bound / np.maximum(np.abs(rest), 1e-12)
    return solution, rest, np.sqrt(np.minimum(1.0, ratio))


def make_force_design(motion: Motion, wind: np.ndarray) -> np.ndarray:
    """Accelerations at k rows by each coefficient, all else zero.

    With the airspeed V and the angle of attack α, the columns are of
        0 to 3: the entries of A, in the order of a fit's `forces` [1/m];
        4, 5: a tracked point ahead of the center of mass, and above it [m];
        6: a thrust [m/s²];
        7, 8: the constant in x and z [m/s²], `GRAVITY`;
        9, 10: forces of a stall by V² |sin α| sin α, normal and axial [1/m];
        11, 12: a normal one by V² sin³ α, an axial one by V² sin² α [1/m];
        13, 14: forces by V times the pitch rate, normal and axial;
        15: a lift that grows with V's departure from its mean, over the mean [1/m].

    Args:
        motion: of k rows.
        wind: (2,) [m/s].

    Returns:
        (2k, 16), x and z of each row in turn.
    """
    body, normal = motion.axes
    forces = _calc_forces(motion, wind)

    # A point fixed to the body accelerates by turning, and towards the center.
    turning = motion.acceleration[:, 2:]
    square = motion.velocity[:, 2:] ** 2
    ahead = -turning * normal - square * body
    above = turning * body - square * normal

    # Forces that grow in another way than those of A.
    air = motion.velocity[:, :2] - wind
    speed = np.maximum(np.linalg.norm(air, axis=1, keepdims=True), 1e-3)
    sin_alpha = np.sum(air * normal, axis=1)[:, None] / speed
    lift, axial, *_ = forces
    stall = [np.abs(sin_alpha) * lift, np.abs(sin_alpha) * axial]
    stall += [sin_alpha**2 * lift, sin_alpha * axial]
    spin = motion.velocity[:, 2:] * speed
    faster = (speed / np.mean(speed) - 1.0) * lift

    constant = [np.broadcast_to(axis, body.shape) for axis in np.eye(2)]
    usual = [*forces, ahead, above, body, *constant]
    rare = [*stall, spin * normal, spin * body, faster]
    return np.stack([*usual, *rare], axis=2).reshape(2 * len(body), -1)


def _calc_forces(motion: Motion, wind: np.ndarray) -> np.ndarray:
    """Accelerations (4, k, 2) by each entry of the matrix A.

    A flow along one axis of the body makes a force along either.
    """
    body, normal = motion.axes
    air = motion.velocity[:, :2] - wind
    speed = np.linalg.norm(air, axis=1)
    columns = []
    for axis in (normal, body):
        flow = speed * np.sum(air * axis, axis=1)
        columns += [flow[:, None] * normal, flow[:, None] * body]
    return np.stack(columns)


def fit_elevator(campaign: Campaign, motions: Motions) -> _ElevatorFit:
    """Fits the pitch accelerations of flights that have an elevator.

    They are fitted by the elevator's angle δ, its rate and the angle of attack α as
        V² (a δ + b sin α + c cos α + d sin α cos α) + V (e pitchdot + f δdot);
    trailing edge up turns the nose up, so the effect a is negative.

    Args:
        campaign: of flights with or without an elevator.
        motions: of these flights.
    """
    designs = []
    targets = []
    for flight, motion in zip(campaign.flights, motions.each, strict=True):
        if flight.elevator is not None and len(motion.time) >= 3:
            angle = np.interp(motion.time, flight.time, flight.elevator)
            designs.append(_make_elevator_design(motion, angle))
            targets.append(motion.acceleration[:, 2])
    design = np.concatenate(designs)
    solution, rest, weight = fit_robustly(design, np.concatenate(targets))
    gain, by_flow, _, _, by_turning, _ = solution.tolist()

    misfit = _rms(weight * rest)
    weighted = design * weight[:, None]
    variance = np.linalg.pinv(weighted.T @ weighted)[0, 0]
    std = max(misfit * np.sqrt(variance), 1e-12)
    tail = max(abs(by_flow), abs(by_turning) / _ARM, 1e-12)
    return _ElevatorFit(gain / std, misfit, abs(gain) / tail, gain)


def _make_elevator_design(motion: Motion, angle: np.ndarray) -> np.ndarray:
    """Pitch accelerations (k, 6) by unit coefficients.

    The elevator has angles (k,) [rad].
    """
    vx, vz, pitch_rate = motion.velocity.T
    speed = motion.speed
    alpha = np.arctan2(-vz, vx) - motion.pose[:, 2]
    sin = np.sin(alpha)
    cos = np.cos(alpha)
    by_speed = speed * np.stack([angle, sin, cos, sin * cos])
    rate = np.gradient(angle, motion.time)
    return (speed * np.stack([*by_speed, pitch_rate, rate])).T
