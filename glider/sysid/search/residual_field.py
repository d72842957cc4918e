"""A residual that no effect of the library explains, as a field without a name.

What is left is carried as a field of Gaussian basis functions over the
variable that it depends on, either as a motion of the air or as C_L, C_D
and C_M; held-out flights choose the variables and the form. The field makes the
error fall and tells where to look, but it is not a name.
"""

import dataclasses
import math
from collections.abc import Callable

import numpy as np

from glider.physics.effects import (
    FIELD_TERMS,
    FIELD_VARIABLES,
    Field,
)
from glider.physics.effects.field import (
    FieldData,
    make_field,
)
from glider.sysid.fit.field_fit import (
    FORMS,
    WEIGHT_SPREAD,
    FieldFit,
    fit_field,
    forcing_of,
    place_basis,
)
from glider.sysid.likelihood.information import held_out_costs
from glider.sysid.fit.output_error import degrees_of_freedom, gather
from glider.sysid.fit.whiteness import (
    LackOfFit,
    lack_of_fit,
)
from glider.sysid.replay.problem import Problem
from glider.sysid.result import Estimate

SURVEY_FLIGHTS = 12
"""Flights to survey the variables with; the field is fitted to all."""

_COARSE = 12
"""Number of basis functions in the survey."""

_FINER = (18, 27, 40)
"""Numbers of basis functions that are tried afterwards."""

_REFINEMENT = 1.5
"""Ratio of one number of basis functions to the one before."""

_LEFT_RATIO = 1.5
"""Ratio of what is left below which another variable does nearly as well."""

