"""The parts of a result: effects, corrected model, spreads.

Each function turns a fitted model into data of `glider.sysid.result`, with names and
units in place of slots of theta. Throughout, `task` has the flights to which `model`
was fitted, and `known` are the errors of its parameters.
"""

import dataclasses
import math
from collections.abc import Mapping

import numpy as np
from scipy.special import ndtri

from glider.campaign.turning import Signs
from glider.physics.confidence import LEVEL
from glider.physics.covariance import Covariance
from glider.physics.effects import ANGLE_SIGN, LIBRARY, POSE_LATENCY
from glider.physics.effects.families import FAMILIES
from glider.physics.effects.free_functions import FLOW_UNITS
from glider.physics.model import GliderModel
from glider.physics.parameter_space import OF_VEHICLE
from glider.sysid.constants import EVIDENCE_THRESHOLD, LEAST_SPREAD, Z
from glider.sysid.fit.folds import HeldOut
from glider.sysid.likelihood.filtering import PER_FLIGHT, flight_values
from glider.sysid.likelihood.fitted_functions import flown_values
from glider.sysid.likelihood.model_fit import error_flights
from glider.sysid.likelihood.scale_fit import fit_scales
from glider.sysid.likelihood.scales import NAMES
from glider.sysid.likelihood.task import FitResult, Task
from glider.sysid.likelihood.uncertainty import Uncertainty
from glider.sysid.replay.log_space import SERVO_LOG
from glider.sysid.result import (
    LIBRARY_SHAPE,
    OTHER_SHAPE,
    UNEXPLAINED,
    Estimate,
    FoundEffect,
    Spread,
)
from glider.sysid.search.tracing import SearchResult

SPREAD_KINDS = {kind.kind: kind.varies_by for kind in LIBRARY if kind.varies_by}
"""Kinds that vary from flight to flight, and the scale of their variation."""

BAND = float(ndtri(0.5 + 0.5 * LEVEL))  # Standard errors from the middle to an end.
_PER_KILOGRAM = {"m²": "m²/kg", "kg m²": "m²"}  # Units of a glider of 1 kg.


def spreads_of(task: Task, model: FitResult) -> dict[str, Spread]:
    """Flight-to-flight variations, by kind, with the value of each flight.

    One is reported where it reaches the threshold of an effect, all else refitted. The
    fitted scale is about zero: where the mean of the flights is clearly not zero, the
    variation is that of their values about it.
    """
    names = [record.name for record in task.records]
    flights = error_flights(task, model)
    # The model's scales may be priors, as in the search along the attitude.
    fitted, cost = fit_scales(flights, model.scales)
    values = flight_values(flights, fitted)
    found = {}
    for kind, scale in sorted(SPREAD_KINDS.items()):
        # The cost without this variation, all other scales refitted.
        others = [name for name in NAMES if name != scale]
        _, cost_without = fit_scales(flights, fitted.without(scale), others)

        of_kind = values[:, PER_FLIGHT[kind]]  # (flights, coefficients)
        std = getattr(fitted, scale)
        about_mean = of_kind.std(axis=0)
        error_of_mean = about_mean / math.sqrt(len(of_kind))
        if np.any(np.abs(of_kind.mean(axis=0)) > Z * error_of_mean):
            std = float(np.sqrt(np.mean(about_mean**2)))

        coefficient = task.space.kinds[kind].coefficients[0]
        least = LEAST_SPREAD * coefficient.scale
        is_large = least < min(std, getattr(model.scales, scale))
        if is_large and cost_without - cost > EVIDENCE_THRESHOLD:
            found[kind] = Spread(
                std=std,
                unit=coefficient.unit,
                values=dict(zip(names, of_kind[:, 0].tolist(), strict=True)),
            )

    return found


