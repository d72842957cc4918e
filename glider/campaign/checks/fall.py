"""Do flights fall at the gravity of the campaign? The scale of lengths and times.

Lengths that are logged a times too long, and times b times too long, make gravity
a / b² times what it is; nothing else in a log contradicts a wrong scale. Measured
accelerations are explained by a constant, which is gravity, and by forces of the air in
32 ways (see `forces`): lift and drag with camber and a stall, with and without a wind,
a thrust, a tracked point off the center of mass, lift by the pitch rate, and lift
coefficients that depend on the airspeed. Flights rarely show which of them is right, so
that the scatter over the ways is part of the uncertainty. So is the scatter with a
flight left out, or with a quarter of the time of all flights if that is larger.

Measured (benchmarks/bench_fall.py): of 501 campaigns and parts of campaigns of
three flights or more, simulated with strong effects or thrown by hand, the logarithm
of gravity is off by 0.5 standard deviations (RMS), and by at most 1.4 in any. The
standard deviation is 0.05 to 0.09 of a campaign, 0.09 to 0.11 of three throws.
"""

import itertools
import math

import numpy as np

from glider.campaign.checks.forces import (
    GRAVITY,
    Motions,
    fit_robustly,
    make_force_design,
)
from glider.campaign.checks.motion import robust_std
from glider.campaign.checks.rates import claim_scale
from glider.campaign.logs import Campaign

_MIN_FLIGHTS = 3  # One throw alone may be off by far more than it shows: a warning.
_PIECES = 4  # That flights are cut into: with one left out, forms of forces matter.
_DOUBTFUL = 0.05  # Part by which gravity may be off without a warning.
_WRONG = 0.15  # Part by which it may be off without a refusal.
_SURELY = 1.7  # Standard deviations by which it must be off, too.
_UNKNOWN = 0.2
"""Standard deviation of the logarithm of gravity above which flights do not show it."""

_LEAST_ERROR = 0.02  # Of the logarithm of gravity: of the local cubics.
_WAY_ERROR = 0.03  # Of each way, below which ways count as equally certain.
_ITERATIONS = 4  # Of Huber's weights.

_OF_WAY = np.repeat([4, 0, 1, 4, 2, 3], [4, 2, 1, 6, 2, 1])
"""Which columns a way may omit: offsets, thrust, turning, airspeed; 4 are none."""
_PRIORS = np.repeat([10.0, 0.3, 10.0, 1e3, 10.0, 1.0, 10.0], [4, 2, 1, 2, 4, 2, 1])
"""Standard deviations of the coefficients: forces [1/m], offsets [m], thrust [m/s²],
gravity [m/s²], forces of a stall [1/m], turning, a lift that is proportional to the
airspeed's departure from its mean [1/m]."""
_OMITTED = 1e-6  # Factor of the standard deviations of columns that a way omits.


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
    fall, error = _measure_fall(shown)
    if error > _UNKNOWN:
        line = (
            f"the flights show gravity to ± {100 * error:.0f} % only: check the units "
            "of lengths and times"
        )
        return (line,) if says_unknown else ()

    refused = _WRONG
    surely = _SURELY
    if len(shown.each) < _MIN_FLIGHTS or shown.are_alike:
        refused = math.inf
        surely = 2.0 * _SURELY
    ratio = fall / max(campaign.gravity, 1e-3)
    found = (
        f"the flights fall at {fall:.3g} ± {error * fall:.1g} m/s² and "
        f"'gravity' is {campaign.gravity:.4g}: expected lengths {1.0 / ratio:.3g} "
        f"times as large ('units: length'), times {np.sqrt(ratio):.3g} times as "
        "large ('units: time', the frame rate), or the right gravity"
    )
    return claim_scale(campaign, ratio, surely * error, (_DOUBTFUL, refused), found)


def _measure_fall(motions: Motions) -> tuple[float, float]:
    """Gravity as flights show it [m/s²], and the standard error of its logarithm.

    The logarithm is the mean over all ways, the more certain ones with more weight. Its
    variance is the mean of theirs, their scatter, and that of the local cubics.
    """
    fit = motions.fit
    in_still_air = _measure_each_way(motions, fit.sign, np.zeros(2))
    in_wind = _measure_each_way(motions, fit.sign, fit.wind)
    logarithm, error = np.hstack([in_still_air, in_wind])
    weight = 1.0 / (error**2 + _WAY_ERROR**2)
    mean = np.average(logarithm, weights=weight)
    square = error**2 + (logarithm - mean) ** 2
    variance = np.average(square, weights=weight) + _LEAST_ERROR**2
    return np.exp(mean), np.sqrt(variance)


def _measure_each_way(motions: Motions, sign: int, wind: np.ndarray) -> np.ndarray:
    """Logarithm of gravity and its jackknife error (2, 16), by sets of columns.

    A wind (2,) [m/s] and the sign of the pitch are given. The Gram matrices [A b]ᵀ[A b]
    of parts of the flights suffice for the fits of all ways, and of all parts left out.
    """
    # Rows [A b], weighted and over their noise.
    motion = motions.joined.with_pitch(sign)
    target = motion.acceleration[:, :2].reshape(-1)
    design = make_force_design(motion, wind)
    _, rest, weight = fit_robustly(design, target, _ITERATIONS)
    weight = weight / max(robust_std(rest), 1e-3)
    rows = np.column_stack([design, target]) * weight[:, None]

    # Gram matrices (flights, pieces, 17, 17), and those of what is left out in turn:
    # a piece of each flight, or a flight.
    ends = np.cumsum([2 * len(each.time) for each in motions.each])
    grams = []
    for flight in np.split(rows, ends[:-1]):
        pieces = np.array_split(flight, _PIECES)
        grams.append([piece.T @ piece for piece in pieces])
    of_flights = np.sum(grams, axis=1)
    total = np.sum(of_flights, axis=0)
    left_out = [np.sum(grams, axis=0)]
    if len(of_flights) >= _MIN_FLIGHTS:
        left_out.append(of_flights)

    found = []
    for factors in itertools.product((_OMITTED, 1.0), repeat=4):
        prior = np.array([*factors, 1.0])[_OF_WAY] * _PRIORS
        errors = []
        for parts in left_out:
            estimates = _solve_gravity(total - parts, prior)
            # The jackknife's √((k - 1)/k Σ (xᵢ - x̄)²) with each of k parts left out.
            errors.append(np.std(estimates) * np.sqrt(len(estimates) - 1.0))
        found.append((_solve_gravity(total, prior), max(errors)))
    return np.transpose(found)


def _solve_gravity(gram: np.ndarray, prior: np.ndarray) -> np.ndarray:
    """Logarithms (...) of gravity by Gram matrices (..., 17, 17) of design and target.

    The coefficients are those of largest posterior probability under independent
    normal priors with these standard deviations (16,).
    """
    precision = gram[..., :-1, :-1] + np.diag(prior**-2.0)
    solution = np.linalg.solve(precision, gram[..., :-1, -1:])  # (..., 16, 1)
    return np.log(np.linalg.norm(solution[..., GRAVITY, 0], axis=-1))
