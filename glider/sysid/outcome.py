"""The parts of a result: effects, corrected model, curves, spreads."""

import math
from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from glider.campaign.turning import Signs
from glider.physics.covariance import Covariance
from glider.physics.effects import ANGLE_SIGN, CAMBER, LIBRARY, POSE_LATENCY
from glider.physics.effects.families import FAMILIES
from glider.physics.effects.free_functions import COEFFICIENTS, FLOW_UNITS
from glider.physics.model import GliderModel
from glider.physics.parameter_space import OF_VEHICLE
from glider.sysid import report
from glider.sysid.constants import EVIDENCE_THRESHOLD, LEAST_SPREAD, Z
from glider.sysid.likelihood.filtering import PER_FLIGHT, flight_values
from glider.sysid.likelihood.fitted_functions import FittedFunction
from glider.sysid.likelihood.model_fit import error_flights
from glider.sysid.likelihood.scale_fit import fit_scales
from glider.sysid.likelihood.scales import NAMES
from glider.sysid.likelihood.task import FitResult, Task
from glider.sysid.likelihood.uncertainty import Uncertainty
from glider.sysid.naming import LIFT, absorbed, names_of, names_of_lift, standing_alone
from glider.sysid.replay.log_space import SERVO_LOG
from glider.sysid.report import Estimate, Spread
from glider.sysid.result import FoundEffect, ResidualTable
from glider.sysid.search.support import SearchResult

SPREAD_KINDS = {kind.kind: kind.varies_by for kind in LIBRARY if kind.varies_by}
"""Kinds that vary from flight to flight, and the scale of their variation."""

_BINS = 15  # Of the curves over the angle of attack, with equally many rows.


def spreads_of(task: Task, model: FitResult) -> dict[str, Spread]:
    """Flight-to-flight variations, by kind, with the value of each flight.

    One is reported where it reaches the threshold of an effect, all else refitted. The
    fitted scale is about zero: where the mean of the flights is clearly not zero, the
    variation is that of their values about it.
    """
    flights = error_flights(task, model)
    # Those of the model may be priors, as in the search along the attitude.
    fitted, base, _ = fit_scales(flights, model.scales)
    values = flight_values(flights, fitted)
    names = [record.name for record in task.records]
    found = {}
    for kind, scale in sorted(SPREAD_KINDS.items()):
        coefficient = task.space.kinds[kind].coefficients[0]
        others = [name for name in NAMES if name != scale]
        lost = fit_scales(flights, fitted.without(scale), others).cost - base
        varying = values[:, PER_FLIGHT[kind]]
        mean, stds = (f(varying, axis=0) for f in (np.mean, np.std))
        std = getattr(fitted, scale)
        if np.any(np.abs(mean) > Z * stds / math.sqrt(len(values))):
            std = float(np.sqrt(np.mean(stds**2)))
        size = LEAST_SPREAD * coefficient.scale
        if lost > EVIDENCE_THRESHOLD and size < min(std, getattr(model.scales, scale)):
            own = varying[:, 0].tolist()
            found[kind] = Spread(
                std=std,
                std_error=std / math.sqrt(2.0 * len(own)),
                unit=coefficient.unit,
                values=dict(zip(names, own, strict=True)),
            )
    return found


