"""A change during a session: a break, or a drift, of one coefficient of the glider.

The flights, in order, are linear about the model that was fitted to all of them. Let
G_i be the information of flight i (see `glider.sysid.likelihood.information`), β the
coefficients that were fitted, and δ the change of one coefficient, of which flight i
has a share s_i. Of a break the shares are 0 before it and 1 after it; of a drift they
grow evenly from -1/2 to 1/2. With β solved for, the likeliest change and its gain of
log-likelihood are

    δ = n / c,   gain = ½ n² / c,
    n = Σ s_i G_i[δ, error] - M'z,   c = Σ s_i² G_i[δ, δ] + λ - M'M,
    M = Σ s_i L⁻¹ G_i[β, δ],   z = L⁻¹ Σ G_i[β, error],   L L' = Σ G_i[β, β] + Λ,

where λ and Λ are the precisions of the priors.
"""

import dataclasses
from collections.abc import Collection, Iterable

import numpy as np
from scipy.special import stdtr, stdtrit

from glider.campaign.changes import LEAST_SIDE, Change, by_number
from glider.physics.confidence import LEVEL
from glider.sysid.constants import LEAST_SPREAD
from glider.sysid.fit.folds import LinearFlights
from glider.sysid.likelihood.candidates import Candidates
from glider.sysid.likelihood.filtering import flight_values
from glider.sysid.likelihood.information import Prior, counted_from
from glider.sysid.likelihood.model_fit import error_flights
from glider.sysid.likelihood.scales import FLOOR, Scales
from glider.sysid.likelihood.task import FitResult, Task
from glider.sysid.search.tracing import without_late

# Probability of a change in a session without one (c); each of two tests has half.
_LEVEL = 0.001
# If none gains as much, p is half of the level.
_PERMUTATIONS = round(2.0 / _LEVEL) - 1
_FEWEST = 5  # Flights whose scatter about two means says anything.


def find_change(
    session: Task, model: FitResult, rng: np.random.Generator
) -> Change | None:
    """Finds the change of a coefficient that the order of the flights shows.

    Coefficients are those of the library's formulas that the search tries first, and of
    those that act.

    Args:
        session: the task on all flights; the numbers in their names have the order.
        model: that was fitted to them.
        rng: for permutations of the flights.

    Returns:
        The change; None where there is none, or too few flights to show one.
    """
    if len(session.records) < _FEWEST:
        return None
    scales = _scales_from_flight_to_flight(session, model)
    model = dataclasses.replace(model, scales=scales)
    formulas = without_late(session, model.kinds)
    flights = LinearFlights(formulas.offering(formulas.kinds), model)
    share, prior = flights.candidates.nothing()
    # Flights' values are compared about the model.
    grams = counted_from(flights.grams, -share)
    return change_of(flights.candidates, grams, prior, rng)


def _scales_from_flight_to_flight(session: Task, model: FitResult) -> Scales:
    """Returns the scales, with variations no larger than from one flight to the next.

    Half the mean square of successive differences is the variance of values that are
    independent. A break or a drift, which a fitted scale takes for a variation, hardly
    adds to it (von Neumann, Annals of Mathematical Statistics 12, 1941). Values that
    flights hardly show are drawn towards zero: their scale comes out too small.
    """
    scales = model.scales
    flights = error_flights(session, model)
    flights.sort(key=lambda flight: by_number(flight.record.name))
    steps = np.diff(flight_values(flights, scales), axis=0)

    # A flight on which the model diverges has no values.
    usual = np.sqrt(0.5 * np.nanmean(steps**2, axis=0))
    wind_x, wind_z, trim, pitch_zero = np.fmin(usual, scales.of_flights)
    return dataclasses.replace(
        scales,
        wind=max(FLOOR.wind, wind_x, wind_z),
        trim=max(FLOOR.trim, trim),
        pitch_zero=max(FLOOR.pitch_zero, pitch_zero),
    )


