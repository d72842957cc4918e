"""The parts of a result: verdict, effects, corrected model, flights."""

import math

import numpy as np

from glider.campaign.logs import Campaign
from glider.physics.effects import ANGLE_SIGN
from glider.physics.model import GliderModel
from glider.sysid.fit.output_error import fit_covariance
from glider.sysid.fit.prediction import (
    Prediction,
    beginning_rows,
)
from glider.sysid.replay.problem import Problem
from glider.sysid.replay.signs import Signs, sign_effect
from glider.sysid.replay.theta import Layout
from glider.sysid.replay.vehicle import (
    Vehicle,
    parameters_of,
)
from glider.sysid.result import (
    MODELS,
    Z_SIGNIFICANT,
    Estimate,
    FoundEffect,
    HeldOutFlight,
)
from glider.sysid.search.explanation import Explanation


def verdict_of(found: Explanation, signs: Signs) -> str:
    """Returns "no_effect", "effect_found" or "unexplained"."""
    kinds = [w.kind for w in found.weighed]
    if not kinds and signs.are_right:
        return "no_effect" if found.left_z < Z_SIGNIFICANT else "unexplained"
    if kinds and kinds[0] == "unexplained":
        return "unexplained"
    return "effect_found"


def effects_of(
    found: Explanation, signs: Signs, layout: Layout
) -> tuple[FoundEffect, ...]:
    """Returns the effects with their coefficients and standard errors."""
    errors = dict(
        zip(found.fit.free, np.sqrt(np.diag(fit_covariance(found.fit))), strict=True)
    )
    effects = []
    if not signs.are_right:
        effects.append(
            FoundEffect(
                kind=ANGLE_SIGN.kind,
                words=ANGLE_SIGN.words,
                coefficients={
                    name: Estimate(value=float(getattr(signs, name)), std=0.0, unit="-")
                    for name in ("pitch", "elevator", "command")
                },
                evidence=signs.evidence,
                share=signs.share,
                indistinguishable_from=(),
                depends_on=ANGLE_SIGN.depends_on,
            )
        )
    for weighed in found.weighed:
        if weighed.kind == "unexplained":
            assert found.unexplained is not None
            coefficients, words = (
                found.unexplained.coefficients,
                found.unexplained.words,
            )
            depends_on = found.unexplained.depends_on
        else:
            kind = layout.kinds[weighed.kind]
            coefficients = {
                c.name: Estimate(
                    value=float(found.theta[i]),
                    std=float(errors.get(i, math.nan)),  # NaN: not fitted.
                    unit=c.unit,
                )
                for i, c in zip(
                    layout.slots_of(weighed.kind), kind.coefficients, strict=True
                )
            }
            words, depends_on = kind.words, kind.depends_on
        effects.append(
            FoundEffect(
                kind=weighed.kind,
                words=words,
                coefficients=coefficients,
                evidence=weighed.evidence,
                share=weighed.share,
                indistinguishable_from=weighed.alternatives,
                depends_on=depends_on,
            )
        )
    return tuple(effects)


def model_of(
    found: Explanation, signs: Signs, campaign: Campaign, layout: Layout
) -> GliderModel:
    """Returns the corrected glider."""
    effects = []
    if not signs.are_right:
        effects.append(sign_effect(signs))
    kinds = [w.kind for w in found.weighed if w.kind != "unexplained"]
    if campaign.elevator == "fixed" and "elevator_trim" not in kinds:
        kinds.append("elevator_trim")  # The unknown angle at which it stands.
    for name in kinds:
        kind = layout.kinds[name]
        values = found.theta[list(layout.slots_of(name))]
        names = [c.name for c in kind.coefficients]
        effects.append(kind(**dict(zip(names, map(float, values), strict=True))))
    return GliderModel(
        parameters=parameters_of(found.theta, campaign),
        effects=tuple(effects),
        field=None if found.unexplained is None else found.unexplained.data,
    )


def flights_of(
    problem: Problem,
    predictions: dict[str, list[Prediction]],
    vehicle: Vehicle,
    signs: Signs,
) -> tuple[HeldOutFlight, ...]:
    """Returns the held-out flights as logged, beside what each model predicted."""
    flights = []
    as_logged = {"corrected": np.array([1.0, 1.0, signs.pitch])}
    for i, record in enumerate(problem.records):
        rows = beginning_rows(problem, record)
        flights.append(
            HeldOutFlight(
                name=record.flight.name,
                time=record.time,
                measured=record.flight.pose,
                flown={
                    name: predictions[name][i].pose * as_logged.get(name, 1.0)
                    for name in MODELS
                    if name != "as_drawn" or vehicle.is_known
                },
                fitted_until=float(record.time[rows - 1]),
            )
        )
    return tuple(flights)
