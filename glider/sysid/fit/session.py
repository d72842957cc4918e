"""A change during a session: a break, or a drift, of one coefficient of the glider.

The flights, in order, are linear about the model that was fitted to all. Let R_i be the
information of flight i on the coefficients β that are fitted and on one more, δ, of
which flight i has a share w_i: all of it from some flight on, or a part that grows with
the flight's number. With β solved for, the gain of log-likelihood is

    ½ (Σ w_i r_i - W'z)² / (Σ w_i² d_i + λ - W'W),   W = L⁻¹ Σ w_i R_i[β, δ],

L L' the information on β, z what the errors are along it, and λ the prior's.
"""

import re
from collections.abc import Collection, Iterable
from typing import NamedTuple

import numpy as np
from scipy.special import stdtr

from glider.sysid.constants import LEAST_SPREAD
from glider.sysid.fit.folds import LinearFlights
from glider.sysid.likelihood.candidates import Candidates
from glider.sysid.likelihood.model_fit import Prior
from glider.sysid.likelihood.task import FitResult, Task
from glider.sysid.result import Change
from glider.sysid.search.tracing import without_late

# Probability with which a session without a change is said to have one (c): half of it
# for each of the two tests.
_LEVEL = 0.001
_PERMUTATIONS = round(2.0 / _LEVEL) - 1  # None of which may gain as much.
_LEAST_SIDE = 2  # Flights on either side of a break: one alone is an outlier.
_FEWEST = 5  # Flights of which the variance about two means says anything.


class _Gains(NamedTuple):
    """Gains of all changes of all columns; the last row is the drift."""

    values: np.ndarray  #: (k, m) [nats]; none where the change is not reported.
    sizes: np.ndarray  #: (k, m) of the changes.
    stds: np.ndarray  #: (k, m) standard errors of the sizes.


def find_change(
    session: Task, model: FitResult, rng: np.random.Generator
) -> Change | None:
    """Finds the change of a coefficient that the order of the flights shows.

    Of the library's formulas, about the model that was fitted to the flights.

    Args:
        session: all flights; their names have the order.
        model: that was fitted to them.
        rng: for permutations of the flights.
    """
    formulas = without_late(session, model.kinds)
    flights = LinearFlights(formulas.offering(formulas.kinds), model)
    return change_of(flights.candidates, flights.grams, flights.prior, rng)


def change_of(
    candidates: Candidates, grams: np.ndarray, prior: Prior, rng: np.random.Generator
) -> Change | None:
    """Finds the change that the information of the flights shows.

    That of the largest gain among those as large as a variation over flights that is
    reported. It is not put down to chance if the values of the coefficient in the
    flights scatter little about their means before and after it (or about the line):
    Student's t, whichever change is chosen. Or if no permutation of the flights gains
    as much, which holds whatever the distribution of the values is.

    Args:
        candidates: the effects about the fitted model, without flights.
        grams: (flights, M + 1, M + 1) of the task's flights about the model.
        prior: of the columns' changes.
        rng: for the permutations.
    """
    count = len(grams)
    space = candidates.task.space
    names = [record.name for record in candidates.task.records]
    in_order = np.array(sorted(range(count), key=lambda i: by_number(names[i])))
    slots = candidates.slots
    columns = []
    for kind, variants in candidates.variants.items():
        if kind in space.kinds:
            offered = {j for variant in variants for j in variant}
            columns += sorted(j for j in offered if slots[j] not in space.shapes)
    acting = [candidates.variants[k][0] for k in candidates.model.kinds]
    base = sorted({*candidates.always, *(j for variant in acting for j in variant)})
    columns = [j for j in columns if np.any(grams[:, j, j] > 0.0)]
    if count < _FEWEST or not columns:
        return None

    known = grams.sum(axis=0)
    information = known[np.ix_(base, base)] + np.diag(prior.precision[base])
    root = np.linalg.inv(np.linalg.cholesky(information))
    along = root @ known[base, -1]
    shared = root @ grams[:, base][:, :, columns]
    errors = grams[:, columns, -1]
    squares = grams[:, columns, columns]
    shares = np.triu(np.ones((count, count)))[_LEAST_SIDE : 1 - _LEAST_SIDE]
    least = LEAST_SPREAD * space.scale[[slots[j] for j in columns]]
    shares = np.vstack([shares, np.linspace(-0.5, 0.5, count)])

    def gains_of(order: np.ndarray) -> _Gains:
        mixed = np.tensordot(shares, shared[order], 1)
        slope = shares @ errors[order] - np.einsum("kbm,b->km", mixed, along)
        curvature = shares**2 @ squares[order] + prior.precision[columns]
        curvature = np.maximum(curvature - np.sum(mixed**2, axis=1), 1e-12)
        sizes = slope / curvature
        gains = np.where(np.abs(sizes) < least, 0.0, 0.5 * slope * sizes)
        return _Gains(gains, sizes, curvature**-0.5)

    found = gains_of(in_order)
    at, own = divmod(int(np.argmax(found.values)), found.values.shape[1])
    largest = found.values[at, own]
    if largest == 0.0:
        return None
    weights = squares[in_order, own]
    values = errors[in_order, own] / np.maximum(weights, 1e-300)
    chance = _chance_of_slope(values, weights, shares[at]) * found.values.size
    if chance > 0.5 * _LEVEL:
        for _ in range(_PERMUTATIONS):
            if gains_of(rng.permutation(count)).values.max() >= largest:
                return None

    is_drift = at == len(shares) - 1
    coefficient = space.entries[slots[columns[own]]]
    return Change(
        kind=candidates.directions[columns[own]].kind,
        coefficient=coefficient.name,
        unit=coefficient.unit,
        value=float(found.sizes[at, own]),
        std=float(found.stds[at, own]),
        flight="" if is_drift else names[in_order[at + _LEAST_SIDE]],
    )


def by_number(name: str) -> list[tuple[int, str]]:
    """Returns the key by which flight_2 comes before flight_10."""
    parts = re.split(r"(\d+)", name)
    return [(int(part) if part.isdecimal() else -1, part) for part in parts]


def begin_of_end(names: Iterable[str], some: Collection[str]) -> str | None:
    """Returns at which flight some, which are all at one end, meet the others."""
    ordered = sorted(names, key=by_number)
    count = len(some)
    if not _LEAST_SIDE <= count <= len(ordered) - _LEAST_SIDE:
        return None
    if {*ordered[-count:]} == {*some}:
        return ordered[-count]
    return ordered[count] if {*ordered[:count]} == {*some} else None


def _chance_of_slope(
    values: np.ndarray, weights: np.ndarray, shares: np.ndarray
) -> float:
    """Probability of such a slope of values (n,) along their shares (n,) by chance.

    A weighted regression whose residuals give the variance.
    """
    mean = np.average(values, weights=weights)
    centered = shares - np.average(shares, weights=weights)
    moment = np.sum(weights * centered**2)
    slope = np.sum(weights * centered * values) / moment
    left = np.sum(weights * (values - mean - slope * centered) ** 2)
    freedom = len(values) - 2
    t = abs(slope) / np.sqrt(max(left, 1e-300) / freedom / moment)
    return 2.0 * float(stdtr(freedom, -t))
