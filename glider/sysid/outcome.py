"""The parts of a result: effects, corrected model, curves, spreads."""

import dataclasses
import math

import numpy as np

from glider.campaign.logs import Campaign
from glider.physics.covariance import Covariance
from glider.physics.effects import ANGLE_SIGN
from glider.physics.effects.field import FieldData
from glider.physics.model import GliderModel
from glider.sysid import result
from glider.sysid.likelihood import scales
from glider.sysid.likelihood.curves import TERMS
from glider.sysid.likelihood.model_fit import FitResult, error_flights
from glider.sysid.likelihood.task import Task
from glider.sysid.likelihood.uncertainty import Uncertainty
from glider.sysid.replay.signs import Signs, sign_effect
from glider.sysid.replay.vehicle import Vehicle, parameters_of
from glider.sysid.result import Estimate
from glider.sysid.search.fields import FoundField
from glider.sysid.search.fits import EVIDENCE_THRESHOLD
from glider.sysid.search.support import SearchResult

FAMILIES = {
    "c_lift": "attached_lift camber dynamic_stall pitch_rate_lift airspeed_dependence "
    "ground_effect mass added_mass",
    "c_drag": "profile_drag axial_drag induced_drag thrust",
    "c_moment": "center_of_pressure pitch_moment pitch_damping inertia downwash "
    "stalled_downwash",
    "elevator_factor": "tail_wake elevator_area elevator_blowback downwash "
    "stalled_downwash servo_lag",
}
"""Kinds of effects whose formula may be wrong in a term's curve, in words."""

SPREAD_KINDS = {
    "elevator_trim": ("trim", "angle", "rad"),
    "pitch_offset": ("pitch_zero", "angle", "rad"),
    "wind": ("wind", "x", "m/s"),
}
"""Kinds with flight-to-flight variation: scale, coefficient, unit."""

LEAST_SPREAD = 0.1
"""Least flight-to-flight variation to report, in the coefficient's scale."""

