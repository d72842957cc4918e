"""Residual fields over a variable, of no formula of the library.

A field is a sum of Gaussians over one of FIELD_VARIABLES, as a motion of the air or as
changes of C_L, C_D and C_M. It reduces the error and shows where to look.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from glider.compiled.parallel import in_parallel
from glider.physics.effects import FIELD_TERMS, FIELD_VARIABLES
from glider.physics.effects.field import AIR_TERMS, COEFFICIENTS, FieldData
from glider.sysid.likelihood.directions import slopes
from glider.sysid.likelihood.linear_flight import LinearFlight
from glider.sysid.likelihood.model_fit import (
    FitResult,
    fit_model,
    grams_of,
    linear_flights,
    prior_of,
)
from glider.sysid.likelihood.task import Task
from glider.sysid.replay.residual import flow_variables

FORMS = {"air": AIR_TERMS, "forces": COEFFICIENTS}
"""Forms that a field may have, and the terms of each."""

SPREADS = {"air": (0.5, 0.5), "forces": (0.2, 0.2, 0.01)}
"""Prior spread of the weights [m/s; -, -, m]."""

SURVEYED = (
    *(("air", name) for name in ("x", "z", "t")),
    *(("forces", name) for name in FIELD_VARIABLES if name != "pitch"),
)
"""Forms and variables that are looked at."""

COARSE = 12
"""Number of Gaussians in the survey."""

LEADING = 0.8
"""Share of the best field's evidence above which another is fitted too: a time and the
place that is reached by then are similar to few Gaussians."""

MOST_LEADING = 3
"""Fields of a survey that are fitted at most."""

FINER = (18, 27, 40)
"""Numbers that are tried afterwards."""

SURVEY_FLIGHTS = 12
"""Flights of the survey; the field is fitted to all."""

_LEAST_RANGE = 1e-6
"""Range below which a residual cannot depend on a variable."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Basis:
    """Gaussians over one variable, for terms of one form."""

    form: str
    variable: str
    terms: tuple[str, ...]
    centers: np.ndarray
    width: float

    @property
    def count(self) -> int:
        """Number of weights."""
        return len(self.centers) * len(self.terms)

    def data(self, weights: np.ndarray) -> FieldData:
        """Returns the field with weights (count,), functions first, then terms."""
        by_term = weights.reshape(-1, len(self.terms)).T
        return FieldData(
            kind="unexplained",
            variables=[self.variable],
            centers=self.centers[:, None].tolist(),
            widths=[self.width],
            weights=dict(zip(self.terms, by_term.tolist(), strict=True)),
        )

    @property
    def spreads(self) -> np.ndarray:
        """Prior spread of the weights, functions first, then terms."""
        of_form = dict(zip(FORMS[self.form], SPREADS[self.form], strict=True))
        return np.tile([of_form[name] for name in self.terms], len(self.centers))

    def of_terms(self, terms: Sequence[str]) -> np.ndarray:
        """Returns the indices of the weights of some terms."""
        return np.flatnonzero(np.isin(self.terms * len(self.centers), terms))

    def widened(self, flight: LinearFlight, theta: np.ndarray) -> LinearFlight:
        """Returns a flight with a column for each weight, before the last."""
        column = FIELD_VARIABLES.index(self.variable)
        values = flow_variables(flight.record, theta)[:, column]
        middle = 0.5 * (values[1:] + values[:-1])
        functions = np.exp(-0.5 * ((middle[:, None] - self.centers) / self.width) ** 2)
        terms = [FIELD_TERMS.index(name) for name in self.terms]
        return flight.with_forces(functions, terms, np.eye(self.count))


