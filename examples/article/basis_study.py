"""The exercise's answers: its configurations and its best subsets, fitted and flown."""

import dataclasses
from collections.abc import Mapping

import numpy as np

from basis_choice import candidates_of, cross_validate
from basis_dynamics import (
    CHANNELS,
    BasisDynamics,
    BasisFit,
    best_numbers,
    fit_basis,
    fly_again,
)
from basis_exercise import Exercise
from basis_features import FEATURES, PAPER
from basis_refinement import RolloutError, refine, rollout_error
from glider.campaign.turning import Signs
from glider.files.schema import to_builtins
from glider.sysid.result import Result

SIGNS = {"published_signs": "nose_up", "consistent_signs": "nose_down"}
"""Ways in which the formulas take the flights' angles; they are nose down."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class BasisFits:
    """Models of a few features each, fitted."""

    configurations: dict[str, dict[str, BasisFit]]
    """Fits of the exercise's configurations, by SIGNS and name."""

    subsets: dict[str, BasisFit]
    """Fits of the best subsets, by name."""

    @property
    def models(self) -> dict[str, BasisDynamics]:
        """Configuration 6, the best of them, with either signs; then the subsets."""
        models = {
            f"configuration 6 {signs.replace('_', ' ')}": fits["6"].model
            for signs, fits in self.configurations.items()
        }
        return models | {n.replace("_", " "): f.model for n, f in self.subsets.items()}


@dataclasses.dataclass(frozen=True, kw_only=True)
class BasisStudy:
    """All answers to the exercise."""

    exercise: Exercise
    """Flights that were given."""

    fits: BasisFits
    """Models of their accelerations."""

    choice: dict[str, dict[str, float]]
    """Errors of candidates on held-out flights, by SIGNS and name."""

    signs: Signs
    """Signs in the exercise's own numbers as a log."""

    traced: Result
    """Findings of the tracer in its flights filmed."""

    rollouts: dict[str, dict[str, RolloutError]]
    """Errors on the held-out flight "before" and "after" refinement, by model."""

    @property
    def flown(self) -> dict[str, np.ndarray]:
        """States (N + 1, 7) of the held-out flight, by the model that flies it."""
        return {
            name: fly_again(model, self.exercise.held_out)[0]
            for name, model in self.fits.models.items()
        }


def fit_all(exercise: Exercise, ridge: float = 0.0) -> BasisFits:
    """Fits the configurations and the best subsets."""
    return BasisFits(
        configurations=fit_configurations(exercise, ridge),
        subsets=fit_subsets(exercise, ridge),
    )


def fit_configurations(
    exercise: Exercise, ridge: float = 0.0
) -> dict[str, dict[str, BasisFit]]:
    """Returns the exercise's configurations fitted, by SIGNS and name."""
    return {
        signs: {
            name: fit_basis(exercise.fitted, exercise.frame(angles), numbers, ridge)
            for name, numbers in exercise.configurations.items()
        }
        for signs, angles in SIGNS.items()
    }


def fit_subsets(exercise: Exercise, ridge: float = 0.0) -> dict[str, BasisFit]:
    """Returns the best subsets of the paper's features and of all, fitted.

    The search takes no ridge; signs are consistent.
    """
    fitted, frame = exercise.fitted, exercise.frame("nose_down")
    given = {"best_subsets": tuple(PAPER), "best_subsets_of_41": tuple(FEATURES)}
    chosen = {name: best_numbers(fitted, frame, of) for name, of in given.items()}
    return {
        name: fit_basis(fitted, frame, numbers, ridge)
        for name, numbers in chosen.items()
    }


def validate(exercise: Exercise, ridge: float = 0.0) -> dict[str, dict[str, float]]:
    """Returns the errors of `cross_validate`, by SIGNS and candidate."""
    errors = {}
    for signs, angles in SIGNS.items():
        frame = exercise.frame(angles)
        candidates = candidates_of(frame, exercise.configurations)
        errors[signs] = cross_validate(exercise.fitted, frame, candidates, ridge=ridge)
    return errors


def refinements(
    exercise: Exercise, models: Mapping[str, BasisDynamics]
) -> dict[str, dict[str, RolloutError]]:
    """Returns errors on the held-out flight "before" and "after" `refine`, by model."""
    errors = {}
    for name, model in models.items():
        pair = {"before": model, "after": refine(model, exercise.fitted)}
        errors[name] = {
            when: rollout_error(refined, exercise.held_out)
            for when, refined in pair.items()
        }
    return errors


def key_figures(study: BasisStudy) -> dict[str, object]:
    """Returns all answers, for a file."""
    fits, subsets = study.fits.configurations, study.fits.subsets
    return {
        "scores": scores_of(study.fits),
        "regressions": {
            **{s: {n: _channels(fit) for n, fit in f.items()} for s, f in fits.items()},
            **{name: _channels(fit) for name, fit in subsets.items()},
        },
        **{name: _subset(fit) for name, fit in subsets.items()},
        "cross_validation": {
            signs: {name: to_builtins(error) for name, error in errors.items()}
            for signs, errors in study.choice.items()
        },
        "signs": vars(study.signs),
        "traced": {
            effect.kind: {"share": effect.share_of_residual}
            for effect in study.traced.effects
        },
        "rollout": {
            name: {when: vars(error) for when, error in errors.items()}
            for name, errors in study.rollouts.items()
        },
        "held_out_end": next(iter(study.flown.values()))[-1, :3].tolist(),
    }


def scores_of(fits: BasisFits) -> dict[str, dict[str, int]]:
    """Returns the configurations' scores by signs, as published."""
    return {
        signs: {name: int(fit.score) for name, fit in fitted.items()}
        for signs, fitted in fits.configurations.items()
    }


def _subset(fit: BasisFit) -> dict[str, object]:
    numbers = zip(CHANNELS, fit.model.numbers, strict=True)
    return {"total": fit.score, **dict(numbers)}


def _channels(fit: BasisFit) -> dict[str, dict]:
    return {
        channel: {"rank": found.rank, "condition": to_builtins(found.condition)}
        for channel, found in zip(CHANNELS, fit.regressions, strict=True)
    }


def describe(study: BasisStudy) -> str:
    """Returns scores, choice, trace and refinement, a line each."""
    scores = scores_of(study.fits)
    lines = [f"{signs} leave {left}" for signs, left in scores.items()]
    for name, fit in study.fits.subsets.items():
        chosen = (
            f"{channel} {', '.join(FEATURES[k][0] for k in numbers)}"
            for channel, numbers in zip(CHANNELS, fit.model.numbers, strict=True)
        )
        lines.append(f"{name} leave {fit.score:.2f}: {'; '.join(chosen)}")
    for signs, errors in study.choice.items():
        best = min(errors, key=errors.__getitem__)
        lines.append(
            f"{signs}: held-out flights choose '{best}', {errors[best]:.4f} off"
        )
    found, traced = study.signs, (effect.kind for effect in study.traced.effects)
    lines.append(
        f"logged as published, pitch, elevator and command have signs {found.pitch}, "
        f"{found.elevator}, {found.command}; the tracer names {', '.join(traced)}"
    )
    for name, pair in study.rollouts.items():
        before, after = (error.weighted for error in pair.values())
        lines.append(f"{name}: held-out rollout {before:.4f}, refined {after:.4f}")
    return "\n".join(lines)