def effects_of(
    task: Task,
    traced: SearchResult,
    known: Uncertainty,
    spreads: Mapping[str, Spread],
    signs: Signs,
) -> tuple[FoundEffect, ...]:
    """Effects with their coefficients and standard errors, by their evidence."""
    model = traced.model
    gained = max(sum(traced.evidence.values()), 1e-9)
    bent = {k for name in model.free_kinds for k in FAMILIES[name].bends}
    unnamed = absorbed(task, traced, known)
    bent = bent.union(*unnamed.values())
    nearest = dict.fromkeys(model.free_kinds, "unexplained") | traced.families
    families = {
        name: names_of(task, model, known, name, nearest[name])
        for name in standing_alone(traced.evidence, model.free_kinds, unnamed) - {LIFT}
    }
    if LIFT in model.free_kinds and LIFT not in unnamed:
        families[LIFT] = names_of_lift(task, model, known)
        others = {*FAMILIES[LIFT].formulas}.intersection(model.kinds) - families[LIFT]
        unnamed |= {kind: {LIFT} for kind in others}
    named: set[str] = {*model.kinds} - unnamed.keys() - {*model.free_kinds}
    for name in sorted(families, key=lambda k: -traced.evidence[k]):
        families[name] -= named - {"unexplained"}
        named |= families[name]
    found = [] if signs.are_right else [_sign_entry(signs)]
    for name in model.kinds:
        evidence = float(traced.evidence.get(name, 0.0))
        of_search: dict[str, Any] = {
            "evidence": evidence,
            "share_of_residual": float(np.clip(evidence / gained, 0.0, 1.0)),
            "inclusion": traced.weighed[name].inclusion,
            "found_by": traced.found_by.get(name, ""),
        }
        if name in unnamed:
            continue
        if name in model.free_kinds:
            found += (
                _function_entry(task, traced, named, known, name, family, of_search)
                for family in sorted(families.get(name, ()))
            )
            continue
        kind = task.space.kinds[name]
        slots = task.space.slots_of(name)
        if name == POSE_LATENCY.kind and model.theta[slots[0]] < 0.0:
            continue  # Not physical: the clocks differ, see `verdict.find_doubt`.
        found.append(
            FoundEffect(
                kind=name,
                words=kind.words,
                coefficients={
                    c.name: Estimate(float(model.theta[i]), known.std(i), c.unit)
                    for i, c in zip(slots, kind.coefficients, strict=True)
                },
                spread_over_flights={kind.coefficients[0].name: spreads[name].std}
                if name in spreads
                else {},
                shape=report.OTHER_SHAPE if name in bent else report.LIBRARY_SHAPE,
                indistinguishable_from=rivals_of(task, traced, named, name),
                depends_on=kind.depends_on,
                **of_search,
            )
        )
    if found and not task.vehicle.per_flight_trims:
        own = {k: s for k, s in spreads.items() if k not in model.kinds}
        found += [_spread_entry(task, kind, spread) for kind, spread in own.items()]
    return tuple(sorted(found, key=lambda e: -np.nan_to_num(e.evidence, nan=-1.0)))


def _sign_entry(signs: Signs) -> FoundEffect:
    values = signs.effect.to_dict().items()
    return FoundEffect(
        kind=ANGLE_SIGN.kind,
        words=ANGLE_SIGN.words,
        coefficients={name: Estimate(value, 0.0, "-") for name, value in values},
        evidence=signs.evidence,
        share_of_residual=signs.share,
        depends_on=ANGLE_SIGN.depends_on,
    )


def _function_entry(
    task: Task,
    traced: SearchResult,
    named: Collection[str],
    known: Uncertainty,
    name: str,
    family: str,
    of_search: dict[str, Any],
) -> FoundEffect:
    """A free function as an effect of its family, or of none."""
    kind = FAMILIES[name]
    own = traced.model.by_name[name]
    has_none = family == "unexplained"
    return FoundEffect(
        kind=family,
        words=f"no effect of the library: {kind.words}" if has_none else kind.words,
        coefficients=_find_peak(own, known)
        | (numbers_of_lift(own, known, family) if name == LIFT else {}),
        shape=report.LIBRARY_SHAPE if has_none else report.OTHER_SHAPE,
        family=kind.link,
        indistinguishable_from=rivals_of(task, traced, named, name, family),
        depends_on=kind.depends_on,
        **of_search,
    )


def rivals_of(
    task: Task, traced: SearchResult, reported: Collection[str], *named: str
) -> tuple[str, ...]:
    """Returns the formulas that would do as well in the place of an effect.

    `named` are its kinds, `reported` those of all effects. To first order, or as fitted
    in a set without it, but with all other formulas, that is nearly as likely; where
    that has several others instead, they do as well together.
    """
    own = named[0]
    formulas = {*traced.model.kinds} - FAMILIES.keys()
    found = set[str]() if own in FAMILIES else {*traced.weighed[own].rivals}
    for other, _ in traced.rivals:
        lost = formulas - {*other.kinds}
        if lost <= {own} and not {*named} & {*other.kinds}:
            found |= {*other.kinds} - FAMILIES.keys() - formulas
    return tuple(
        kind for kind in task.space.kinds if kind in found.difference(reported)
    )


