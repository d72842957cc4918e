"""The parts of a result: effects, corrected model, curves, spreads."""

import dataclasses
import math

import numpy as np

from glider.campaign.logs import Campaign
from glider.physics.covariance import Covariance
from glider.physics.effects import ANGLE_SIGN, POSE_LATENCY
from glider.physics.effects.field import FIELD_UNITS, FieldData
from glider.physics.model import GliderModel
from glider.sysid import result
from glider.sysid.likelihood import scales
from glider.sysid.likelihood.blocks import BLOCKS, CURVE_TERMS, CURVES
from glider.sysid.likelihood.model_fit import FitResult, error_flights
from glider.sysid.likelihood.task import Task
from glider.sysid.likelihood.uncertainty import Uncertainty
from glider.sysid.replay.record import Signs, sign_effect
from glider.sysid.replay.vehicle import parameters_of
from glider.sysid.result import Estimate, FoundEffect
from glider.sysid.search.fits import EVIDENCE_THRESHOLD
from glider.sysid.search.support import SearchResult

FAMILIES = {
    "c_lift": "attached_lift camber dynamic_stall lagged_separation pitch_rate_lift "
    "airspeed_dependence ground_effect mass added_mass",
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


def carried_of(task: Task, model: FitResult, known: Uncertainty) -> tuple[str, ...]:
    """Returns the terms in which a model's curves are significant."""
    places = model.places().get(CURVES)
    if places is None:
        return ()
    alpha, curves = _central_angles(task), task.curves
    own = model.by_name[CURVES].coordinates
    values = curves.values(own, alpha)
    corner = known.covariance[np.ix_(places, places)]
    basis = np.stack([curves.values(u, alpha) for u in np.eye(len(own))], axis=2)
    std = np.sqrt(np.einsum("atq,qr,atr->at", basis, corner, basis))
    high_z = np.max(np.abs(values) / np.maximum(std, 1e-12), axis=0)
    return tuple(t for t, z in zip(CURVE_TERMS, high_z, strict=True) if z > CURVE_Z)


def _central_angles(task: Task) -> np.ndarray:
    """Angles over the central 90 % of those flown, (41, 1) [rad]."""
    low, high = np.percentile(task.curves.angles, [5.0, 95.0])
    return np.linspace(low, high, 41)[:, None]


def spreads_of(task: Task, model: FitResult) -> dict[str, result.Spread]:
    """Returns the flight-to-flight variation, with the value of each flight.

    It is reported where it reaches the threshold of an effect, all else refitted.
    """
    flights = error_flights(task, model)
    # Those of the model may be priors, as in the search along the attitude.
    fitted, base = scales.fit_scales(flights, model.scales)
    found = {}
    own = scales.flight_values(flights, fitted)
    names = [record.name for record in task.records]
    for kind, (scale, coefficient, unit) in SPREAD_KINDS.items():
        least = dataclasses.replace(fitted, **{scale: getattr(scales.FLOOR, scale)})
        others = [name for name in scales.NAMES if name != scale]
        lost = scales.fit_scales(flights, least, others)[1] - base
        slot = task.layout.index[kind, coefficient]
        least_std = LEAST_SPREAD * task.layout.scale[slot]
        std = getattr(fitted, scale)
        if lost > EVIDENCE_THRESHOLD and least_std < min(
            std, getattr(model.scales, scale)
        ):
            column = scales.PER_FLIGHT.index((kind, coefficient))
            values = own[:, column].tolist()
            found[kind] = result.Spread(
                std=std,
                std_error=std / math.sqrt(2.0 * len(values)),
                unit=unit,
                values=dict(zip(names, values, strict=True)),
            )
    return found


def effects_of(
    task: Task,
    traced: SearchResult,
    known: Uncertainty,
    carried: tuple[str, ...],
    spreads: dict[str, result.Spread],
    signs: Signs,
) -> tuple[FoundEffect, ...]:
    """Returns the effects with their coefficients and standard errors."""
    model, layout = traced.model, task.layout
    gained = sum(traced.evidence.values())
    found = [] if signs.are_right else [_sign_entry(signs)]
    left = set(carried)
    bent = {k for b in model.free_kinds for k in BLOCKS[b].bends}
    for name in model.kinds:
        if name in model.free_kinds:
            if BLOCKS[name].bends.isdisjoint(model.kinds):
                found.append(_block_entry(traced, known, name, gained))
            continue
        if name == POSE_LATENCY.kind and model.theta[layout.slots_of(name)[0]] < 0.0:
            continue  # Not physical: the clocks differ, see `verdict.find_doubt`.
        kind, support = layout.kinds[name], traced.weighed[name]
        mine = {t for t in carried if name in FAMILIES[t].split()}
        left -= mine
        slots = zip(layout.slots_of(name), kind.coefficients, strict=True)
        evidence = traced.evidence.get(name, 0.0)
        found.append(
            FoundEffect(
                kind=name,
                words=kind.words,
                coefficients={
                    c.name: Estimate(float(model.theta[i]), known.std(i), c.unit)
                    for i, c in slots
                },
                evidence=float(evidence),
                share_of_residual=_share(evidence, gained),
                inclusion=support.inclusion,
                spread_over_flights={SPREAD_KINDS[name][1]: spreads[name].std}
                if name in spreads
                else {},
                shape=result.OTHER_SHAPE
                if mine or name in bent
                else result.LIBRARY_SHAPE,
                indistinguishable_from=support.rivals,
                depends_on=kind.depends_on,
            )
        )
    if left:
        found.append(_curve_entry(task, model, tuple(sorted(left))))
    if found and task.vehicle.trim_is_known:
        found += [
            _spread_entry(task, kind, spread)
            for kind, spread in spreads.items()
            if kind not in model.kinds
        ]
    return tuple(sorted(found, key=lambda e: -np.nan_to_num(e.evidence, nan=-1.0)))


def _share(evidence: float, gained: float) -> float:
    """Evidence over all that was gained [nats], 0 to 1."""
    return float(np.clip(evidence / max(gained, 1e-9), 0.0, 1.0))


def _sign_entry(signs: Signs) -> FoundEffect:
    return FoundEffect(
        kind=ANGLE_SIGN.kind,
        words=ANGLE_SIGN.words,
        coefficients={
            name: Estimate(value, 0.0, "-")
            for name, value in sign_effect(signs).to_dict().items()
        },
        evidence=signs.evidence,
        share_of_residual=signs.share,
        depends_on=ANGLE_SIGN.depends_on,
    )


def _block_entry(
    traced: SearchResult, known: Uncertainty, name: str, gained: float
) -> FoundEffect:
    """A free function as an effect of its family, or of none."""
    model, kind = traced.model, BLOCKS[name]
    own = model.by_name[name]
    places = model.places()[name]
    mix = own.block.mix
    spread = mix @ known.covariance[np.ix_(places, places)] @ mix.T
    acting = [own.block.terms[g] for g in np.flatnonzero(own.is_acting)]
    rows = np.isin(own.block.terms * len(own.block.centers), acting)
    family, evidence = traced.families.get(name), traced.evidence.get(name, 0.0)
    words = kind.words
    if family is None:
        words = f"no effect of the library: {words}"
    return FoundEffect(
        kind=family or "unexplained",
        words=words,
        coefficients=find_peaks(own.data, spread[np.ix_(rows, rows)]),
        evidence=float(evidence),
        share_of_residual=_share(evidence, gained),
        inclusion=traced.weighed[name].inclusion,
        shape=result.LIBRARY_SHAPE if family is None else result.OTHER_SHAPE,
        family="moment" if acting == ["c_moment"] else kind.link,
        depends_on=kind.variables,
    )


def _curve_entry(task: Task, model: FitResult, terms: tuple[str, ...]) -> FoundEffect:
    alpha = _central_angles(task)
    own = model.by_name[CURVES].coordinates
    values, peaks = task.curves.values(own, alpha), {}
    for term in terms:
        curve = values[:, CURVE_TERMS.index(term)]
        peak = int(np.argmax(np.abs(curve)))
        unit = "m" if term == "c_moment" else "-"
        peaks[f"{term}_peak"] = Estimate(float(curve[peak]), math.nan, unit)
        peaks[f"{term}_peak_at_alpha"] = Estimate(
            float(alpha[peak, 0]), math.nan, "rad"
        )
    return FoundEffect(
        kind="unexplained",
        words=f"no effect of the library: {', '.join(terms)} change with alpha",
        coefficients=peaks,
        depends_on=("alpha",),
    )


def _spread_entry(task: Task, name: str, spread: result.Spread) -> FoundEffect:
    """A flight-to-flight variation as an effect, with the mean over flights."""
    kind, coefficient = task.layout.kinds[name], SPREAD_KINDS[name][1]
    values = list(spread.values.values())
    std = spread.std / math.sqrt(len(values))
    mean = Estimate(float(np.mean(values)), std, spread.unit)
    return FoundEffect(
        kind=name,
        words=f"{kind.words}, different in each flight",
        coefficients={coefficient: mean},
        inclusion=math.nan,
        spread_over_flights={coefficient: spread.std},
        depends_on=kind.depends_on,
    )


def model_of(
    task: Task, model: FitResult, signs: Signs, campaign: Campaign
) -> GliderModel:
    """Returns the corrected glider."""
    layout = task.layout
    effects = [] if signs.are_right else [sign_effect(signs)]
    nuisance = {layout.slots[i][0] for i in task.vehicle.unknown}
    kinds = [kind for kind in layout.kinds if kind in nuisance - {*model.kinds}]
    for name in (*model.kinds, *kinds):
        if name in model.free_kinds:
            continue
        kind = layout.kinds[name]
        values = model.theta[list(layout.slots_of(name))].tolist()
        names = [c.name for c in kind.coefficients]
        effects.append(kind(**dict(zip(names, values, strict=True))))
    parts = [own.data for own in model.blocks]
    field = dataclasses.replace(parts[0], more=parts[1:]) if parts else None
    parameters = parameters_of(model.theta, campaign)
    return GliderModel(parameters=parameters, effects=tuple(effects), field=field)


def vehicle_of(task: Task, model: FitResult, known: Uncertainty) -> dict:
    """Returns the unknown parameters of the vehicle, with standard errors."""
    is_per_mass = task.vehicle.is_per_mass
    units = {"wing_offset": "m", "mass": "kg"}
    units["pitch_inertia"] = "m²" if is_per_mass else "kg m²"
    found = {}
    for slot in task.vehicle.unknown:
        kind, name = task.layout.slots[slot]
        label, unit = name, units.get(name, "m²/kg" if is_per_mass else "m²")
        if coefficient := task.coefficient(slot):
            label, unit = f"{kind}.{name}", coefficient.unit
        found[label] = Estimate(float(model.theta[slot]), known.std(slot), unit)
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
    mine |= set(task.vehicle.unknown)
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
    lack = _lack_of(before)
    # Effects change airspeed and areas too: the rest in units of the flat plate.
    explained = lack - (named.unit / before.unit)[:, [0, 0, 1]] * _lack_of(named)
    bins = []
    for b in range(len(edges) - 1):
        here = place == b
        flights = np.unique(before.flight[here])
        if len(flights) < 2:
            continue
        rows_of = [here & (before.flight == f) for f in flights]
        means = np.array([lack[rows].mean(axis=0) for rows in rows_of])
        parts = np.array([explained[rows].mean(axis=0) for rows in rows_of])
        std = means.std(axis=0, ddof=1) / np.sqrt(len(flights))
        middle = np.full(3, alpha[here].mean())
        bins.append([middle, means.mean(axis=0), std, parts.mean(axis=0)])
    columns = np.array(bins).reshape(-1, 4, 3)
    return tuple(
        result.Curve(term=term, **dict(zip(_CURVE, columns[:, :, k].T, strict=True)))
        for k, term in enumerate(result.CURVE_TERMS[:3])
    )


_BINS = 15
_CURVE = ("alpha", "lack", "std", "named")


def _lack_of(table: result.ResidualTable) -> np.ndarray:
    """Measured minus modelled coefficients: normal, axial, of the moment (N, 3)."""
    alpha = table.variables["alpha"]
    s, c = np.sin(alpha), np.cos(alpha)
    lift, drag, moment = (
        table.coefficients[name] - table.modelled[name]
        for name in ("c_lift", "c_drag", "c_moment")
    )
    return np.column_stack([lift * c + drag * s, drag * c - lift * s, moment])


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
        unit = "m/s" if term.startswith("wind") else ("m" if "moment" in term else "-")
        std = float(np.sqrt(height @ covariance @ height))
        found[f"{term}_peak"] = Estimate(float(height @ weights), std, unit)
        place_std = math.nan
        if 0 < peak < len(grid) - 1 and curvature != 0.0:
            place_std = float(np.sqrt(slope @ covariance @ slope) / abs(curvature))
        at = Estimate(float(place), place_std, FIELD_UNITS[variable])
        found[f"{term}_peak_at_{variable}"] = at
    return found
