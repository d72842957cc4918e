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
_GRAVITY = slice(7, 9)  # Columns of a constant, after forces, offsets and thrust.
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

_OF_WAY = np.repeat([4, 0, 1, 4, 2, 3], [4, 2, 1, 6, 2, 1])
"""Which columns a way may omit: offsets, thrust, turning, airspeed; 4 are none."""
_PRIORS = np.repeat([10.0, 0.3, 10.0, 1e3, 10.0, 1.0, 10.0], [4, 2, 1, 2, 4, 2, 1])
"""Standard deviations of the coefficients: forces [1/m], offsets [m], thrust [m/s²],
gravity [m/s²], forces of a stall [1/m], turning, a lift that is proportional to the
airspeed's departure from its mean [1/m]."""
_OMITTED = 1e-6  # The same of a column that a way omits.


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
        return Motion(*map(np.concatenate, zip(*self.each, strict=True)))

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
        early = [each.time < each.time[:1] + START for each in self.each]
        rows = np.concatenate(early)
        motion = Motion(*(v[rows] for v in self.joined)).with_pitch(sign)
        body, _ = motion.axes
        along = np.sum(motion.velocity[:, :2] * body, axis=1)
        weight = np.maximum(motion.speed, 1e-12)
        return float(np.sum(along * weight) / np.sum(weight**2))


def measure_motions(flights: Iterable[Flight], masks: Mapping[str, Masks]) -> Motions:
    """Motions over the usable rows of flights; without its mask all are."""
    motions = []
    for flight in flights:
        usable = masks_of(flight, masks).usable
        time = flight.time[usable]
        motions.append(calc_motion(time, flight.pose[usable], stride=_STRIDE))
    return Motions(tuple(motions))


def fit_forces(
    motion: Motion, down: np.ndarray | None = None, signs: Sequence[int] = (1, -1)
) -> ForceFit:
    """Fits forces, with the best sign; the constant too, unless it is given [m/s²]."""
    fits = [_fit(motion, sign, down) for sign in signs]
    return min(fits, key=lambda fit: fit.misfit)


def _fit(motion: Motion, sign: int, down: np.ndarray | None) -> ForceFit:
    """Fits by Gauss-Newton (the wind is not linear) with Huber's weights."""
    motion = motion.with_pitch(sign)
    known = np.zeros(2) if down is None else down
    count = _GRAVITY.stop if down is None else _GRAVITY.start
    target = np.ravel(motion.acceleration[:, :2] - known)
    weight = np.ones(len(target) + 2)
    wind = np.zeros(2)
    solution = np.zeros(count + 2)
    for iteration in range(_ITERATIONS):
        columns = _columns(motion, wind)[:count]
        slopes = []
        for step in _STEP * np.eye(2):
            change = _force_columns(motion, wind + step) - columns[:4]
            slopes.append(np.tensordot(solution[:4], change, 1))
        design = np.stack([*columns, *slopes], axis=2).reshape(len(target), -1)
        prior = np.eye(2, count + 2, count) * _STEP / _WIND
        design = np.concatenate([design, prior])
        values = np.append(target, -wind / _WIND)
        solution, rest, weight = _fit_robustly(design, values, 1, weight)
        if iteration > 0:  # Without forces a wind changes nothing.
            change = _STEP * solution[count:]
            change *= min(1.0, 2.0 / max(float(np.hypot(*change)), 1e-12))
            wind = np.clip(wind + change, -_MAX_WIND, _MAX_WIND)
    constant = solution[_GRAVITY] if down is None else down
    return ForceFit(sign, constant, solution[:4], wind, _rms(weight * rest))


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _fit_robustly(
    design: np.ndarray,
    target: np.ndarray,
    iterations: int = _ITERATIONS,
    weight: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Coefficients, residuals (n,) and weights (n,) of a fit with Huber's weights.

    They are the square roots, by the residuals' own robust scale.
    """
    if weight is None:
        weight = np.ones(len(target))
    for _ in range(iterations):
        rows = design * weight[:, None]
        solution = np.linalg.lstsq(rows, target * weight, rcond=None)[0]
        rest = target - design @ solution
        bound = _HUBER * (robust_std(rest) + 1e-9)
        weight = np.sqrt(np.minimum(1.0, bound / np.maximum(np.abs(rest), 1e-12)))
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


def _columns(motion: Motion, wind: np.ndarray) -> list[np.ndarray]:
    """Accelerations (k, 2) by forces, by points 1 m off the center, thrust, gravity.

    Then by a stall, turning and the airspeed.
    """
    body, normal = motion.axes
    forces = _force_columns(motion, wind)
    square = motion.velocity[:, 2:] ** 2
    turning = motion.acceleration[:, 2:]
    ahead = -turning * normal - square * body
    above = turning * body - square * normal
    gravity = [np.broadcast_to(axis, body.shape) for axis in np.eye(2)]
    air = motion.velocity[:, :2] - wind
    speed = np.maximum(np.linalg.norm(air, axis=1, keepdims=True), 1e-3)
    across = np.sum(air * normal, axis=1)[:, None] / speed
    lift, along, *_ = forces  # By the normal flow.
    stalling = [np.abs(across) * lift, np.abs(across) * along]
    stalling += [across**2 * lift, across * along]
    spin = motion.velocity[:, 2:] * speed
    more = [
        *stalling,
        spin * normal,
        spin * body,
        (speed / np.mean(speed) - 1.0) * lift,
    ]
    return [*forces, ahead, above, body, *gravity, *more]


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
        vx, vz, turning = motion.velocity.T
        alpha = np.arctan2(-vz, vx) - motion.pose[:, 2]
        across = np.sin(alpha)
        along = np.cos(alpha)
        square = motion.speed * np.stack([angle, across, along, across * along])
        rates = [*square, turning, np.gradient(angle, motion.time)]
        designs.append((motion.speed * rates).T)
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
    refused = _OFF[1]
    surely = _SURELY
    if len(shown.each) < _MIN_FLIGHTS or shown.are_alike:
        refused = math.inf
        surely = 2.0 * _SURELY
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
    target = motion.acceleration[:, :2].reshape(-1)
    design = np.stack(_columns(motion, fit.wind), axis=2).reshape(len(target), -1)
    _, rest, weight = _fit_robustly(design, target, _FALL_ITERATIONS)
    weight = weight / max(robust_std(rest), 1e-3)
    rows = np.column_stack([design, target]) * weight[:, None]
    ends = np.cumsum([2 * len(each.time) for each in motions.each])[:-1]
    pieces = [np.array_split(flight, _PIECES) for flight in np.split(rows, ends)]
    squares = np.array([[own.T @ own for own in flight] for flight in pieces])
    flights = np.sum(squares, axis=1)
    total = np.sum(flights, axis=0)
    if len(flights) < _MIN_FLIGHTS:
        flights = flights[:0]
    omitted = [0.0 * total[None], flights, np.sum(squares, axis=0)]
    samples = total - np.concatenate(omitted)
    found = []
    for chosen in itertools.product((_OMITTED, 1.0), repeat=4):
        freedom = np.array([*chosen, 1.0])[_OF_WAY] * _PRIORS
        square = samples[:, :-1, :-1] + np.diag(freedom**-2.0)
        solution = np.linalg.solve(square, samples[:, :-1, -1:])[:, _GRAVITY, 0]
        size, *others = np.log(np.linalg.norm(solution, axis=1))
        parts = np.split(np.array(others), [len(flights)])
        errors = [jackknife_error(part) for part in parts if len(part)]
        found.append((size, max(errors)))
    return np.transpose(found)