def numbers_of_lift(
    own: FittedFunction, known: Uncertainty, family: str
) -> dict[str, Estimate]:
    """What a formula's coefficient says of a normal force, of its curve at α = 0.

    Of lift the slope, of camber the zero-lift angle, of which C_n is -2 sin there.
    """
    places = known.places[LIFT]
    step = 0.02
    low, middle, high = own.gaussians(step * np.array([[-1.0], [0.0], [1.0]]))
    is_camber = family == CAMBER.kind
    row = (-0.5 * middle if is_camber else (high - low) / (2.0 * step)) @ own.mix
    value = float(row @ own.coordinates)
    std = float(known.std_along(places, row))
    if is_camber:
        return {"zero_lift_angle": Estimate(value, std, "rad")}
    return {"slope": Estimate(value, std, "1/rad")}


def _find_peak(function: FittedFunction, known: Uncertainty) -> dict[str, Estimate]:
    """The largest value of a free function's term, and where it is.

    Standard errors follow from the covariance C of the coordinates w. With a term
    f = b(ξ)·w, to first order a peak's height moves with δw as b·δw, its place along a
    variable as -b'·δw / f'': their variances are b'C b and b''C b' / f''². A peak at
    the edge of the flown range is not one of the function: its place has no error,
    nor has that of a function of two variables.
    """
    places = known.places[function.name]
    count = 401 if len(function.variables) == 1 else 61
    low, high = function.flown
    axes = [*np.linspace(low, high, count).T]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    rows = function.gaussians(points.reshape(-1, len(axes))) @ function.mix  # b, (n, q)
    rows = rows.reshape(*points.shape[:-1], -1)
    values = rows @ function.coordinates
    peak = np.unravel_index(np.argmax(np.abs(values)), values.shape)
    height = float(known.std_along(places, rows[peak]))
    term = function.effect.kind
    [value] = function.effect.coefficients
    found = {f"{term}_peak": Estimate(float(values[peak]), height, value.unit)}
    for i, (axis, variable) in enumerate(zip(axes, function.variables, strict=True)):
        slopes = np.gradient(rows, axis, axis=i)
        place = math.nan
        bend = np.gradient(slopes @ function.coordinates, axis, axis=i)[peak]
        if len(axes) == 1 and 0 < peak[i] < count - 1 and bend:
            place = float(known.std_along(places, slopes[peak])) / abs(float(bend))
        at = Estimate(float(axis[peak[i]]), place, FLOW_UNITS[variable])
        found[f"{term}_peak_at_{variable}"] = at
    return found


def _spread_entry(task: Task, name: str, spread: Spread) -> FoundEffect:
    """A flight-to-flight variation as an effect, with the mean over flights."""
    kind = task.space.kinds[name]
    values = list(spread.values.values())
    coefficient = kind.coefficients[0].name
    std = spread.std / math.sqrt(len(values))
    return FoundEffect(
        kind=name,
        words=f"{kind.words}, different in each flight",
        coefficients={coefficient: Estimate(float(np.mean(values)), std, spread.unit)},
        inclusion=math.nan,
        spread_over_flights={coefficient: spread.std},
        depends_on=kind.depends_on,
    )


def model_of(task: Task, model: FitResult, signs: Signs) -> GliderModel:
    """The corrected glider."""
    space = task.space
    parameters, fitted = space.unpack(model.theta, task.vehicle.parameters)
    by_kind = {effect.kind.kind: effect for effect in fitted}
    nuisance = {space.owners[i] for i in task.vehicle.unknown} - {*model.kinds}
    names = [*model.kinds, *(kind for kind in space.kinds if kind in nuisance)]
    effects = [] if signs.are_right else [signs.effect]
    effects += [by_kind[name] for name in names if name not in model.free_kinds]
    return GliderModel(
        parameters=parameters,
        effects=tuple(effects),
        free_functions=tuple(own.data for own in model.functions),
    )


