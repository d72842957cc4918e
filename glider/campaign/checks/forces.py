"""Accelerations of flights explained by gravity and the forces of the air.

The air's force grows with the airspeed, gravity does not. So measured accelerations
are fitted, at the rows of all flights at once, by

    a = c + |v - w| R(pitch) A R(pitch)ᵀ (v - w) + thrust + offset

with any constant vector c, any wind w and any 2 x 2 matrix A of forces along the body
axis and normal to it: flat plates, drag, camber, a wrong mass, area or zero of the
pitch are all in A; thrust acts along the body axis, and the offset is that of the
tracked point from the center of mass. The constant c is gravity: it shows which way is
down, and as a fall of 9.81 m/s² the scale of positions and times.

Lengths that are logged a times too long, and times b times too long, make gravity
a / b² times what it is; nothing else in a log contradicts a wrong scale. Measured
accelerations are explained by a constant, which is gravity, and by forces of the air in
32 ways: lift and drag with camber and a stall, with and without a wind, a thrust, a
tracked point off the center of mass, lift by the pitch rate, and lift coefficients that
depend on the airspeed. Flights rarely show which of them is right, so that the scatter
over the ways is part of the uncertainty. So is the scatter with a flight left out, or
with a quarter of the time of all flights if that is larger.

Measured (benchmarks/bench_fall.py): of 501 campaigns and parts of campaigns of
three flights or more, simulated with strong effects or thrown by hand, the logarithm
of gravity is off by 0.5 standard deviations (RMS), and by at most 1.4 in any. The
standard deviation is 0.05 to 0.09 of a campaign, 0.09 to 0.11 of three throws.
"""

import dataclasses
import functools
import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from glider.campaign.checks.masks import Masks, masks_of
from glider.campaign.checks.motion import (
    Motion,
    calc_motion,
    jackknife_error,
    robust_std,
)
from glider.campaign.checks.rates import claim_scale
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

_MIN_FLIGHTS = 3  # One throw alone may be off by far more than it shows: a warning.
_PIECES = 4  # That flights are cut into: with one left out, forms of forces matter.
_OFF = 0.05, 0.15  # Part by which gravity may be off: warned of, refused.
_SURELY = 1.7  # Standard deviations that must be in it.
_UNKNOWN = 0.2
"""Standard deviation of the logarithm of gravity above which flights do not show it."""

_LEAST_ERROR = 0.02  # Of the logarithm of gravity: of the local cubics.
_WAY_ERROR = 0.03  # Of each way, below which ways count as equally certain.
_FALL_ITERATIONS = 4  # Of Huber's weights.

_OPTIONAL = ([8, 9], [10], [11, 12], [13])  # Of offset, thrust, turning, airspeed.
_FIXED = [*range(8), 14, 15]  # Columns of forces and gravity.
_GRAVITY = slice(8, 10)  # Where it stands among these.
_PRIORS = np.repeat([10.0, 0.3, 10.0, 1.0, 10.0, 1e3], [8, 2, 1, 2, 1, 2])
"""Standard deviations of the coefficients: forces [1/m], offsets [m], thrust [m/s²],
turning, a lift that is proportional to the airspeed's departure from its mean [1/m],
gravity [m/s²]."""


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
        return _join(self.each)

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
        """Mean cosine of the angle of attack, weighted by speed²: 1 ahead.

        At the release: later a glider may loop, or slide on its tail.
        """
        early = []
        for each in self.each:
            rows = each.time < each.time[:1] + START
            early.append(Motion(*(values[rows] for values in each)))
        motion = _join(early).with_pitch(sign)
        body, _ = motion.axes
        along = np.sum(motion.velocity[:, :2] * body, axis=1)
        power = np.sum(motion.speed**2)
        return float(np.sum(along * motion.speed) / max(power, 1e-12))