CURVE_Z = 5.0
"""Standard errors by which a curve must differ from zero, somewhere in the central 90 %
of the flown angles: at its ten independent places none does so by chance."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ResidualCurves:
    """Curves that a model carries beside its formulas."""

    terms: tuple[str, ...]  # That are not zero.
    data: FieldData | None  # Of all of them.


def carried_of(task: Task, model: FitResult, known: Uncertainty) -> ResidualCurves:
    """Returns the significant curves of a model."""
    if not model.has_curves:
        return ResidualCurves(terms=(), data=None)
    alpha = _central_angles(task)
    values = task.curves.values(model.coordinates, alpha)
    corner = known.covariance[len(model.free) :, len(model.free) :]
    units = np.eye(len(model.coordinates))
    basis = np.stack([task.curves.values(u, alpha) for u in units], axis=2)
    std = np.sqrt(np.einsum("atq,qr,atr->at", basis, corner, basis))
    high_z = np.max(np.abs(values) / np.maximum(std, 1e-12), axis=0)
    found = tuple(t for t, z in zip(TERMS, high_z, strict=True) if z > CURVE_Z)
    return ResidualCurves(terms=found, data=task.curves.data(model.coordinates))


def _central_angles(task: Task) -> np.ndarray:
    """Angles over the central 90 % of those flown, (41,) [rad]."""
    low, high = np.percentile(task.curves.angles, [5.0, 95.0])
    return np.linspace(low, high, 41)


def spreads_of(task: Task, model: FitResult) -> dict[str, result.Spread]:
    """Returns the flight-to-flight variation, with the value of each flight.

    It is reported where it reaches the threshold of an effect, all else refitted.
    """
    flights = error_flights(task, model)
    _, base = scales.fit_scales(flights, model.scales)
    found = {}
    own = scales.flight_values(flights, model.scales)
    names = [record.name for record in task.records]
    for kind, (scale, coefficient, unit) in SPREAD_KINDS.items():
        least = dataclasses.replace(
            model.scales, **{scale: getattr(scales.FLOOR, scale)}
        )
        others = [name for name in scales.NAMES if name != scale]
        lost = scales.fit_scales(flights, least, others)[1] - base
        slot = task.layout.index[kind, coefficient]
        least_std = LEAST_SPREAD * task.layout.scale[slot]
        shows = lost > EVIDENCE_THRESHOLD and getattr(model.scales, scale) > least_std
        if shows or (kind == "elevator_trim" and task.per_flight_trims):
            values = [float(o[scales.PER_FLIGHT[kind][coefficient]]) for o in own]
            found[kind] = result.Spread(
                std=getattr(model.scales, scale),
                unit=unit,
                values=dict(zip(names, values, strict=True)),
            )
    return found


def effects_of(
    task: Task,
    traced: SearchResult,
    known: Uncertainty,
    carried: ResidualCurves,
    spreads: dict[str, result.Spread],
    signs: Signs,
) -> tuple[result.FoundEffect, ...]:
    """Returns the effects with their coefficients and standard errors."""
    model, layout, field = traced.model, task.layout, traced.field
    gained = sum(traced.evidence.values()) + (0.0 if field is None else field.evidence)
    found = [] if signs.are_right else [_sign_entry(signs)]
    left = set(carried.terms)
    for name in model.kinds:
        kind, support = layout.kinds[name], traced.weighed[name]
        mine = {t for t in carried.terms if name in FAMILIES[t].split()}
        left -= mine
        spread = {}
        if name in spreads:
            spread = {SPREAD_KINDS[name][1]: spreads[name].std}
        slots = zip(layout.slots_of(name), kind.coefficients, strict=True)
        entry = _entry(
            name,
            kind.words,
            {c.name: _estimate(model.theta[i], known.std(i), c.unit) for i, c in slots},
            kind.depends_on,
            traced.evidence.get(name, 0.0),
            gained,
        )
        found.append(
            dataclasses.replace(
                entry,
                indistinguishable_from=support.rivals,
                inclusion=support.inclusion,
                spread_over_flights=spread,
                shape=result.OTHER_SHAPE if mine else result.LIBRARY_SHAPE,
            )
        )
    if field is not None:
        found.append(_field_entry(field, gained))
    elif left:
        found.append(_curve_entry(task, model, tuple(sorted(left))))
    if found and task.vehicle.trim_is_known:
        found += [
            _spread_entry(task, kind, spread)
            for kind, spread in spreads.items()
            if kind not in model.kinds
        ]
    return tuple(sorted(found, key=lambda e: -np.nan_to_num(e.evidence, nan=-1.0)))


def _estimate(value: float, std: float, unit: str) -> result.Estimate:
    return result.Estimate(value=float(value), std=std, unit=unit)


def _entry(
    kind: str,
    words: str,
    coefficients: dict[str, result.Estimate],
    depends_on: tuple[str, ...],
    evidence: float = math.nan,
    gained: float = math.nan,
) -> result.FoundEffect:
    """Makes an effect whose share is its evidence over all that was gained [nats]."""
    return result.FoundEffect(
        kind=kind,
        words=words,
        coefficients=coefficients,
        evidence=float(evidence),
        share_of_residual=float(np.clip(evidence / max(gained, 1e-9), 0.0, 1.0)),
        indistinguishable_from=(),
        depends_on=depends_on,
    )


def _sign_entry(signs: Signs) -> result.FoundEffect:
    names = ("pitch", "elevator", "command")
    turned = {name: _estimate(getattr(signs, name), 0.0, "-") for name in names}
    entry = _entry(ANGLE_SIGN.kind, ANGLE_SIGN.words, turned, ANGLE_SIGN.depends_on)
    return dataclasses.replace(
        entry, evidence=signs.evidence, share_of_residual=signs.share
    )


def _field_entry(field: FoundField, gained: float) -> result.FoundEffect:
    assert field.model.extra is not None
    what = {"air": "the air moves", "forces": "forces change"}[field.basis.form]
    return _entry(
        "unexplained",
        f"no effect of the library: {what} with {', '.join(field.depends_on)}",
        find_peaks(field.model.extra, field.covariance),
        field.depends_on,
        field.evidence,
        gained,
    )


def _curve_entry(
    task: Task, model: FitResult, terms: tuple[str, ...]
) -> result.FoundEffect:
    alpha = _central_angles(task)
    values = task.curves.values(model.coordinates, alpha)
    peaks = {}
    for term in terms:
        curve = values[:, TERMS.index(term)]
        peak = int(np.argmax(np.abs(curve)))
        unit = "m" if term == "c_moment" else "-"
        peaks[f"{term}_peak"] = _estimate(curve[peak], math.nan, unit)
        peaks[f"{term}_peak_at_alpha"] = _estimate(alpha[peak], math.nan, "rad")
    words = f"no effect of the library: {', '.join(terms)} change with alpha"
    return _entry("unexplained", words, peaks, ("alpha",))


def _spread_entry(task: Task, name: str, spread: result.Spread) -> result.FoundEffect:
    """Returns a flight-to-flight variation as an effect, with the mean over flights."""
    kind, (_, first, unit) = task.layout.kinds[name], SPREAD_KINDS[name]
    values = list(spread.values.values())
    mean = _estimate(float(np.mean(values)), spread.std / math.sqrt(len(values)), unit)
    words = f"{kind.words}, different in each flight"
    return dataclasses.replace(
        _entry(name, words, {first: mean}, kind.depends_on),
        inclusion=math.nan,
        spread_over_flights={first: spread.std},
    )


def model_of(
    task: Task,
    model: FitResult,
    carried: ResidualCurves,
    signs: Signs,
    campaign: Campaign,
) -> GliderModel:
    """Returns the corrected glider."""
    layout = task.layout
    effects = [] if signs.are_right else [sign_effect(signs)]
    kinds = list(model.kinds)
    own = {layout.slots[i][0] for i in task.vehicle.nuisance} - {"parameters"}
    kinds += [kind for kind in layout.kinds if kind in own and kind not in kinds]
    for name in kinds:
        kind = layout.kinds[name]
        values = model.theta[list(layout.slots_of(name))]
        names = [c.name for c in kind.coefficients]
        effects.append(kind(**dict(zip(names, map(float, values), strict=True))))
    field = model.extra
    if carried.data is not None:
        field = (
            carried.data
            if field is None
            else dataclasses.replace(field, more=[carried.data])
        )
    return GliderModel(
        parameters=parameters_of(model.theta, campaign),
        effects=tuple(effects),
        field=field,
    )


def vehicle_of(vehicle: Vehicle, model: FitResult, known: Uncertainty) -> dict:
    """Returns the unknown parameters of the vehicle, with standard errors."""
    units = {"wing_offset": "m", "mass": "kg", "pitch_inertia": "kg m²"}
    if vehicle.is_per_mass:
        units["pitch_inertia"] = "m²"
    area = "m²/kg" if vehicle.is_per_mass else "m²"
    found = {}
    for slot in vehicle.nuisance:
        kind, name = vehicle.layout.slots[slot]
        label = name if kind == "parameters" else f"{kind}.{name}"
        unit = units.get(name, area)
        if kind != "parameters":
            kind_of = vehicle.layout.kinds[kind]
            unit = next(c.unit for c in kind_of.coefficients if c.name == name)
        found[label] = _estimate(model.theta[slot], known.std(slot), unit)
    return found


def covariance_of(
    task: Task, model: FitResult, known: Uncertainty
) -> Covariance | None:
    """Returns the covariance of all fitted parameters of the corrected glider.

    Those are the effects' coefficients and the unknown parameters of the vehicle; None
    without any. Of flight-to-flight variation only the mean is included.
    """
    layout = task.layout
    mine = {i for kind in model.kinds for i in layout.slots_of(kind)}
    mine |= set(task.vehicle.nuisance)
    rows = [k for k, slot in enumerate(known.free) if slot in mine]
    if not rows:
        return None
    slots = (layout.slots[known.free[k]] for k in rows)
    corner = known.covariance[np.ix_(rows, rows)]
    return Covariance(
        names=tuple(n if k == "parameters" else f"{k}.{n}" for k, n in slots),
        matrix=0.5 * (corner + corner.T),
    )


def correlations_of(
    task: Task, model: FitResult, known: Uncertainty
) -> dict[str, dict[str, float]]:
    """Returns the correlations of the errors of the effects' coefficients."""
    slots = [i for kind in model.kinds for i in task.layout.slots_of(kind)]
    index = [known.free.index(i) for i in slots if i in known.free]
    corner = known.covariance[np.ix_(index, index)]
    std = np.sqrt(np.diag(corner))
    matrix = (corner / std[:, None] / std).tolist()
    labels = [".".join(task.layout.slots[known.free[k]]) for k in index]
    return {
        a: {b: r for b, r in zip(labels, row, strict=True) if b != a}
        for a, row in zip(labels, matrix, strict=True)
    }


