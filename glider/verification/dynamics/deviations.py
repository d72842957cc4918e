"""Gliders that deviate from a model by some of its numbers."""

import dataclasses
import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from glider.physics.compose import coefficient_slices
from glider.physics.model import GliderModel
from glider.physics.parameters import POSITIVE, Theta


def physical(
    model: GliderModel, names: tuple[str, ...], deviations: np.ndarray
) -> np.ndarray:
    """Returns deviations (..., m), drawn back to where all numbers are physical.

    A mass below zero, or a coefficient beyond its bounds, is none: such a deviation is
    shortened until there is no such number. In a convex set about the estimate it
    stays.
    """
    estimates, lower, upper = np.array([_number(model, name) for name in names]).T
    room = np.where(deviations > 0.0, upper - estimates, lower - estimates)
    share = np.divide(
        room, deviations, out=np.ones_like(deviations), where=deviations != 0.0
    )
    share = share.min(axis=-1, keepdims=True, initial=1.0)
    return deviations * np.where(share < 1.0, share * (1.0 - _INSIDE), 1.0)


def theta_at(
    model: GliderModel, names: tuple[str, ...], deviations: Iterable[Any]
) -> Theta:
    """Returns the numbers of gliders that deviate from a model.

    Args:
        model: the estimate.
        names: of the m numbers.
        deviations: m numbers or arrays of any kind; the coefficients that do not
            deviate stay floats.
    """
    theta = model.numbers
    p, c = theta.p, list(theta.c)
    for name, deviation in zip(names, deviations, strict=True):
        kind, _, coefficient = name.partition(".")
        if coefficient:
            place = _place(model, kind, coefficient)
            c[place] = c[place] + deviation
        else:
            p = p._replace(**{kind: getattr(p, kind) + deviation})
    return Theta(p=p, c=c, field=theta.field)  # type: ignore[arg-type]


def glider_at(
    model: GliderModel, names: tuple[str, ...], deviation: np.ndarray
) -> GliderModel:
    """Returns a glider that deviates from a model, (m,).

    Raises:
        InputError: it is not physical.
    """
    parameters, effects = model.parameters, list(model.effects)
    for name, change in zip(names, map(float, deviation), strict=True):
        kind, _, coefficient = name.partition(".")
        if coefficient:
            at = [e.kind.kind for e in effects].index(kind)
            values = effects[at].to_dict()
            values[coefficient] += change
            effects[at] = effects[at].kind(**values)
        else:
            value = getattr(parameters, kind) + change
            parameters = dataclasses.replace(parameters, **{kind: value})
    return dataclasses.replace(model, parameters=parameters, effects=tuple(effects))


def _place(model, kind, coefficient):
    """Returns where a coefficient is in the vector c of a model."""
    (of_kind,) = (k for k in model.kinds if k.kind == kind)
    names = [c.name for c in of_kind.coefficients]
    return coefficient_slices(model.kinds)[kind].start + names.index(coefficient)


def _number(model, name):
    """Returns a number of a model and its physical bounds."""
    kind, _, coefficient = name.partition(".")
    if not coefficient:
        least = _LEAST if kind in POSITIVE else -math.inf
        return getattr(model.parameters, kind), least, math.inf
    (of_kind,) = (k for k in model.kinds if k.kind == kind)
    (bounds,) = (c for c in of_kind.coefficients if c.name == coefficient)
    value = model.numbers.c[_place(model, kind, coefficient)]
    return value, bounds.lower, bounds.upper


_LEAST = 1e-9
"""Least mass, area and so on of a glider."""

_INSIDE = 1e-9
"""Share by which a number stays within its bounds, for rounding."""