def measure_motions(flights: Iterable[Flight], masks: Mapping[str, Masks]) -> Motions:
    """Motions over the usable rows of flights; without its mask all are."""
    motions = []
    for flight in flights:
        usable = masks_of(flight, masks).usable
        time = flight.time[usable]
        motions.append(calc_motion(time, flight.pose[usable], stride=_STRIDE))
    return Motions(tuple(motions))


def _join(motions: Sequence[Motion]) -> Motion:
    """Motions of flights one after the other."""
    return Motion(*map(np.concatenate, zip(*motions, strict=True)))


def fit_forces(
    motion: Motion, down: np.ndarray | None = None, signs: Sequence[int] = (1, -1)
) -> ForceFit:
    """Fits forces, with the best sign; the constant too, unless it is given [m/s²]."""
    fits = [_fit(motion, sign, down) for sign in signs]
    return min(fits, key=lambda fit: fit.misfit)


def _fit(motion: Motion, sign: int, down: np.ndarray | None) -> ForceFit:
    """Fits by Gauss-Newton (the wind is not linear) with Huber's weights."""
    motion = motion.with_pitch(sign)
    wind = np.zeros(2)
    forces = np.zeros(4)
    thrust, _ = motion.axes
    others = [*_offset_columns(motion), thrust]
    acceleration = motion.acceleration[:, :2]
    constants = []
    if down is None:
        constants = [np.broadcast_to(axis, acceleration.shape) for axis in np.eye(2)]
    else:
        acceleration = acceleration - down
    target = acceleration.reshape(-1)
    weight = np.ones(len(target))
    for iteration in range(_ITERATIONS):
        flows = _force_columns(motion, wind)
        slopes = []
        for step in _STEP * np.eye(2):
            change = _force_columns(motion, wind + step) - flows
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