def curves_of(
    before: result.ResidualTable, named: result.ResidualTable
) -> tuple[result.Curve, ...]:
    """Returns the residual of the flat plate over the angle of attack, in equal bins.

    Bands are standard errors over flights.
    """
    alpha = before.variables["alpha"]
    edges = np.unique(np.quantile(alpha, np.linspace(0.0, 1.0, _BINS + 1)))
    place = np.clip(np.searchsorted(edges, alpha, side="right") - 1, 0, len(edges) - 2)
    lack, rest = _lack_of(before), _lack_of(named)
    # Effects change airspeed and areas too: the rest in units of the flat plate.
    force, moment = (named.unit / before.unit).T
    explained = {
        "c_normal": lack["c_normal"] - force * rest["c_normal"],
        "c_axial": lack["c_axial"] - force * rest["c_axial"],
        "c_moment": lack["c_moment"] - moment * rest["c_moment"],
    }
    curves = []
    for term in lack:
        rows = []
        for b in range(len(edges) - 1):
            here = place == b
            flights = np.unique(before.flight[here])
            rows_of = [here & (before.flight == f) for f in flights]
            if len(rows_of) < 2:
                continue
            means = [np.mean(lack[term][of_flight]) for of_flight in rows_of]
            parts = [np.mean(explained[term][of_flight]) for of_flight in rows_of]
            error = np.std(means, ddof=1) / np.sqrt(len(means))
            rows.append((np.mean(alpha[here]), np.mean(means), error, np.mean(parts)))
        angles, total, std, named_part = np.array(rows).reshape(-1, 4).T
        curves.append(
            result.Curve(term=term, alpha=angles, lack=total, std=std, named=named_part)
        )
    return tuple(curves)


