"""None of these: a residual that no effect of the library explains.

What is left is carried as a field of Gaussian basis functions over the
variable that it depends on, either as a motion of the air or as C_L, C_D
and C_M; held-out flights choose the variables and the form. The field makes the
error fall and tells where to look, but it is not a name.
"""

import dataclasses
import itertools
from collections.abc import Callable, Sequence

import numpy as np

from glider.effects import FIELD_TERMS, FIELD_VARIABLES, NO_FIELD, Field
from glider.effects.field import FieldData, make_field
from glider.sysid.replay import (
    NUM_KERNEL_THETA,
    Record,
    kernel,
    node_signals,
    pose_signals,
    true_nodes,
)
from glider.sysid.result import Estimate
from glider.sysid.rollout_fit import (
    Problem,
    degrees_of_freedom,
    gather,
    held_out_costs,
    solve,
)
from glider.sysid.whiteness import LackOfFit, lack_of_fit

FORMS = {"air": ("wind_x", "wind_z"), "forces": ("c_lift", "c_drag", "c_moment")}
"""What a field may be: terms that it has."""

WEIGHT_SPREAD = 2.0
"""Spread of the weights before data: the ridge [m/s or -]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class UnexplainedField:
    """A residual field found in flights.

    Attributes:
        form: a key of FORMS.
        variables: what it depends on.
        data: the field as a model file has it.
        held_out_cost: sum of squared errors of flights left out of the fit.
        expected_cost: the same of pure noise.
        lack: what it leaves.
        tried: held-out cost of each (form, variable) tried.
        survey_noise: cost that pure noise would leave there.
        coefficients: the peak of each term and where it lies.
    """

    form: str
    variables: tuple[str, ...]
    data: FieldData
    held_out_cost: float
    expected_cost: float
    lack: LackOfFit
    coefficients: dict[str, Estimate]
    tried: dict[tuple[str, str], float]
    survey_noise: float

    @property
    def dispersion(self) -> float:
        """Mean squared error over noise variance, on flights left out."""
        return self.held_out_cost / self.expected_cost

    @property
    def words(self) -> str:
        """A short phrase for people."""
        what = {"air": "the air moves", "forces": "forces change"}[self.form]
        return f"no effect of the library: {what} with {', '.join(self.depends_on)}"

    @property
    def depends_on(self) -> tuple[str, ...]:
        """The variable of the field, then those that do nearly as well."""
        best = self.tried[self.form, self.variables[0]] - self.survey_noise
        close = {
            name: error
            for (_, name), error in sorted(self.tried.items(), key=lambda e: -e[1])
            if error - self.survey_noise < _NEARLY * max(best, 0.05 * self.survey_noise)
        }
        others = sorted(set(close) - set(self.variables), key=lambda name: close[name])
        return (*self.variables, *others)

    @property
    def field(self) -> Field:
        """The arrays that the dynamics take."""
        return make_field(self.data)


def flow_variables(record: Record, theta: np.ndarray) -> np.ndarray:
    """Returns FIELD_VARIABLES along a flight, (n, 9), at its smoothed states."""
    elevator, rate = node_signals(record, theta)
    nodes = true_nodes(record, theta)
    values = np.empty((len(record.time), 9))
    kernel().log_flow(
        record.time,
        nodes,
        elevator,
        rate,
        theta[:NUM_KERNEL_THETA],
        NO_FIELD,
        values,
    )
    alpha = np.arctan2(values[:, 1], values[:, 2])
    columns = {
        "x": nodes[:, 0],
        "z": nodes[:, 1],
        "t": record.time,
        "pitch": nodes[:, 2],
        "V": values[:, 0],
        "alpha": alpha,
        "pitchdot": nodes[:, 6],
        "elevator": values[:, 8],
        "elevator_rate": rate,
    }
    return np.stack([columns[name] for name in FIELD_VARIABLES], axis=1)


def place_basis(
    records: Sequence[Record],
    theta: np.ndarray,
    variables: tuple[str, ...],
    count: int,
) -> FieldData:
    """Spreads Gaussians evenly over what the flights covered, weights zero."""
    columns = [FIELD_VARIABLES.index(name) for name in variables]
    flown = np.concatenate([flow_variables(r, theta)[:, columns] for r in records])
    low, high = np.percentile(flown, [0.5, 99.5], axis=0)
    axes = [np.linspace(a, b, count) for a, b in zip(low, high, strict=True)]
    widths = [float(axis[1] - axis[0]) for axis in axes]
    centers = np.array(list(itertools.product(*axes)))
    if len(variables) > 1:  # Keep only where somebody flew.
        scaled = (flown[:, None, :] - centers[None]) / np.array(widths)
        near = np.min(np.sum(scaled**2, axis=2), axis=0) < 1.0
        centers = centers[near]
    return FieldData(
        kind="unexplained",
        variables=list(variables),
        centers=centers.tolist(),
        widths=widths,
    )


def with_weights(data: FieldData, form: str, weights: np.ndarray) -> FieldData:
    """Returns the field with weights (M, terms of the form)."""
    terms = dict(zip(FORMS[form], weights.T.tolist(), strict=True))
    return dataclasses.replace(data, weights=terms)


def forcing_of(
    theta: np.ndarray, field: Field, terms: tuple[str, ...]
) -> Callable[[Record], np.ndarray]:
    """Returns how each weight of a field moves the end of each interval.

    A weight acts like a constant air velocity or coefficient times the value of
    its basis function at the middle of the interval. The columns run over the
    basis functions first, then over the terms.
    """
    chosen = [FIELD_TERMS.index(name) for name in terms]
    used = np.flatnonzero(np.any(field.inverse_widths != 0.0, axis=0))
    row = np.zeros((1, len(FIELD_VARIABLES)))
    constant = Field(
        np.vstack([field.centers, row]),
        np.vstack([field.inverse_widths, row]),
        np.vstack([field.weights, np.zeros((1, len(FIELD_TERMS)))]),
    )

    def forcing(record: Record) -> np.ndarray:
        signals = pose_signals(record, theta)
        dynamics = theta[:NUM_KERNEL_THETA]
        nodes = true_nodes(record, theta)

        def ends(weights: np.ndarray) -> np.ndarray:
            reached = np.empty_like(nodes[1:])
            kernel().log_advance(
                record.time,
                nodes,
                *signals,
                dynamics,
                constant._replace(weights=weights),
                reached,
            )
            return reached

        nominal = ends(constant.weights)
        responses = []
        for term in chosen:
            weights = constant.weights.copy()
            weights[-1, term] = _STEP
            responses.append((ends(weights) - nominal) / _STEP)
        values = flow_variables(record, theta)[:, used]
        values = 0.5 * (values[1:] + values[:-1])
        scaled = values[:, None, :] - field.centers[None][:, :, used]
        scaled = scaled * field.inverse_widths[None][:, :, used]
        basis = np.exp(-0.5 * np.sum(scaled**2, axis=2))  # (n - 1, M)
        product = basis[:, None, :, None] * np.stack(responses, axis=2)[:, :, None, :]
        return product.reshape(*nominal.shape, -1)

    return forcing


_STANDS_STILL = 1e-6
"""Range of a variable below which nothing can be said to depend on it."""

_STEP = 1e-4
"""Finite-difference step of a weight [m/s or -]."""


def fit_field(
    problem: Problem, theta: np.ndarray, data: FieldData, form: str, iterations: int
) -> tuple[FieldData, float, Problem]:
    """Fits a field's weights by Gauss-Newton.

    Returns:
        the field, its cost on flights left out, the problem with the field in it.
    """
    base, terms = problem, FORMS[form]
    weights = np.zeros((len(data.centers), len(terms)))
    if data.weights:
        weights = np.array([data.weights[term] for term in terms]).T
    ridge = 1.0 / WEIGHT_SPREAD**2
    held_out = np.inf
    for _ in range(iterations):
        data = with_weights(data, form, weights)
        problem = dataclasses.replace(base, field=make_field(data))
        information = gather(
            problem, theta, (), forcing=forcing_of(theta, problem.field, terms)
        )
        step = solve(information.sum(axis=0), ridge).reshape(weights.shape)
        held_out = float(held_out_costs(information, ridge).sum())
        weights = weights + step
    data = with_weights(data, form, weights)
    return data, held_out, dataclasses.replace(base, field=make_field(data))


def survey(problem: Problem, theta: np.ndarray) -> dict[tuple[str, str], float]:
    """Returns the held-out cost of a field of each form over each variable.

    All terms are flown at once; each form then uses its own columns.
    """
    tried = {}
    for name in FIELD_VARIABLES:
        data = place_basis(problem.records, theta, (name,), _COARSE)
        if min(data.widths) < _STANDS_STILL:
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
        held_out = fit_field(thinned, theta, data, form, 1)[1]
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
    data, held_out, with_field = fit_field(problem, theta, data, form, 3)
    return UnexplainedField(
        form=form,
        variables=tuple(data.variables),
        data=data,
        held_out_cost=held_out,
        expected_cost=float(degrees_of_freedom(problem).sum()),
        lack=lack_of_fit(with_field, theta),
        tried=tried,
        survey_noise=float(degrees_of_freedom(thinned).sum()),
        coefficients=_peaks(data),
    )


def _peaks(data: FieldData) -> dict[str, Estimate]:
    """Returns the largest value of each term of a field over one variable."""
    variable = data.variables[0]
    centers = np.array(data.centers)[:, 0]
    grid = np.linspace(centers.min(), centers.max(), 401)
    basis = np.exp(-0.5 * ((grid[:, None] - centers) / data.widths[0]) ** 2)
    found = {}
    for term, weights in data.weights.items():
        curve = basis @ np.array(weights)
        peak = int(np.argmax(np.abs(curve)))
        unit = "m/s" if term.startswith("wind") else ("m" if "moment" in term else "-")
        found[f"{term}_peak"] = Estimate(value=float(curve[peak]), std=0.0, unit=unit)
        found[f"{term}_peak_at_{variable}"] = Estimate(
            value=float(grid[peak]), std=0.0, unit=_UNITS[variable]
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

_NEARLY = 1.5
"""Ratio of what is left below which another variable does nearly as well."""

SURVEY_FLIGHTS = 12
"""Flights to survey the variables with; the field is fitted to all."""

_COARSE = 12
_FINER = (18, 27, 40)
