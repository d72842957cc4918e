"""Weighs the library's explanation against one that has no name.

If what the chosen effects leave is real, the residual field of
`glider.sysid.search.residual_field` is tried in their place and on top of them.
"""

import dataclasses

import numpy as np

from glider.sysid.fit.output_error import Fit, fit
from glider.sysid.fit.whiteness import lack_of_fit
from glider.sysid.replay.problem import Problem
from glider.sysid.search.beam_search import (
    SILENT,
    trace,
)
from glider.sysid.search.candidates import (
    EffectSet,
    Search,
    Weighed,
)
from glider.sysid.search.explanation import Explanation
from glider.sysid.search.free_rollout_search import explain_roughly
from glider.sysid.search.residual_field import (
    UnexplainedField,
    find_field,
    refit_field,
    with_form_errors,
)

WORTH = 2.0
"""Factor by which a field must cut what the effects leave, to be carried."""

ROUGH = 1000.0
"""Error over noise variance of an undrawn glider's best single effect, beyond which
its flights are taken to be real: a matter of centimetres, not of noise."""

IN_PLACE = 4.0
"""Factor by which a field alone must beat the effects, to take their place."""


def explain(search: Search) -> Explanation:
    """Traces the effects, then carries what they leave if it is real."""
    traced = trace(search, most=1)
    base, alone = traced.base, None
    is_drawn = search.problem.prior is None
    if not is_drawn and traced.chosen.fit.dispersion > ROUGH:
        return explain_roughly(search)
    if base.lack.z >= SILENT and _is_real(traced.chosen, base):
        alone = find_field(search.problem, base.fit.theta, search.progress)
        in_space_or_time = alone.variables[0] in ("x", "t")
        if not (in_space_or_time and _left(alone) * IN_PLACE**2 < traced.chosen.left):
            traced = trace(search, earlier=traced)
    chosen = traced.chosen
    named = Explanation(
        fit=chosen.fit,
        weighed=traced.weighed,
        unexplained=None,
        candidates=traced.candidates,
        left_z=chosen.lack.z,
    )
    if alone is None or not _is_real(chosen, base):
        return named
    if not chosen.kinds:
        worth = _is_worth(base, alone)
        return _carry(search, base, base, alone, named) if worth else named
    if _left(alone) * IN_PLACE < chosen.left:
        return _carry(search, base, base, alone, named)
    on_top = find_field(search.problem, chosen.fit.theta, search.progress)
    if not _is_worth(chosen, on_top):
        return named
    return _carry(search, base, chosen, on_top, named)


def _is_real(chosen: EffectSet, base: EffectSet) -> bool:
    """Whether a set of effects leaves more than noise and its own form's errors."""
    negligible = _NEGLIGIBLE * base.lack.excess
    return chosen.lack.z >= SILENT and chosen.lack.excess > negligible


_NEGLIGIBLE = 0.01
"""Share of the drawing's error below which a rest is only the effect's own form."""


def _left(found: UnexplainedField) -> float:
    return max(found.lack.excess, 0.0) + 2.0 * found.lack.std


def _is_worth(chosen: EffectSet, found: UnexplainedField) -> bool:
    """Whether a field cuts what is left, also on flights left out of its fit."""
    unseen = max(found.held_out_cost - found.expected_cost, 0.0)
    before = chosen.fit.cost - found.expected_cost
    return _left(found) * WORTH < chosen.left and unseen * WORTH < before


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
        if _left(smaller[1]) < 1.2 * _left(kept[1]):
            kinds, kept = fewer, smaller
    result, field = kept
    drawn = max(base.lack.excess, 1e-9)
    without = lack_of_fit(search.problem, result.theta)
    share = float(np.clip((without.excess - field.lack.excess) / drawn, 0.0, 1.0))
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
        left_z=field.lack.z,
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
