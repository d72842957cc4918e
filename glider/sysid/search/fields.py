"""Residual fields over a variable, of no formula of the library.

A field is a sum of Gaussians over one of FIELD_VARIABLES, as a motion of the air or as
changes of C_L, C_D and C_M. It reduces the error and shows where to look.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np

from glider.compiled.parallel import in_parallel
from glider.physics.effects import FIELD_VARIABLES
from glider.physics.effects.field import AIR_TERMS, COEFFICIENTS
from glider.sysid.likelihood.curves import Gaussians, flown_values
from glider.sysid.likelihood.information import Evidence, counted_from, eliminate
from glider.sysid.likelihood.linear_flight import LinearFlight
from glider.sysid.likelihood.model_fit import (
    FitResult,
    fit_model,
    grams_of,
    linear_flights,
    prior_of,
)
from glider.sysid.likelihood.task import Task

FORMS = {"air": AIR_TERMS, "forces": COEFFICIENTS}  # Of a field, with their terms.
SPREADS = {"air": (0.5, 0.5), "forces": (0.2, 0.2, 0.01)}  # Of weights [m/s; -, -, m].
SURVEYED = (
    *(("air", name) for name in ("x", "z", "t")),
    *(("forces", name) for name in FIELD_VARIABLES if name != "pitch"),
)
COARSE = 12  # Gaussians in the survey.
FINER = (18, 27, 40)  # Numbers of them that are tried afterwards.
SURVEY_FLIGHTS = 12  # Flights of the survey; the field is fitted to all.
MOST_LEADING = 3  # Fields of a survey that are fitted at most.
LEADING = 0.8  # Share of the best field's evidence above which another is fitted.
_LEAST_RANGE = 1e-6  # Range below which a residual cannot depend on a variable.
_FIELD_ROUNDS = 4  # Of fitting a field and the rest of the model in turn.


@dataclasses.dataclass(frozen=True, kw_only=True)
class Basis(Gaussians):
    """Gaussians over one variable, for terms of one form."""

    form: str  #: Of FORMS.

    @property
    def spreads(self) -> np.ndarray:
        """Prior spread of the weights, functions first, then terms."""
        of_form = dict(zip(FORMS[self.form], SPREADS[self.form], strict=True))
        return np.tile([of_form[name] for name in self.terms], len(self.centers))

    def of_terms(self, terms: Sequence[str]) -> np.ndarray:
        """Indices of the weights of some terms."""
        return np.flatnonzero(np.isin(self.terms * len(self.centers), terms))


def make_basis(
    task: Task, theta: np.ndarray, form: str, variable: str, count: int
) -> Basis | None:
    """Spreads Gaussians over the flown range; None where that is a point."""
    flown = flown_values(task.records, theta, variable)
    low, high = np.percentile(flown, [0.5, 99.5])
    if high - low < _LEAST_RANGE:
        return None
    centers = np.linspace(low, high, count)
    return Basis(form=form, variable=variable, terms=FORMS[form], centers=centers)


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
    spreads, acting = basis.spreads, basis.of_terms(terms or basis.terms)
    count, units = len(acting), np.eye(len(spreads))
    wide = in_parallel(lambda f: basis.added_to(f, model.theta, units), flights)
    gram = grams_of(wide, model.scales).sum(axis=0)
    if not np.all(np.isfinite(gram)):
        return -np.inf, np.full(count, np.nan), np.full((count, count), np.nan)
    prior = prior_of(task, model)
    m = len(prior.mean)
    if now is not None:
        gram = counted_from(gram, np.append(np.zeros(m), now))
    keep = np.concatenate([np.arange(m), m + acting, [len(gram) - 1]])
    gram = eliminate(gram[np.ix_(keep, keep)], range(m), prior.precision, prior.mean)
    precision, bound = spreads[acting] ** -2, np.full(count, np.inf)
    evidence = Evidence(gram=gram, precision=precision, lower=-bound, upper=bound)
    covariance = np.linalg.inv(gram[:-1, :-1] + np.diag(precision))
    gained = evidence.log_marginal(range(count))
    return gained, covariance @ gram[:-1, -1], covariance


def survey(task: Task, model: FitResult) -> Survey:
    """Computes the evidence of a field over each variable, on top of a model."""
    few = task.thinned(SURVEY_FLIGHTS)
    flights = linear_flights(few, model)
    gains = {}
    for form, variable in SURVEYED:
        basis = make_basis(few, model.theta, form, variable, COARSE)
        if basis is not None:
            gains[form, variable] = _gain(flights, few, model, basis)[0]
    return Survey(gains=gains)


@dataclasses.dataclass(frozen=True, kw_only=True)
class FoundField:
    """A field in a model."""

    model: FitResult  #: With the field.
    basis: Basis  #: Of it.
    covariance: np.ndarray  #: Of its weights, functions first, then terms.
    depends_on: tuple[str, ...]  #: Its variable, then those that do nearly as well.
    evidence: float = np.nan  #: Gained over a model without it [nats].


def fit_fields(task: Task, model: FitResult, found: Survey) -> list[FoundField]:
    """Adds each leading field of a survey to a model, one at a time."""
    return [fit_field(task, model, found, key) for key in found.leading]


def fit_field(
    task: Task, model: FitResult, found: Survey, key: tuple[str, str]
) -> FoundField:
    """Adds a field of a survey to a model and fits both in turn."""
    few = task.thinned(SURVEY_FLIGHTS)
    flights = linear_flights(few, model)
    bases = (make_basis(few, model.theta, *key, count) for count in (COARSE, *FINER))
    basis = max(
        (b for b in bases if b is not None),
        key=lambda b: _gain(flights, few, model, b)[0],
    )
    weights, spread = np.zeros(len(basis.spreads)), np.zeros((0, 0))
    for round_ in range(_FIELD_ROUNDS):
        flights = linear_flights(task, model)
        if round_ == _FIELD_ROUNDS - 1:
            basis, weights = _with_needed_terms(flights, task, model, basis, weights)
            model = dataclasses.replace(model, extra=basis.field_data(weights))
            flights = linear_flights(task, model)
        _, weights, spread = _gain(flights, task, model, basis, weights)
        if not np.all(np.isfinite(weights)):  # The model diverged: no field for it.
            model = dataclasses.replace(model, cost=np.inf)
            break
        extra = basis.field_data(weights)
        model = fit_model(task, dataclasses.replace(model, extra=extra), iterations=2)
    depends_on = found.nearly_as_good(key)
    return FoundField(
        model=model, basis=basis, covariance=spread, depends_on=depends_on
    )


def _with_needed_terms(
    flights: list[LinearFlight],
    task: Task,
    model: FitResult,
    basis: Basis,
    weights: np.ndarray,
) -> tuple[Basis, np.ndarray]:
    """Returns a field without a term that only fits noise.

    Beside a vertical wind over x, a horizontal one would be largest where the flights
    determine it least.
    """
    options = [basis.terms]
    options += [tuple(t for t in basis.terms if t != name) for name in basis.terms]
    terms = max(
        options, key=lambda own: _gain(flights, task, model, basis, weights, own)[0]
    )
    bare = dataclasses.replace(basis, terms=terms)
    return bare, weights[basis.of_terms(terms)]