def _fit_robustly(
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


def _force_columns(motion: Motion, wind: np.ndarray) -> np.ndarray:
    """Accelerations (4, k, 2) by each entry of the matrix A."""
    body, normal = motion.axes
    air = motion.velocity[:, :2] - wind
    speed = np.linalg.norm(air, axis=1)
    columns = []
    for axis in (normal, body):
        flow = speed * np.sum(air * axis, axis=1)
        columns += [flow[:, None] * normal, flow[:, None] * body]
    return np.stack(columns)


def _offset_columns(motion: Motion) -> list[np.ndarray]:
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
    solution, rest, weight = _fit_robustly(design, np.concatenate(targets))
    misfit = _rms(weight * rest)
    weighted = design * weight[:, None]
    variance = np.linalg.pinv(weighted.T @ weighted)[0, 0]
    std = max(misfit * np.sqrt(variance), 1e-12)
    tail = max(abs(solution[1]), abs(solution[4]) / _ARM, 1e-12)
    gain = float(solution[0])
    return _ElevatorFit(gain / std, misfit, abs(gain) / tail, gain)


def check_fall(
    campaign: Campaign, motions: Motions, says_unknown: bool = False
) -> tuple[str, ...]:
    """Warns of lengths or times in a wrong scale; refuses those certainly so.

    Where flights barely show gravity, it says so if asked, as an import does: its units
    are new, and the fall does not confirm them.
    """
    shown = Motions(tuple(motion for motion in motions.each if len(motion.time)))
    if not shown.each:
        return ()
    are_few = len(shown.each) < _MIN_FLIGHTS
    refused = _OFF[1]
    surely = _SURELY
    if are_few or shown.are_alike:
        refused = math.inf
        surely = 2.0 * _SURELY
    if are_few:
        shown = _cut(shown)
    fall, error = _measure_fall(shown)
    if error > _UNKNOWN:
        words = "check the units of lengths and times"
        line = f"the flights show gravity to ± {100 * error:.0f} % only: {words}"
        return (line,) if says_unknown else ()
    ratio = fall / max(campaign.gravity, 1e-3)
    found = (
        f"the flights fall at {fall:.3g} ± {error * fall:.1g} m/s² and "
        f"'gravity' is {campaign.gravity:.4g}: expected lengths {1.0 / ratio:.3g} "
        f"times as large ('units: length'), times {np.sqrt(ratio):.3g} times as "
        "large ('units: time', the frame rate), or the right gravity"
    )
    return claim_scale(campaign, ratio, surely * error, (_OFF[0], refused), found)


def _cut(motions: Motions) -> Motions:
    """Pieces of flights, as flights."""
    pieces = []
    for motion in motions.each:
        parts = [np.array_split(values, _PIECES) for values in motion]
        pieces += [Motion(*values) for values in zip(*parts, strict=True)]
    return Motions(tuple(pieces))


def _measure_fall(motions: Motions) -> tuple[float, float]:
    """Gravity as flights show it [m/s²], and the error of its logarithm."""
    fit = motions.fit
    still = fit._replace(wind=np.zeros(2))
    size, error = np.hstack([_each_way(motions, fit) for fit in (still, fit)])
    weight = 1.0 / (error**2 + _WAY_ERROR**2)
    mean = np.average(size, weights=weight)
    square = np.average(error**2 + (size - mean) ** 2, weights=weight)
    return float(np.exp(mean)), float(np.sqrt(square + _LEAST_ERROR**2))


def _each_way(motions: Motions, fit: ForceFit) -> np.ndarray:
    """Logarithm of gravity and its jackknife error (2, ways), by sets of columns."""
    motion = motions.joined.with_pitch(fit.sign)
    columns = _fall_columns(motion, fit.wind)
    target = motion.acceleration[:, :2].reshape(-1)
    design = np.moveaxis(columns, 0, 2).reshape(len(target), -1)
    _, rest, weight = _fit_robustly(design, target, _FALL_ITERATIONS)
    weight = weight / max(robust_std(rest), 1e-3)
    rows = np.column_stack([design, target]) * weight[:, None]
    ends = np.cumsum([2 * len(each.time) for each in motions.each])[:-1]
    squares = []
    for flight in np.split(rows, ends):
        pieces = np.array_split(flight, _PIECES)
        squares.append([piece.T @ piece for piece in pieces])
    total = np.sum(squares, axis=(0, 1))
    without_flight = total - np.sum(squares, axis=1)
    without_piece = total - np.sum(squares, axis=0)  # Of all flights.
    samples = np.concatenate([total[None], without_flight, without_piece])
    found = []
    for chosen in itertools.product((False, True), repeat=len(_OPTIONAL)):
        optional = itertools.compress(_OPTIONAL, chosen)
        index = [*_FIXED, *itertools.chain(*optional)]
        products = samples[:, index]
        square = products[:, :, index] + np.diag(_PRIORS[index] ** -2.0)
        solution = np.linalg.solve(square, products[:, :, -1:])[..., 0]
        gravity = np.linalg.norm(solution[:, _GRAVITY], axis=1)
        size, *others = np.log(gravity)
        parts = np.split(np.array(others), [len(motions.each)])
        found.append((size, max(jackknife_error(part) for part in parts)))
    return np.transpose(found)


def _fall_columns(motion: Motion, wind: np.ndarray) -> np.ndarray:
    """Accelerations (16, k, 2) by forces, offsets, thrust, turning and gravity."""
    body, normal = motion.axes
    air = motion.velocity[:, :2] - wind
    speed = np.linalg.norm(air, axis=1, keepdims=True)
    speed = np.maximum(speed, 1e-3)
    across = np.sum(air * normal, axis=1)[:, None] / speed
    flows = _force_columns(motion, wind)
    lift, along, *_ = flows  # By the normal flow.
    stalling = [np.abs(across) * lift, np.abs(across) * along]
    stalling += [across**2 * lift, across * along]
    turning = motion.velocity[:, 2:] * speed
    quicker = speed / np.mean(speed) - 1.0
    others = [body, turning * normal, turning * body, quicker * lift]
    gravity = np.broadcast_to(np.eye(2)[:, None], (2, len(speed), 2))
    offsets = _offset_columns(motion)
    return np.stack([*flows, *stalling, *offsets, *others, *gravity])