def _lack_of(table: result.ResidualTable) -> dict[str, np.ndarray]:
    """Returns measured minus modelled coefficients along and across the wing."""
    alpha = table.variables["alpha"]
    s, c = np.sin(alpha), np.cos(alpha)
    lift, drag, moment = (
        table.coefficients[name] - table.modelled[name]
        for name in ("c_lift", "c_drag", "c_moment")
    )
    return {
        "c_normal": lift * c + drag * s,
        "c_axial": drag * c - lift * s,
        "c_moment": moment,
    }


_BINS = 15


def find_peaks(data: FieldData, covariance_of_all: np.ndarray) -> dict[str, Estimate]:
    """Returns the largest value of each term of a field over one variable.

    Standard errors follow from the weights' covariance C. With the field
    f = b(ξ)·w, to first order a peak's height moves with δw as b·δw, its place
    as -b'·δw / f'': their variances are b'C b and b''C b' / f''². A peak at the
    edge of the flown range is not one of the field: its place has no error (NaN).
    """
    variable = data.variables[0]
    centers, width = np.array(data.centers)[:, 0], data.widths[0]
    grid = np.linspace(centers.min(), centers.max(), 401)
    found = {}
    for k, (term, values) in enumerate(data.weights.items()):
        weights = np.array(values)
        of_term = slice(k, None, len(data.weights))
        covariance = covariance_of_all[of_term, of_term]
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
