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
from glider.campaign.checks.forces import ForceFit, Motions
from glider.campaign.checks.motion import Motion, jackknife_error, robust_std
from glider.campaign.checks.rates import claim_scale
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
    fall, error = measure_fall(shown)
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


def _cut(motions: Motions) -> Motions:
    """Pieces of flights, as flights."""
    pieces = []
    for motion in motions.each:
        parts = [np.array_split(values, _PIECES) for values in motion]
        pieces += [Motion(*values) for values in zip(*parts, strict=True)]
    return Motions(tuple(pieces))


def measure_fall(motions: Motions) -> tuple[float, float]:
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
    columns = _columns(motion, fit.wind)
    target = motion.acceleration[:, :2].reshape(-1)
    design = np.moveaxis(columns, 0, 2).reshape(len(target), -1)
    _, rest, weight = forces.fit_robustly(design, target, _ITERATIONS)
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


def _columns(motion: Motion, wind: np.ndarray) -> np.ndarray:
    """Accelerations (16, k, 2) by forces, offsets, thrust, turning and gravity."""
    body, normal = motion.axes
    air = motion.velocity[:, :2] - wind
    speed = np.linalg.norm(air, axis=1, keepdims=True)
    speed = np.maximum(speed, 1e-3)
    across = np.sum(air * normal, axis=1)[:, None] / speed
    flows = forces.force_columns(motion, wind)
    lift, along, *_ = flows  # By the normal flow.
    stalling = [np.abs(across) * lift, np.abs(across) * along]
    stalling += [across**2 * lift, across * along]
    turning = motion.velocity[:, 2:] * speed
    quicker = speed / np.mean(speed) - 1.0
    others = [body, turning * normal, turning * body, quicker * lift]
    gravity = np.broadcast_to(np.eye(2)[:, None], (2, len(speed), 2))
    offsets = forces.offset_columns(motion)
    return np.stack([*flows, *stalling, *offsets, *others, *gravity])
