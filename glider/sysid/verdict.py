"""The verdict: is what was found to be believed?"""

from collections.abc import Mapping, Sequence

import numpy as np

from glider.sysid.fit.folds import LEAST_T, WORSE, HeldOut, ratio_of
from glider.sysid.likelihood.model_fit import FitResult
from glider.sysid.outcome import ResidualCurves
from glider.sysid.replay.signs import Signs
from glider.sysid.replay.vehicle import OWN_KINDS
from glider.sysid.result import Errors, FoundEffect, Residual
from glider.sysid.search.traced import SearchResult

AllErrors = Mapping[str, Errors | None]
"""Model to its errors on flights that it was not fitted to."""


def judge(
    traced: SearchResult,
    signs: Signs,
    carried: ResidualCurves,
    held_out: HeldOut | None,
    errors: AllErrors,
    effects: tuple[FoundEffect, ...],
    left: Residual,
    doubt: str | None,
) -> tuple[str, str]:
    """Returns the verdict and the sentence that says why.

    Args:
        traced: what was found.
        signs: of the angles.
        carried: curves of the model.
        held_out: what folds say, or None.
        errors: of unseen flights, by model.
        effects: as reported.
        left: what the model leaves.
        doubt: why the model is not to be believed, see
            `glider.sysid.plausibility.find_doubt`, or None.
    """
    model = traced.model
    nothing = not model.kinds and traced.field is None and not carried.terms
    if nothing and signs.are_right:
        if traced.forces is not None and left.depends_on:
            return "unexplained", (
                "What the plate lacks depends on "
                f"{', '.join(left.depends_on)}, and no effect holds."
            )
        return "no_effect", "Nothing that the flights show beyond noise and air."
    if doubt is not None:
        return "not_trusted", f"What is left to chance is too much: {doubt}."
    doubt, as_plate = _over_plate(held_out, errors), False
    if doubt and held_out is not None and held_out.t_over_nominal is not None:
        doubt, as_plate = (
            _over_nominal(held_out.t_over_nominal, held_out.t, errors),
            True,
        )
    if doubt is not None:
        return "not_trusted", doubt
    unnamed = [e for e in effects if e.kind == "unexplained"]
    if unnamed and not (model.kinds or not signs.are_right):
        return "unexplained", "What the plate lacks has no name in the library."
    if unnamed:
        return "partly_explained", "Part of what the plate lacks has no name."
    if any(not e.shape_fits for e in effects):
        return "effect_found", (
            "The effects have names; where a shape is not the library's, a curve is "
            "carried."
        )
    if as_plate:
        return "effect_found", (
            "The effects have names and hold on held-out flights: the glider is "
            "another than it was drawn, and its plate, refitted, does about as well."
        )
    return "effect_found", "The effects have names and hold on held-out flights."


def is_of_the_plate(model: FitResult) -> bool:
    """Whether all that a model names is another value of the plate's own numbers.

    The refitted plate has it too and may leave it nothing to gain: then it is held
    against the nominal model.
    """
    bare = model.extra is None and not model.has_curves
    return bool(model.kinds) and bare and set(model.kinds) <= set(OWN_KINDS)


def _over_plate(held_out: HeldOut | None, errors: AllErrors) -> str | None:
    """Returns why a correction does not hold against the refitted plate, or None."""
    if held_out is not None and held_out.t < LEAST_T:
        return _NO_GAIN.format(over="refitted plate", t=held_out.t)
    ratios = [
        _ratios(errors, "refitted"),
        *([] if held_out is None else [held_out.ratios]),
    ]
    return _worse(list(np.max(ratios, axis=0)), "refitted plate")


def _over_nominal(t: float, t_over_plate: float, errors: AllErrors) -> str | None:
    """Returns why the plate's own numbers do not hold as they were found, or None.

    Args:
        t: of the gain over the nominal model.
        t_over_plate: of the gain over the plate with all of its numbers refitted.
        errors: of unseen flights, by model.
    """
    if t < LEAST_T:
        return _NO_GAIN.format(over="nominal model", t=t)
    if t_over_plate < -LEAST_T:
        return _NO_GAIN.format(over="refitted plate: it loses", t=t_over_plate)
    free, _ = _ratios(errors, "nominal")  # Along the pitch, turning tells nothing.
    return _worse([free], "nominal model")


_NO_GAIN = (
    "On flights held out in folds the correction does not gain significantly over the "
    "{over} (t = {t:.1f})."
)


def _worse(ratios: Sequence[float], than: str) -> str | None:
    """Returns that a correction makes unseen flights worse, where it does.

    Args:
        ratios: of errors, in the order of FLOWN, as many as count.
        than: what they are worse than.
    """
    for words, worse, ratio in zip(FLOWN, WORSE, ratios, strict=False):
        if ratio > worse:
            return (
                "The correction makes flights that it was not fitted to worse: "
                f"{words} {ratio:.4g} times the error of the {than}."
            )
    return None


FLOWN = "flown freely", "along the measured pitch"


def _ratios(errors: AllErrors, model: str) -> tuple[float, float]:
    """Returns the corrected model's errors by another's, as FLOWN."""
    before, after = errors[model], errors["corrected"]
    assert before is not None and after is not None
    return (
        ratio_of(before.position_rms_m, after.position_rms_m),
        ratio_of(
            before.measured_pitch_position_rms_m, after.measured_pitch_position_rms_m
        ),
    )