def change_of(
    candidates: Candidates, grams: np.ndarray, prior: Prior, rng: np.random.Generator
) -> Change | None:
    """Finds the change that the information of the flights shows.

    It is the one of the largest gain, if that is not by chance: the values of the
    coefficient in the flights scatter little about the break or the drift, by Student's
    t with Bonferroni's correction for all changes; or no permutation of the flights
    gains as much, whatever the distribution of the values. The first test takes the
    coefficient alone, without β, which is common to all flights; it detects a change of
    a few flights, of which there are few permutations. By that test either side of a
    break must also be apart from the other by its own scatter: a few flights that a
    formula explains badly are not.

    Args:
        candidates: the effects about the model, and the records' names.
        grams: (n, M + 1, M + 1) of the flights.
        prior: of the columns' changes.
        rng: for the permutations.

    Returns:
        The change; None where it may be by chance, or is too small to report.
    """
    count = len(grams)
    columns = _columns_of(candidates, grams)
    if not columns:
        return None
    beta = [*candidates.always]
    for kind in candidates.model.kinds:
        [acting] = candidates.variants[kind]
        beta += acting

    # The terms of the formulas: L⁻¹ (b, b), z (b,) and, of each flight and coefficient,
    # L⁻¹ G[β, δ] (n, b, m), G[δ, error] and G[δ, δ] (n, m).
    known = grams.sum(axis=0)
    information = known[np.ix_(beta, beta)] + np.diag(prior.precision[beta])
    inverse_root = np.linalg.inv(np.linalg.cholesky(information))
    z = inverse_root @ known[beta, -1]
    beta_delta = inverse_root @ grams[:, beta][:, :, columns]
    delta_error = grams[:, columns, -1]
    delta_delta = grams[:, columns, columns]

    # Shares (k, n) of the flights in each change, by their order. Row i of the triangle
    # is the break at flight i; the first and last leave too few on a side.
    breaks = np.triu(np.ones((count, count)))[LEAST_SIDE : count - LEAST_SIDE + 1]
    shares = np.vstack([breaks, np.linspace(-0.5, 0.5, count)])
    slots = [candidates.slots[j] for j in columns]
    least = LEAST_SPREAD * candidates.task.space.scale[slots]

    def changes(order: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns all changes (k, m) with the flights in an order, the drift last.

        Their gains [nats], zero where one is too small to report, sizes and standard
        errors. In the formulas `mixed` is M, `slope` n and `curvature` c.
        """
        mixed = np.tensordot(shares, beta_delta[order], 1)  # (k, b, m)
        slope = shares @ delta_error[order]
        slope -= np.einsum("kbm,b->km", mixed, z)

        curvature = shares**2 @ delta_delta[order]
        curvature += prior.precision[columns]
        curvature -= (mixed**2).sum(axis=1)
        curvature = np.maximum(curvature, 1e-12)

        sizes = slope / curvature
        gains = 0.5 * slope * sizes
        gains[np.abs(sizes) < least] = 0.0
        return gains, sizes, curvature**-0.5

    names = [record.name for record in candidates.task.records]
    order = np.array(sorted(range(count), key=lambda i: by_number(names[i])))
    gains, sizes, stds = changes(order)
    row, column = divmod(int(gains.argmax()), len(columns))
    gain = gains[row, column]
    if gain == 0.0:
        return None

    # Is it chance? By the scatter of the values, or else by permutations.
    weights = delta_delta[order, column]
    values = delta_error[order, column] / np.maximum(weights, 1e-300)
    chance = _chance_of_slope(values, weights, shares[row]) * gains.size
    is_drift = row == len(breaks)
    is_sure = chance <= 0.5 * _LEVEL
    if is_sure and not is_drift:
        is_sure = _are_apart(values, weights, shares[row] > 0.0)
    if not is_sure:
        for _ in range(_PERMUTATIONS):
            others, *_ = changes(rng.permutation(count))
            if others.max() >= gain:
                return None

    coefficient = candidates.task.space.entries[slots[column]]
    return Change(
        kind=candidates.directions[columns[column]].kind,
        coefficient=coefficient.name,
        unit=coefficient.unit,
        value=float(sizes[row, column]),
        std=float(stds[row, column]),
        flight="" if is_drift else names[order[row + LEAST_SIDE]],
    )


def _columns_of(candidates: Candidates, grams: np.ndarray) -> list[int]:
    """Returns the columns of the coefficients that may change.

    They are those of the library's formulas, not of free functions; sizes, not shapes,
    in which the flights are not linear; and they show in a flight, by its information
    on them in the grams (n, M + 1, M + 1).
    """
    space = candidates.task.space
    offered: set[int] = set()
    for kind in candidates.variants.keys() & space.kinds.keys():
        offered.update(*candidates.variants[kind])
    sizes = [j for j in sorted(offered) if candidates.slots[j] not in space.shapes]
    return [j for j in sizes if np.any(grams[:, j, j] > 0.0)]


def are_at_one_end(some: Collection[str], names: Iterable[str]) -> bool:
    """Whether two flights or more are the first, or the last, of all by number."""
    ordered = sorted(names, key=by_number)
    count = len(some)
    if not LEAST_SIDE <= count <= len(ordered) - LEAST_SIDE:
        return False
    return set(some) in (set(ordered[:count]), set(ordered[-count:]))


def _chance_of_slope(
    values: np.ndarray, weights: np.ndarray, shares: np.ndarray
) -> float:
    """Returns the probability that values without a change follow their shares as well.

    By Student's t of a regression of values (n,) on shares (n,) with weights (n,), from
    its correlation r: t = |r| √((n - 2) / (1 - r²)).
    """
    (square, both), (_, spread) = np.cov(values, shares, ddof=0, aweights=weights)
    correlation = both / np.sqrt(max(square * spread, 1e-300))
    unexplained = max(1.0 - correlation**2, 1e-300)
    freedom = len(values) - 2
    t = abs(correlation) * np.sqrt(freedom / unexplained)
    return 2.0 * float(stdtr(freedom, -t))


def _are_apart(values: np.ndarray, weights: np.ndarray, after: np.ndarray) -> bool:
    """Whether values (n,) differ on both sides of a break, by each side's own scatter.

    By Student's t of a side's weighted mean, from that of the other, with LEVEL.

    Args:
        values: of the flights.
        weights: of the values, (n,).
        after: (n,) which are after the break.
    """
    sides = [(values[side], weights[side]) for side in (~after, after)]
    if not all(w.any() for _, w in sides):
        return False
    jump = np.diff([np.average(own, weights=w) for own, w in sides])[0]
    for own, w in sides:
        error = np.sqrt(np.cov(own, aweights=w, ddof=0) / (len(own) - 1))
        least = stdtrit(len(own) - 1, 0.5 * (1.0 + LEVEL))
        if abs(jump) < least * error:
            return False
    return True