def vehicle_of(task: Task, model: FitResult, known: Uncertainty) -> dict[str, Estimate]:
    """The unknown parameters of the vehicle, by name."""
    space = task.space
    per_kilogram = {"m²": "m²/kg", "kg m²": "m²"} if task.vehicle.is_per_mass else {}
    found = {}
    for slot in task.vehicle.unknown:
        unit = space.entries[slot].unit
        if space.owners[slot] == OF_VEHICLE:
            unit = per_kilogram.get(unit, unit)
        value = float(model.theta[slot])
        found[space.names[slot]] = Estimate(value, known.std(slot), unit)
    return found


def clocks_of(task: Task, model: FitResult, known: Uncertainty) -> dict[str, Estimate]:
    """Offsets of clocks, and biases of sensors, that were estimated, by name."""
    found = {}
    for slot in task.vehicle.of_log:
        own = task.space.entries[slot]
        if task.space.owners[slot] == SERVO_LOG.kind and slot in known.free:
            variance, _ = known.of([known.free.index(slot)])
            size, unit = (1e3, "ms") if own.unit == "s" else (1.0, own.unit)
            std = size * math.sqrt(variance[0, 0])
            found[own.name] = Estimate(size * float(model.theta[slot]), std, unit)
    return found


def covariance_of(task: Task, known: Uncertainty) -> Covariance | None:
    """Covariance of all fitted parameters of the corrected glider; None without any.

    Those are the effects' coefficients and the unknown parameters of the vehicle. Of
    flight-to-flight variation only the mean is included.
    """
    matrix, freedom = known.covariance
    names = tuple(task.space.names[slot] for slot in known.named)
    if not names:
        return None
    return Covariance(names=names, matrix=matrix, degrees_of_freedom=freedom)


def curves_of(before: ResidualTable, named: ResidualTable) -> tuple[report.Curve, ...]:
    """The residual of the flat plate over the angle of attack, in equal bins.

    Bands are standard errors over flights.
    """
    alpha = before.variables["alpha"]
    edges = np.unique(np.quantile(alpha, np.linspace(0.0, 1.0, _BINS + 1)))
    place = np.clip(np.searchsorted(edges, alpha, side="right") - 1, 0, len(edges) - 2)
    lack = _lack_of(before)
    # Effects change airspeed and areas too: the rest in units of the flat plate.
    explained = lack - (named.unit / before.unit)[:, [0, 0, 1]] * _lack_of(named)
    both = np.hstack([lack, explained])
    bins = []
    for here in (np.flatnonzero(place == b) for b in np.unique(place)):
        _, own, rows = np.unique(
            before.flight[here], return_inverse=True, return_counts=True
        )
        if len(rows) < 2:
            continue
        sums = [np.bincount(own, weights=column) for column in both[here].T]
        means = (np.array(sums) / rows).T
        (mean, part), std = np.split(means.mean(axis=0), 2), means[:, :3].std(0, ddof=1)
        middle = np.full(3, alpha[here].mean())
        bins.append([middle, mean, std / np.sqrt(len(rows)), part])
    columns = np.array(bins).reshape(-1, 4, 3).T  # Terms, columns, bins.
    fields = "alpha", "lack", "std", "named"
    return tuple(
        report.Curve(term=term, **dict(zip(fields, own, strict=True)))
        for term, own in zip(report.CURVE_TERMS, columns, strict=True)
    )


def _lack_of(table: ResidualTable) -> np.ndarray:
    """Measured minus modelled coefficients: normal, axial, of the moment (N, 3)."""
    alpha = table.variables["alpha"]
    s = np.sin(alpha)
    c = np.cos(alpha)
    pairs = [(table.coefficients[name], table.modelled[name]) for name in COEFFICIENTS]
    lift, drag, moment = (measured - modelled for measured, modelled in pairs)
    return np.column_stack([lift * c + drag * s, drag * c - lift * s, moment])