def make_basis(
    task: Task, theta: np.ndarray, form: str, variable: str, count: int
) -> Basis | None:
    """Spreads Gaussians over the flown range; None where that is a point."""
    column = FIELD_VARIABLES.index(variable)
    flown = np.concatenate([flow_variables(r, theta)[:, column] for r in task.records])
    low, high = np.percentile(flown, [0.5, 99.5])
    if high - low < _LEAST_RANGE:
        return None
    centers = np.linspace(low, high, count)
    return Basis(
        form=form,
        variable=variable,
        terms=FORMS[form],
        centers=centers,
        width=float(centers[1] - centers[0]),
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Survey:
    """Evidence of each field on top of a model [nats], by form and variable."""

    gains: dict[tuple[str, str], float]

    @property
    def most(self) -> float:
        """Evidence of the best field [nats]; -inf where there is none."""
        return max(filter(np.isfinite, self.gains.values()), default=-np.inf)

    @property
    def leading(self) -> list[tuple[str, str]]:
        """The best and those that so coarse a survey cannot distinguish from it."""
        finite = [key for key, gain in self.gains.items() if np.isfinite(gain)]
        ranked = sorted(finite, key=lambda key: -self.gains[key])
        least = LEADING * self.gains[ranked[0]] if ranked else 0.0
        return [key for key in ranked if self.gains[key] >= least][:MOST_LEADING]

    def nearly_as_good(self, key: tuple[str, str]) -> tuple[str, ...]:
        """Returns the variables that explain at least two thirds as much."""
        ranked = sorted(self.gains, key=lambda k: -self.gains[k])
        enough = [v for f, v in ranked if self.gains[f, v] > self.gains[key] / 1.5]
        return tuple(dict.fromkeys((key[1], *enough)))


def _gain(
    flights: list[LinearFlight],
    task: Task,
    model: FitResult,
    basis: Basis,
    now: np.ndarray | None = None,
    terms: Sequence[str] | None = None,
) -> tuple[float, np.ndarray, np.ndarray]:
    """Returns a field's evidence, its weights and their covariance.

    Where the model diverges, the evidence is -inf and the others are NaN. The model may
    have weights of the field already (`now`), and only some terms may act.
    """
    acting = basis.of_terms(basis.terms if terms is None else terms)
    count = len(acting)
    wide = in_parallel(lambda f: basis.widened(f, model.theta), flights)
    gram = np.sum(grams_of(wide, model.scales), axis=0)
    if not np.all(np.isfinite(gram)):
        return -np.inf, np.full(count, np.nan), np.full((count, count), np.nan)
    own, mean, precision = prior_of(task, model, model.free)
    m = len(own)
    if now is not None:  # The weights count from nothing: their share is given back.
        gram[:, -1] += gram[:, m:-1] @ now
        gram[-1] = gram[:, -1]
    keep = np.concatenate([np.arange(m), m + acting, [len(gram) - 1]])
    gram = gram[np.ix_(keep, keep)]
    every = np.concatenate([precision, basis.spreads[acting] ** -2])
    total = gram[:-1, :-1] + np.diag(every)
    side = gram[:-1, -1].copy()
    side[:m] += precision * (mean - own)

    def half(columns: slice) -> float:
        corner = cho_factor(total[columns, columns], lower=True)
        solved = cho_solve(corner, side[columns])
        log_volume = 2.0 * np.sum(np.log(np.diag(corner[0])))
        log_volume -= np.sum(np.log(every[columns]))
        return 0.5 * float(side[columns] @ solved) - 0.5 * log_volume

    gained = half(slice(0, m + count)) - (half(slice(0, m)) if m else 0.0)
    inverse = np.linalg.inv(total)
    return gained, (inverse @ side)[m:], inverse[m:, m:]


def survey(task: Task, model: FitResult) -> Survey:
    """Computes the evidence of a field over each variable, on top of a model."""
    few = task.thinned(SURVEY_FLIGHTS)
    flights = linear_flights(few, model, slopes(task.layout, model.theta, model.free))
    gains = {}
    for form, variable in SURVEYED:
        basis = make_basis(few, model.theta, form, variable, COARSE)
        if basis is not None:
            gains[form, variable] = _gain(flights, few, model, basis)[0]
    return Survey(gains=gains)


@dataclasses.dataclass(frozen=True, kw_only=True)
class FoundField:
    """A field in a model."""

    model: FitResult  # With the field.
    basis: Basis  # Of it.
    covariance: np.ndarray  # Of its weights, functions first, then terms.
    depends_on: tuple[str, ...]  # Its variable, then those that do nearly as well.
    evidence: float  # Gained [nats].


def fit_fields(task: Task, model: FitResult, found: Survey) -> list[FoundField]:
    """Adds each leading field of a survey to a model, one at a time."""
    return [fit_field(task, model, found, key) for key in found.leading]


def fit_field(
    task: Task, model: FitResult, found: Survey, key: tuple[str, str]
) -> FoundField:
    """Adds a field of a survey to a model and fits both in turn."""
    form, variable = key
    few = task.thinned(SURVEY_FLIGHTS)
    flights = linear_flights(few, model, slopes(task.layout, model.theta, model.free))
    bases = [
        basis
        for count in (COARSE, *FINER)
        if (basis := make_basis(few, model.theta, form, variable, count)) is not None
    ]
    basis = max(bases, key=lambda b: _gain(flights, few, model, b)[0])
    gained, weights, spread = 0.0, np.zeros(basis.count), np.zeros((0, 0))
    for round_ in range(_FIELD_ROUNDS):
        directions = slopes(task.layout, model.theta, model.free)
        flights = linear_flights(task, model, directions)
        if round_ == _FIELD_ROUNDS - 1:
            basis, weights = _with_needed_terms(flights, task, model, basis, weights)
            model = dataclasses.replace(model, extra=basis.data(weights))
            flights = linear_flights(task, model, directions)
        evidence, weights, spread = _gain(flights, task, model, basis, weights)
        if not np.all(np.isfinite(weights)):  # The model diverged: no field for it.
            model = dataclasses.replace(model, cost=np.inf)
            break
        gained = max(evidence, 0.0) if round_ == 0 else gained
        extra = basis.data(weights)
        model = fit_model(task, dataclasses.replace(model, extra=extra), iterations=2)
    return FoundField(
        model=model,
        basis=basis,
        covariance=spread,
        depends_on=found.nearly_as_good((form, variable)),
        evidence=gained,
    )


_FIELD_ROUNDS = 4
"""Rounds of fitting a field and the rest of the model in turn."""


def _with_needed_terms(
    flights: list[LinearFlight],
    task: Task,
    model: FitResult,
    basis: Basis,
    weights: np.ndarray,
) -> tuple[Basis, np.ndarray]:
    """Returns a field without the terms that only fit noise.

    Beside a vertical wind over x, a horizontal one would fit noise and be largest
    where the flights determine it least. A term stays if it has evidence beside others.
    """
    terms = basis.terms
    best = _gain(flights, task, model, basis, weights)[0]
    for term in basis.terms:
        fewer = tuple(name for name in terms if name != term)
        if not fewer:
            break
        gained = _gain(flights, task, model, basis, weights, fewer)[0]
        if gained > best:
            best, terms = gained, fewer
    bare = dataclasses.replace(basis, terms=terms)
    return bare, weights[basis.of_terms(terms)]
