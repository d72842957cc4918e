"""How fast do flights fall? Gravity as a check of the scales of lengths and times.

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

import itertools
import math

import numpy as np

from glider.campaign.checks import forces
from glider.campaign.checks.clocks import claim_scale
from glider.campaign.checks.masks import Masks
from glider.campaign.checks.motion import Motion, are_alike, robust_std
from glider.campaign.logs import Campaign

_MIN_FLIGHTS = 3  # One throw alone may be off by far more than it shows: a warning.
_PIECES = 4  # That flights are cut into: with one left out, forms of forces matter.
_OFF = 0.05, 0.15  # Part by which gravity may be off: warned of, refused.
_SURELY = 1.7  # Standard deviations that must be in it.
UNKNOWN = 0.2
"""Standard deviation of the logarithm of gravity above which flights do not show it."""

_LEAST_ERROR = 0.02  # Of the logarithm of gravity: of the local cubics.
_WAY_ERROR = 0.03  # Of each way, below which ways count as equally certain.
_ITERATIONS = 4  # Of Huber's weights.

_OPTIONAL = ([8, 9], [10], [11, 12], [13])  # Of offset, thrust, turning, airspeed.
_FIXED = [*range(8), 14, 15]  # Columns of forces and gravity.
_GRAVITY = slice(8, 10)  # Where it stands among these.
_PRIORS = np.repeat([10.0, 0.3, 10.0, 1.0, 10.0, 1e3], [8, 2, 1, 2, 1, 2])
"""Standard deviations of the coefficients: forces [1/m], offsets [m], thrust [m/s²],
turning, a lift that is proportional to the airspeed's departure from its mean [1/m],
gravity [m/s²]."""


def check_fall(
    campaign: Campaign, masks: dict[str, Masks], says_unknown: bool = False
) -> tuple[str, ...]:
    """Warns of lengths or times in a wrong scale; refuses those certainly so.

    Where flights barely show gravity, it says so if asked, as an import does: its units
    are new, and the fall does not confirm them.
    """
    motions = [forces.usable_motion(f, masks) for f in campaign.flights]
    motions = [motion for motion in motions if len(motion.time)]
    are_few = len(motions) < _MIN_FLIGHTS
    refused = _OFF[1]
    surely = _SURELY
    if are_few or are_alike(motions):
        refused = math.inf
        surely = 2.0 * _SURELY
    if are_few:
        parts = [[np.array_split(v, _PIECES) for v in m] for m in motions]
        motions = [Motion(*p) for each in parts for p in zip(*each, strict=True)]
    if not motions:
        return ()
    fall, error = measure_fall(motions)
    if error > UNKNOWN:
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


def measure_fall(motions: list[Motion]) -> tuple[float, float]:
    """Gravity as flights show it [m/s²], and the error of its logarithm."""
    fit = forces.fit_forces(forces.join(motions))
    winds = (np.zeros(2), fit.wind)
    found = [way for wind in winds for way in _each_way(motions, fit.sign, wind)]
    size, error = np.array(found).T
    weight = 1.0 / (error**2 + _WAY_ERROR**2)
    mean = np.average(size, weights=weight)
    square = np.average(error**2 + (size - mean) ** 2, weights=weight)
    return float(np.exp(mean)), float(np.sqrt(square + _LEAST_ERROR**2))


def _each_way(
    motions: list[Motion], sign: int, wind: np.ndarray
) -> list[tuple[float, float]]:
    """Logarithm of gravity and its jackknife error, with each set of columns."""
    motion = forces.join(motions)
    target = motion.acceleration[:, :2].reshape(-1)
    design = np.moveaxis(_columns(motion, sign, wind), 0, 2).reshape(len(target), -1)
    weight = np.ones(len(target))
    for _ in range(_ITERATIONS):
        rows = design * weight[:, None]
        rest = target - design @ np.linalg.lstsq(rows, target * weight, rcond=None)[0]
        weight = forces.huber_weights(rest) / max(robust_std(rest), 1e-3)
    both = np.column_stack([design, target]) * weight[:, None]
    ends = np.cumsum([2 * len(each.time) for each in motions])[:-1]
    pieces = [np.array_split(each, _PIECES) for each in np.split(both, ends)]
    products = np.array([[part.T @ part for part in each] for each in pieces])
    less = products.sum(1), products.sum(0)  # Without a flight; without a part of all.
    without = products.sum((0, 1)) - np.concatenate([0.0 * less[0][:1], *less])
    found = []
    for chosen in itertools.product((False, True), repeat=len(_OPTIONAL)):
        optional = itertools.compress(_OPTIONAL, chosen)
        index = [*_FIXED, *itertools.chain(*optional)]
        square = without[:, index][:, :, index] + np.diag(_PRIORS[index] ** -2.0)
        solution = np.linalg.solve(square, without[:, index, -1:])[..., 0]
        size, *others = np.log(np.hypot(*solution[:, _GRAVITY].T))
        errors = [
            np.std(parts) * np.sqrt(len(parts) - 1)
            for parts in np.split(others, [len(motions)])
        ]
        found.append((float(size), float(max(errors))))
    return found


def _columns(motion: Motion, sign: int, wind: np.ndarray) -> np.ndarray:
    """Accelerations (16, k, 2) by forces, offsets, thrust, turning and gravity."""
    body, normal = forces.body_axes(sign * motion.pose[:, 2])
    air = motion.velocity[:, :2] - wind
    speed = np.maximum(np.hypot(*air.T), 1e-3)[:, None]
    across = np.sum(air * normal, axis=1)[:, None] / speed
    stalling = [across * np.abs(across) * normal, across * np.abs(across) * body]
    stalling += [across**3 * normal, across**2 * body]
    quicker = speed / np.mean(speed) - 1.0
    turning = [sign * motion.velocity[:, 2:] * speed * axis for axis in (normal, body)]
    return np.stack(
        [
            *forces.force_columns(motion, sign, wind),
            *(speed**2 * force for force in stalling),
            *forces.offset_columns(motion, sign),
            body,
            *turning,
            quicker * speed**2 * across * normal,
            *np.broadcast_to(np.eye(2)[:, None], (2, len(speed), 2)),
        ]
    )
