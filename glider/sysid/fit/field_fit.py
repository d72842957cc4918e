"""A residual field fitted to flights: its basis placed, its weights solved for."""

import dataclasses
import itertools
from collections.abc import Callable, Sequence

import numpy as np

from glider.compiled.replay import advance_nodes, flow_at
from glider.physics.effects import (
    FIELD_TERMS,
    FIELD_VARIABLES,
    NO_FIELD,
    Field,
)
from glider.physics.effects.field import (
    AIR_TERMS,
    COEFFICIENTS,
    FieldData,
    gaussians,
    make_field,
)
from glider.sysid.likelihood.information import (
    covariance,
    held_out_costs,
    moved,
    solve,
)
from glider.sysid.fit.output_error import degrees_of_freedom, gather
from glider.sysid.replay.nodes import true_nodes
from glider.sysid.replay.problem import Problem
from glider.sysid.replay.record import Record
from glider.sysid.replay.residual import flow_variables
from glider.sysid.replay.signals import (
    node_signals,
    pose_signals,
)

FORMS = {"air": AIR_TERMS, "forces": COEFFICIENTS}
"""Forms that a field may have, and the terms of each."""

WEIGHT_SPREAD = 2.0
"""Spread of the weights before data: the ridge [m/s or -]."""

_STEP = 1e-4
"""Finite-difference step of a weight [m/s or -]."""


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
        dynamics = record.layout.dynamics(theta)
        nodes = true_nodes(record, theta)

        def ends(weights: np.ndarray) -> np.ndarray:
            return advance_nodes(
                record.layout.compiled_kinds,
                record.time,
                nodes,
                *signals,
                dynamics,
                constant._replace(weights=weights),
            )

        nominal = ends(constant.weights)
        responses = []
        for term in chosen:
            weights = constant.weights.copy()
            weights[-1, term] = _STEP
            responses.append((ends(weights) - nominal) / _STEP)
        values = flow_variables(record, theta)[:, used]
        values = 0.5 * (values[1:] + values[:-1])
        basis = gaussians(field, used, values)  # (n - 1, M)
        product = basis[:, None, :, None] * np.stack(responses, axis=2)[:, :, None, :]
        return product.reshape(*nominal.shape, -1)

    return forcing


@dataclasses.dataclass(frozen=True, kw_only=True)
class FieldFit:
    """A field with weights found.

    Attributes:
        data: the field.
        held_out_cost: sum of squared errors of flights left out of the fit.
        covariance: of the weights, basis functions first, then terms, with all
            else that the model holds taken as known.
    """

    data: FieldData
    held_out_cost: float
    covariance: np.ndarray


def fit_field(
    problem: Problem, theta: np.ndarray, data: FieldData, form: str, iterations: int
) -> FieldFit:
    """Fits a field's weights by Gauss-Newton, once or more."""
    base, terms = problem, FORMS[form]
    weights = np.zeros((len(data.centers), len(terms)))
    if data.weights:
        weights = np.array([data.weights[term] for term in terms]).T
    ridge = 1.0 / WEIGHT_SPREAD**2
    for _ in range(iterations):
        data = with_weights(data, form, weights)
        problem = dataclasses.replace(base, field=make_field(data))
        information = gather(
            problem, theta, (), forcing=forcing_of(theta, problem.field, terms)
        )
        step = solve(information.sum(axis=0), ridge)
        weights = weights + step.reshape(weights.shape)
    reached = moved(information, step)
    degrees = float(degrees_of_freedom(base).sum()) - len(step)
    dispersion = float(reached[:, -1, -1].sum()) / degrees
    return FieldFit(
        data=with_weights(data, form, weights),
        held_out_cost=float(held_out_costs(information, ridge).sum()),
        covariance=covariance(reached, dispersion, ridge),
    )