_LEAST_RANGE = 1e-6
"""Range of a variable below which nothing can be said to depend on it."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class UnexplainedField:
    """A residual field found in flights.

    Attributes:
        form: a key of FORMS.
        variables: what it depends on.
        data: the field as a model file has it.
        held_out_cost: sum of squared errors of flights left out of the fit.
        expected_cost: the same of pure noise.
        lack_of_fit: what it leaves.
        tried: held-out cost of each (form, variable) tried.
        survey_noise: cost that pure noise would leave there.
        coefficients: the peak of each term and where it lies.
    """

    form: str
    variables: tuple[str, ...]
    data: FieldData
    held_out_cost: float
    expected_cost: float
    lack_of_fit: LackOfFit
    coefficients: dict[str, Estimate]
    tried: dict[tuple[str, str], float]
    survey_noise: float

    @property
    def dispersion(self) -> float:
        """Mean squared error over noise variance, on flights left out."""
        return self.held_out_cost / self.expected_cost

    @property
    def left(self) -> float:
        """Bound of what is left, no less than the noise of that figure."""
        return self.lack_of_fit.bound

    @property
    def words(self) -> str:
        """Phrase for people, a short one."""
        what = {"air": "the air moves", "forces": "forces change"}[self.form]
        return f"no effect of the library: {what} with {', '.join(self.depends_on)}"

    @property
    def depends_on(self) -> tuple[str, ...]:
        """The variable of the field, then those that do nearly as well."""
        best = self.tried[self.form, self.variables[0]] - self.survey_noise
        close = {
            name: error
            for (_, name), error in sorted(self.tried.items(), key=lambda e: -e[1])
            if error - self.survey_noise
            < _LEFT_RATIO * max(best, 0.05 * self.survey_noise)
        }
        others = sorted(set(close) - set(self.variables), key=lambda name: close[name])
        return (*self.variables, *others)

    @property
    def field(self) -> Field:
        """The arrays that the dynamics take."""
        return make_field(self.data)


def survey(problem: Problem, theta: np.ndarray) -> dict[tuple[str, str], float]:
    """Returns the held-out cost of a field of each form over each variable.

    All terms are flown at once; each form then uses its own columns.
    """
    tried = {}
    for name in FIELD_VARIABLES:
        data = place_basis(problem.records, theta, (name,), _COARSE)
        if min(data.widths) < _LEAST_RANGE:
            continue
        information = gather(
            problem, theta, (), forcing=forcing_of(theta, make_field(data), FIELD_TERMS)
        )
        for form, terms in FORMS.items():
            mine = [FIELD_TERMS.index(term) for term in terms]
            columns = np.arange(_COARSE)[:, None] * len(FIELD_TERMS) + mine
            keep = np.append(columns.ravel(), information.shape[1] - 1)
            own = information[:, keep[:, None], keep]
            tried[form, name] = float(held_out_costs(own, 1.0 / WEIGHT_SPREAD**2).sum())
    return tried


def find_field(
    problem: Problem,
    theta: np.ndarray,
    progress: Callable[[str], None] = lambda text: None,
) -> UnexplainedField:
    """Finds the variable and the form that explain unseen flights best."""
    progress("looking for what the residual depends on")
    thinned = problem.thinned(SURVEY_FLIGHTS)
    tried = survey(thinned, theta)
    form, variable = min(tried, key=lambda key: tried[key])
    count, best = _COARSE, tried[form, variable]
    for finer in _FINER:
        data = place_basis(thinned.records, theta, (variable,), finer)
        held_out = fit_field(thinned, theta, data, form, 1).held_out_cost
        if held_out < best:
            count, best = finer, held_out
    progress(f"fitting a field over {variable}")
    data = place_basis(problem.records, theta, (variable,), count)
    return _fitted(problem, theta, data, form, tried, thinned)


def refit_field(
    problem: Problem, theta: np.ndarray, found: UnexplainedField
) -> UnexplainedField:
    """Returns a field of the same basis, fitted anew about another model."""
    thinned = problem.thinned(SURVEY_FLIGHTS)
    return _fitted(problem, theta, found.data, found.form, found.tried, thinned)


def _fitted(
    problem: Problem,
    theta: np.ndarray,
    data: FieldData,
    form: str,
    tried: dict[tuple[str, str], float],
    thinned: Problem,
) -> UnexplainedField:
    found = fit_field(problem, theta, data, form, 3)
    with_field = dataclasses.replace(problem, field=make_field(found.data))
    return UnexplainedField(
        form=form,
        variables=tuple(data.variables),
        data=found.data,
        held_out_cost=found.held_out_cost,
        expected_cost=float(degrees_of_freedom(problem).sum()),
        lack_of_fit=lack_of_fit(with_field, theta),
        tried=tried,
        survey_noise=float(degrees_of_freedom(thinned).sum()),
        coefficients=find_peaks(found),
    )


def with_form_errors(
    problem: Problem, theta: np.ndarray, found: UnexplainedField
) -> UnexplainedField:
    """Returns the field with standard errors that own up to its basis too.

    Where a peak lies also hangs on the Gaussians that the field is made of: by how
    much it moves with a finer basis counts as one more standard error.
    """
    count = round(_REFINEMENT * len(found.data.centers))
    data = place_basis(problem.records, theta, found.variables, count)
    finer = find_peaks(fit_field(problem, theta, data, found.form, 2))
    coefficients = {
        name: dataclasses.replace(c, std=math.hypot(c.std, finer[name].value - c.value))
        for name, c in found.coefficients.items()
    }
    return dataclasses.replace(found, coefficients=coefficients)


def find_peaks(fitted: FieldFit) -> dict[str, Estimate]:
    """Returns the largest value of each term of a field over one variable.

    Standard errors follow from the weights' covariance C. With the field
    f = b(ξ)·w, to first order a peak's height moves with δw as b·δw, its place
    as -b'·δw / f'': their variances are b'C b and b''C b' / f''². A peak at the
    edge of what was flown is none of the field's, so its place has no error (NaN).
    """
    data = fitted.data
    variable = data.variables[0]
    centers, width = np.array(data.centers)[:, 0], data.widths[0]
    grid = np.linspace(centers.min(), centers.max(), 401)
    found = {}
    for k, (term, values) in enumerate(data.weights.items()):
        weights = np.array(values)
        of_term = slice(k, None, len(data.weights))
        covariance = fitted.covariance[of_term, of_term]
        scaled = (grid[:, None] - centers) / width
        basis = np.exp(-0.5 * scaled**2)
        peak = int(np.argmax(np.abs(basis @ weights)))
        height, place = basis[peak], grid[peak]
        slope = -scaled[peak] / width * height
        curvature = (scaled[peak] ** 2 - 1.0) / width**2 * height @ weights
        is_inside = 0 < peak < len(grid) - 1
        unit = "m/s" if term.startswith("wind") else ("m" if "moment" in term else "-")
        found[f"{term}_peak"] = Estimate(
            value=float(height @ weights),
            std=float(np.sqrt(height @ covariance @ height)),
            unit=unit,
        )
        found[f"{term}_peak_at_{variable}"] = Estimate(
            value=float(place),
            std=float(np.sqrt(slope @ covariance @ slope) / abs(curvature))
            if is_inside and curvature != 0.0
            else math.nan,
            unit=_UNITS[variable],
        )
    return found


_UNITS = {
    "x": "m",
    "z": "m",
    "t": "s",
    "pitch": "rad",
    "V": "m/s",
    "alpha": "rad",
    "pitchdot": "rad/s",
    "elevator": "rad",
    "elevator_rate": "rad/s",
}
