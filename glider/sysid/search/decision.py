"""Weighs the library's explanation against one that has no name.

If what the chosen effects leave is real, the residual field of
`glider.sysid.search.residual_field` is tried in their place and on top of them.
"""

import dataclasses

import numpy as np

from glider.sysid.fit.output_error import Fit, fit
from glider.sysid.fit.whiteness import lack_of_fit
from glider.sysid.replay.problem import Problem
from glider.sysid.result import Z_SIGNIFICANT
from glider.sysid.search.beam_search import trace
from glider.sysid.search.candidates import (
    NEEDED_RATIO,
    EffectSet,
    Search,
    Weighed,
)
from glider.sysid.search.explanation import Explanation
from glider.sysid.search.free_rollout_search import explain_by_free_rollouts
from glider.sysid.search.residual_field import (
    UnexplainedField,
    find_field,
    refit_field,
    with_form_errors,
)

FIELD_RATIO = 2.0
"""Ratio of what the effects leave to what a field on top of them leaves, from which
on it is carried."""

IN_PLACE_RATIO = 4.0
"""Ratio of what the effects leave to what a field alone leaves, from which on it takes
their place."""

NEGLIGIBLE_SHARE = 0.01
"""Share of the nominal model's lack of fit below which what is left is only the error
of an effect's own form."""

FREE_ROLLOUT_DISPERSION = 1000.0
"""Mean squared error over noise variance, of the best single effect of a glider without
a nominal model, beyond which free rollouts are the criterion: its flights are then
taken to be real, a matter of centimetres, not of noise."""


def explain(search: Search) -> Explanation:
    """Traces the effects, then carries what they leave if it is real."""
    traced = trace(search, most=1)
    base, alone = traced.base, None
    is_known = search.problem.prior is None
    if not is_known and traced.chosen.fit.dispersion > FREE_ROLLOUT_DISPERSION:
        return explain_by_free_rollouts(search)
    if base.lack_of_fit.z >= Z_SIGNIFICANT and _is_real(traced.chosen, base):
        alone = find_field(search.problem, base.fit.theta, search.progress)
        in_space_or_time = alone.variables[0] in ("x", "t")
        if not (
            in_space_or_time and alone.left * IN_PLACE_RATIO**2 < traced.chosen.left
        ):
            traced = trace(search, earlier=traced)
    chosen = traced.chosen
    named = Explanation(
        fit=chosen.fit,
        weighed=traced.weighed,
        unexplained=None,
        candidates=traced.candidates,
        left_z=chosen.lack_of_fit.z,
    )
    if alone is None or not _is_real(chosen, base):
        return named
    if not chosen.kinds:
        worth = _is_worth(base, alone)
        return _carry(search, base, base, alone, named) if worth else named
    if alone.left * IN_PLACE_RATIO < chosen.left:
        return _carry(search, base, base, alone, named)
    on_top = find_field(search.problem, chosen.fit.theta, search.progress)
    if not _is_worth(chosen, on_top):
        return named
    return _carry(search, base, chosen, on_top, named)


def _is_real(chosen: EffectSet, base: EffectSet) -> bool:
    """Whether a set of effects leaves more than noise and its own form's errors."""
    negligible = NEGLIGIBLE_SHARE * base.lack_of_fit.excess
    return (
        chosen.lack_of_fit.z >= Z_SIGNIFICANT and chosen.lack_of_fit.excess > negligible
    )


def _is_worth(chosen: EffectSet, found: UnexplainedField) -> bool:
    """Whether a field cuts what is left, also on flights left out of its fit."""
    unseen = max(found.held_out_cost - found.expected_cost, 0.0)
    before = chosen.fit.cost - found.expected_cost
    return found.left * FIELD_RATIO < chosen.left and unseen * FIELD_RATIO < before


def _carry(
    search: Search,
    base: EffectSet,
    under: EffectSet,
    found: UnexplainedField,
    named: Explanation,
) -> Explanation:
    """Adds a field to a set of effects, and drops members that it makes needless."""
    kinds = under.kinds
    kept = _together(search, kinds, under.fit.theta, found)
    for kind in under.kinds:
        fewer = tuple(k for k in kinds if k != kind)
        theta = kept[0].theta.copy()
        slots = [i for i in search.free((kind,)) if i not in search.nuisance]
        theta[slots] = search.theta[slots]
        smaller = _together(search, fewer, theta, found)
        if smaller[1].left < NEEDED_RATIO * kept[1].left:
            kinds, kept = fewer, smaller
    result, field = kept
    nominal = max(base.lack_of_fit.excess, 1e-9)
    without = lack_of_fit(search.problem, result.theta)
    share = float(
        np.clip((without.excess - field.lack_of_fit.excess) / nominal, 0.0, 1.0)
    )
    nameless = Weighed(
        kind="unexplained",
        evidence=float(
            0.5 * (under.fit.cost - field.held_out_cost) / max(field.dispersion, 1.0)
        ),
        share=share,
        alternatives=(),
    )
    weighed = [w for w in named.weighed if w.kind in kinds]
    weighed.append(nameless)
    return Explanation(
        fit=result,
        weighed=tuple(sorted(weighed, key=lambda w: -w.share)),
        unexplained=with_form_errors(search.problem, result.theta, field),
        candidates=named.candidates,
        left_z=field.lack_of_fit.z,
    )


def _together(
    search: Search, kinds: tuple[str, ...], theta: np.ndarray, found: UnexplainedField
) -> tuple[Fit, UnexplainedField]:
    """Fits effects and field in turn."""
    free = search.free(kinds)
    field = found
    for _ in range(3 if free else 1):
        result = fit(_with(search.problem, field), theta, free)
        theta = result.theta
        field = refit_field(search.problem, theta, field)
    return result, field


def _with(problem: Problem, field: UnexplainedField) -> Problem:
    return dataclasses.replace(problem, field=field.field)
