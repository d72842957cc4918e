"""Choice of a basis model: the one that best predicts held-out flights."""

from collections.abc import Callable, Iterable, Mapping

import numpy as np

from basis_dynamics import (
    CHANNELS,
    BasisFit,
    BasisFrame,
    Numbers,
    SampledFlights,
    best_numbers,
    fit_basis,
)
from basis_features import PAPER
from basis_refinement import rollout_error
from glider.errors import InputError

Candidate = Callable[[SampledFlights], Numbers]
"""Function from the flights to fit to the features of each channel: a search is part of
the fit, so it must not see the held-out flights either."""


def configured(numbers: Numbers) -> Candidate:
    """Returns given features as a candidate."""
    return lambda flights: numbers


def searched(frame: BasisFrame, features: Iterable[int], most: int) -> Candidate:
    """Returns the best subsets of up to so many features as a candidate."""
    return lambda flights: best_numbers(flights, frame, tuple(features), most)


def candidates_of(
    frame: BasisFrame, configurations: Mapping[str, Numbers]
) -> dict[str, Candidate]:
    """Returns configurations, and the best subsets of up to 1, 2 and 3 features.

    The subsets are named "best 1" and so on, of the paper's features.
    """
    given = {name: configured(numbers) for name, numbers in configurations.items()}
    return given | {f"best {most}": searched(frame, PAPER, most) for most in (1, 2, 3)}


def cross_validate(
    flights: SampledFlights,
    frame: BasisFrame,
    candidates: Mapping[str, Candidate],
    folds: int = 7,
    ridge: float = 0.0,
) -> dict[str, float]:
    """Returns the weighted RMS rollout error of each candidate on held-out flights.

    Whole flights are held out, every fold-th one: rows of one flight resemble
    each other. A candidate that diverges has an infinite error.

    Args:
        flights: to choose by.
        frame: of the models.
        candidates: by name.
        folds: parts that are held out in turn, 2 to the number of flights.
        ridge: as in `least_squares`.

    Raises:
        InputError: folds is out of range; or, without a ridge, a candidate has
            features that the fitted flights do not distinguish.
    """
    count = len(flights.rates)
    if not 2 <= folds <= count:
        raise InputError(
            f"cross_validate: folds is {folds}; 2 to {count} are needed for "
            f"{count} flights."
        )
    errors = {}
    for name, choose in candidates.items():
        squares = np.zeros(count)
        for fold in range(folds):
            left_out = list(range(fold, count, folds))
            rest = flights.pick([i for i in range(count) if i not in left_out])
            fit = fit_basis(rest, frame, choose(rest), ridge)
            if ridge == 0.0:
                _check_ranks(fit, name)
            error = rollout_error(fit.model, flights.pick(left_out))
            squares[left_out] = error.weighted**2
        errors[name] = float(np.sqrt(np.mean(squares)))
    return errors


def _check_ranks(fit: BasisFit, name: str) -> None:
    channels = zip(CHANNELS, fit.model.numbers, fit.regressions, strict=True)
    for channel, chosen, regression in channels:
        if not regression.has_full_rank:
            raise InputError(
                f"cross_validate: candidate '{name}' has features "
                f"{', '.join(map(str, chosen))} in the {channel} channel, of rank "
                f"{regression.rank}; expected features that the flights "
                "distinguish, or a ridge."
            )