def effects_of(
    task: Task,
    traced: SearchResult,
    tests: HeldOut,
    known: Uncertainty,
    spreads: Mapping[str, Spread],
    signs: Signs,
) -> tuple[FoundEffect, ...]:
    """Effects with their coefficients and standard errors, by their evidence.

    Args:
        task: flights to which the model was fitted.
        traced: outcome of the search on them.
        tests: in how many folds each effect is found again.
        known: errors of the model's parameters.
        spreads: flight-to-flight variations, see `spreads_of`.
        signs: by which the logs were turned.
    """
    model = traced.model
    names = dict(traced.names)
    [latency] = task.space.slots_of(POSE_LATENCY.kind)
    if model.theta[latency] < 0.0:  # Clocks differ, see `verdict.find_doubt`.
        names.pop(POSE_LATENCY.kind, None)

    # Kinds of one name are one effect: a formula first, then what bends it.
    members = dict[str, list[str]]()
    for kind, name in names.items():
        entry = kind if name == UNEXPLAINED else name
        members.setdefault(entry, []).append(kind)

    found = []
    if not signs.are_right:
        found.append(_turned_angles(signs))

    evidence = traced.evidence
    whole = max(sum(evidence.values()), 1e-9)
    for kinds in members.values():
        first = kinds[0]
        if first in model.by_name:
            effect = _function_entry(task, model, first, names[first], known)
        else:
            effect = _formula_entry(task, model, first, known)

        brought = float(sum(evidence[kind] for kind in kinds))
        found.append(
            dataclasses.replace(
                effect,
                evidence=brought,
                share_of_residual=float(np.clip(brought / whole, 0.0, 1.0)),
                inclusion=tests.inclusion(first),
                indistinguishable_from=_rivals_of(task, traced, names, first),
            )
        )

    if found and not task.vehicle.per_flight_trims:
        for varying, spread in spreads.items():
            if varying not in model.kinds:
                found.append(_varying_effect(task, varying, spread))

    return tuple(sorted(found, key=lambda e: -np.nan_to_num(e.evidence, nan=-1.0)))


def _turned_angles(signs: Signs) -> FoundEffect:
    """Angles that were logged with the other sign, as an effect."""
    turned = signs.effect.to_dict()
    return FoundEffect(
        kind=ANGLE_SIGN.kind,
        words=ANGLE_SIGN.words,
        coefficients={name: Estimate(v, 0.0, "-") for name, v in turned.items()},
        evidence=signs.evidence,
        share_of_residual=signs.share,
        depends_on=ANGLE_SIGN.depends_on,
    )


def _varying_effect(task: Task, kind: str, spread: Spread) -> FoundEffect:
    """A flight-to-flight variation as an effect: the mean of its flights."""
    effect = task.space.kinds[kind]
    values = list(spread.values.values())
    std = spread.std / math.sqrt(len(values))
    mean = Estimate(float(np.mean(values)), std, spread.unit)
    return FoundEffect(
        kind=kind,
        words=f"{effect.words}, with another value in each flight",
        coefficients={effect.coefficients[0].name: mean},
        inclusion=math.nan,
        depends_on=effect.depends_on,
    )


def _formula_entry(
    task: Task, model: FitResult, name: str, known: Uncertainty
) -> FoundEffect:
    """A formula as an effect; its shape is wrong where a free function bends it.

    It has no name where the bands of all its sizes contain zero: they are not known to
    act in the sense that the formula has.
    """
    kind = task.space.kinds[name]
    slots = task.space.slots_of(name)
    coefficients = {}  # By their names.
    for slot, own in zip(slots, kind.coefficients, strict=True):
        coefficients[own.name] = _estimate(model, known, slot, own.unit)

    is_bent = any(name in FAMILIES[other].bends for other in model.free_kinds)
    sizes = [own for own in kind.coefficients if not own.is_shape]
    judged = [coefficients[own.name] for own in sizes or kind.coefficients]
    words = kind.words
    if all(abs(size.value) < BAND * size.std for size in judged):
        words = f"like {name} ({kind.words}), of a size that may be zero"
        name = UNEXPLAINED

    return FoundEffect(
        kind=name,
        words=words,
        coefficients=coefficients,
        shape=OTHER_SHAPE if is_bent else LIBRARY_SHAPE,
        depends_on=kind.depends_on,
    )


def _function_entry(
    task: Task, model: FitResult, name: str, kind: str, known: Uncertainty
) -> FoundEffect:
    """A free function as an effect: its link, its variables and where it is largest.

    `kind` is that by which it is reported: the formula that it is or bends, or
    "unexplained".
    """
    family = FAMILIES[name]
    words = family.words
    shape = OTHER_SHAPE
    if kind == UNEXPLAINED:
        words = f"no effect of the library: {words}"
        shape = LIBRARY_SHAPE

    return FoundEffect(
        kind=kind,
        words=words,
        coefficients=_find_peak(task, model, name, known),
        shape=shape,
        link=family.link,
        depends_on=family.depends_on,
    )


