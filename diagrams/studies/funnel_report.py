"""A report of what funnels promise and keep, in numbers and in words."""

import numpy as np

from diagrams.studies.funnel_estimate import describe_estimates, estimate_figures
from diagrams.studies.funnel_study import WORDS, FunnelComparison, FunnelStudy
from glider.physics.state import STATE_NAMES
from glider.verification.check_report import describe_proof, remainder_status
from glider.verification.dynamics.confidence import describe_set


def key_figures(found: FunnelComparison) -> dict[str, object]:
    """Returns the figures of the nominal and the corrected model, and of the flights.

    The keys are read by other programs. Escapes of the true glider are null where its
    states are not the funnel's.
    """
    figures = figures_of(found.nominal)
    figures["corrected"] = figures_of(found.corrected)
    for name, study in found.studies.items():
        flown = study.on_truth
        figures[f"{name}_on_truth_escapes"] = flown and flown.escapes
        figures[f"{name}_on_truth_samples"] = flown and flown.samples
    if found.estimated:
        figures["estimate"] = estimate_figures(found.estimated)
    return figures


def figures_of(study: FunnelStudy) -> dict[str, object]:
    """Returns the key figures of a funnel: inlet, check, escapes, proof of remainder.

    The keys are read by other programs.

    The inlet is given by the half-widths of its slices: how far one state alone may
    deviate at the launch.
    """
    funnel, proof = study.funnel, study.proof
    widths = dict(zip(STATE_NAMES, funnel.half_widths(), strict=False))
    return {
        "inlet": {
            "z_m": float(widths["z"]),
            "x_m": float(widths["x"]),
            "pitch_deg": float(np.degrees(widths["pitch"])),
            "xdot": float(widths["xdot"]),
            "zdot": float(widths["zdot"]),
        },
        "seconds": funnel.seconds,
        "samples": study.falsification.samples,
        "escapes": study.falsification.escapes,
        "largest_end": float(study.falsification.ends.max()),
        "goal": list(funnel.settings.goal_axes(funnel.num_states)),
        "states": list(funnel.nominal.state_names),
        "effects": [effect.kind.kind for effect in funnel.nominal.model.effects],
        "remainder": remainder_status(funnel, proof),
        "remainder_inflation": funnel.settings.remainder,
        "remainder_proof": describe_proof(funnel, proof) if proof else None,
        "every_flight": bool(study.verdict.holds and proof and proof.is_whole),
        "solver": funnel.solver,
        "certificate_checked": study.verdict.holds,
        "checked_times": study.verdict.times,
        "faults": list(study.verdict.faults),
        "made_for": funnel.gliders and describe_set(funnel.gliders.confidence),
        "on_set_samples": study.on_set and study.on_set.samples,
        "on_set_escapes": study.on_set and study.on_set.escapes,
    }


def describe(found: FunnelComparison, truth: str) -> str:
    """Returns a few sentences about both funnels, and about flights on an estimate.

    Args:
        found: the funnels.
        truth: what the true glider is called.
    """
    lines = [
        f"{_describe(WORDS[name], study)}\n  Flown by {truth}, {_words(study)}."
        for name, study in found.studies.items()
    ]
    if found.estimated:
        lines.append(
            f"{WORDS['drawn']}, on an estimate:\n{describe_estimates(found.estimated)}"
        )
    return "\n".join(lines)


def _describe(name: str, study: FunnelStudy) -> str:
    widths = dict(zip(STATE_NAMES, study.funnel.half_widths(), strict=False))
    verdict, flown, proof = study.verdict, study.falsification, study.proof
    checked = "holds" if verdict.holds else "DOES NOT HOLD"
    return (
        f"{name}: a launch may err by {100 * widths['z']:.1f} cm in height, "
        f"{np.degrees(widths['pitch']):.1f}° in pitch or {widths['xdot']:.2f} m/s in "
        f"speed ({study.funnel.seconds:.0f} s; remainder: "
        f"{remainder_status(study.funnel, proof)}).\n"
        f"  Its certificate {checked} at {verdict.times} of {verdict.of_times} "
        f"times; {flown.escapes} of {flown.samples} flights from its boundary leave it."
        + (f"\n  {describe_proof(study.funnel, proof)}" if proof else "")
        + _describe_gliders(study)
    )


def _describe_gliders(study: FunnelStudy) -> str:
    gliders, flown = study.funnel.gliders, study.on_set
    if gliders is None or flown is None:
        return ""
    return (
        f"\n  It was made for the gliders of a {describe_set(gliders.confidence)}: "
        f"{flown.escapes} of their {flown.samples} flights from its boundary leave it."
    )


def _words(study: FunnelStudy) -> str:
    if flown := study.on_truth:
        return f"{flown.escapes} of {flown.samples} flights leave it"
    return "it has no meaning: their states differ"
