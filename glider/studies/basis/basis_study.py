"""The exercise's answers: its configurations and its best subsets, fitted and flown."""

from collections.abc import Mapping

from glider.studies.basis.basis_choice import (
    candidates_of,
    cross_validate,
)
from glider.studies.basis.basis_exercise import Exercise
from glider.studies.basis.basis_features import (
    FEATURES,
    PAPER,
)
from glider.studies.basis.basis_model import (
    BasisDynamics,
    BasisFit,
    best_numbers,
    fit_basis,
)
from glider.studies.basis.basis_refinement import (
    RolloutError,
    refine,
    rollout_error,
)

SIGNS = {"published_signs": "nose_up", "consistent_signs": "nose_down"}
"""What the formulas take the flights' angles for; they are nose down."""


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