def _rivals_of(
    task: Task, traced: SearchResult, names: Mapping[str, str], own: str
) -> tuple[str, ...]:
    """Returns the formulas that would do as well in the place of an effect.

    To first order, or as fitted in a set without it, but with all other formulas, that
    is nearly as likely; where that has several others instead, they do as well
    together.

    Args:
        task: flights of the search.
        traced: its outcome.
        names: of the effects that are reported, see `SearchResult.names`.
        own: kind of the effect.
    """
    formulas = {*traced.model.kinds} - FAMILIES.keys()
    found = set[str]()
    if own not in FAMILIES:
        found.update(traced.alike.get(own, ()))
    for rival, _ in traced.rivals:
        its = {*rival.kinds}
        has_all_others = formulas - its <= {own}
        if has_all_others and its.isdisjoint((own, names[own])):
            found |= its - FAMILIES.keys() - formulas

    found.difference_update(names.values())
    return tuple(kind for kind in task.space.kinds if kind in found)


def _find_peak(
    task: Task, model: FitResult, name: str, known: Uncertainty
) -> dict[str, Estimate]:
    """The largest value of a free function's term along the flights, and where it is.

    The largest is that whose band is farthest from zero, if one excludes it: where few
    flights come the function is not known. The standard error of a peak's height is, to
    first order, that of the function at its place.
    """
    function = model.by_name[name]
    points = flown_values(task.records, model.theta)[:, function.columns]
    rows = function.gaussians(points) @ function.mix  # Slopes by coordinates, (n, q).
    values = rows @ function.coordinates
    covariance, _ = known.of(known.places[name])
    variances = np.sum(rows @ covariance * rows, axis=1)
    stds = np.sqrt(np.maximum(variances, 0.0))

    sizes = np.abs(values)
    beyond_band = np.nan_to_num(sizes - BAND * stds)
    if np.max(beyond_band) > 0.0:
        sizes = beyond_band
    peak = int(np.argmax(sizes))

    term = function.effect.kind
    [value] = function.effect.coefficients
    height = Estimate(float(values[peak]), float(stds[peak]), value.unit)
    found = {f"{term}_peak": height}
    for variable, place in zip(function.variables, points[peak], strict=True):
        at = Estimate(float(place), math.nan, FLOW_UNITS[variable])
        found[f"{term}_peak_at_{variable}"] = at

    return found


def model_of(task: Task, model: FitResult, signs: Signs) -> GliderModel:
    """The corrected glider.

    It has the effects of the model, and those that a vehicle may have whatever is
    found: they are fitted with its unknown parameters.
    """
    space = task.space
    parameters, fitted = space.unpack(model.theta, task.vehicle.parameters)
    by_kind = {effect.kind.kind: effect for effect in fitted}
    unknown = {space.owners[slot] for slot in task.vehicle.unknown}

    kinds = [*model.kinds]
    kinds += [k for k in space.kinds if k in unknown and k not in model.kinds]
    effects = [] if signs.are_right else [signs.effect]
    effects += [by_kind[kind] for kind in kinds if kind not in model.free_kinds]
    return GliderModel(
        parameters=parameters,
        effects=tuple(effects),
        free_functions=tuple(own.data for own in model.functions),
    )


def _estimate(model: FitResult, known: Uncertainty, slot: int, unit: str) -> Estimate:
    return Estimate(float(model.theta[slot]), known.std(slot), unit)


def vehicle_of(task: Task, model: FitResult, known: Uncertainty) -> dict[str, Estimate]:
    """The unknown parameters of the vehicle, by name.

    Without a mass, areas and inertia are per kilogram.
    """
    space = task.space
    found = {}
    for slot in task.vehicle.unknown:
        unit = space.entries[slot].unit
        if task.vehicle.is_per_mass and space.owners[slot] == OF_VEHICLE:
            unit = _PER_KILOGRAM.get(unit, unit)
        found[space.names[slot]] = _estimate(model, known, slot, unit)

    return found


def clocks_of(task: Task, model: FitResult, known: Uncertainty) -> dict[str, Estimate]:
    """Offsets of the log's clocks that were estimated, by name [ms]."""
    found = {}
    for slot in task.space.slots_of(SERVO_LOG.kind):
        if slot not in known.free:
            continue
        name = task.space.entries[slot].name
        seconds = _estimate(model, known, slot, "s")
        found[name] = Estimate(1e3 * seconds.value, 1e3 * seconds.std, "ms")

    return found


def covariance_of(task: Task, known: Uncertainty) -> Covariance | None:
    """Covariance of all fitted parameters of the corrected glider; None without any.

    Those are the effects' coefficients and the unknown parameters of the vehicle. Of
    flight-to-flight variation only the mean is included. A model that diverges on a
    flight has none.
    """
    matrix, freedom = known.covariance
    names = tuple(task.space.names[slot] for slot in known.named)
    if not names or not np.all(np.isfinite(matrix)):
        return None
    return Covariance(names=names, matrix=matrix, degrees_of_freedom=freedom)
