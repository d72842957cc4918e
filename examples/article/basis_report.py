"""The exercise's answers in key figures and in words."""

from basis_dynamics import CHANNELS, BasisFit
from basis_study import BasisFits, BasisStudy
from glider.files.schema import to_builtins


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
        lines.append(f"{name} {fit.model.numbers} leave {fit.score:.2f}")
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
