"""A report of what a funnel promises and keeps, in numbers and in words."""

import numpy as np

from glider.physics.state import STATE_NAMES
from glider.verification.funnel.funnel import Funnel
from glider.verification.proof.check import Verdict
from glider.verification.proof.remainder_proof import (
    RemainderProof,
    describe_proof,
    remainder_status,
)
from glider.verification.trials.falsify import Falsification


def figures_of(
    funnel: Funnel,
    verdict: Verdict,
    falsification: Falsification,
    proof: RemainderProof | None = None,
) -> dict:
    """Returns the key figures of a funnel: inlet, check, escapes, proof of remainder.

    The keys are read by other programs.

    The inlet is given by the half-widths of its slices: how far one state alone may
    deviate at the launch.
    """
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
        "samples": falsification.samples,
        "escapes": falsification.escapes,
        "largest_end": float(falsification.ends.max()),
        "goal": list(funnel.settings.goal_axes(funnel.num_states)),
        "states": list(funnel.nominal.state_names),
        "effects": [effect.kind.kind for effect in funnel.nominal.model.effects],
        "remainder": remainder_status(funnel, proof),
        "remainder_inflation": funnel.settings.remainder,
        "remainder_proof": describe_proof(funnel, proof) if proof else None,
        "solver": funnel.solver,
        "certificate_checked": verdict.holds,
        "checked_times": verdict.times,
        "faults": list(verdict.faults),
    }


def describe(name: str, figures: dict) -> str:
    """Returns a few sentences about the figures of a funnel."""
    inlet = figures["inlet"]
    checked = "holds" if figures["certificate_checked"] else "DOES NOT HOLD"
    return (
        f"{name}: a launch may err by {100 * inlet['z_m']:.1f} cm in height, "
        f"{inlet['pitch_deg']:.1f}° in pitch or {inlet['xdot']:.2f} m/s in speed "
        f"({figures['seconds']:.0f} s; remainder: {figures['remainder']}).\n"
        f"  Its certificate {checked} at {figures['checked_times']} times; "
        f"{figures['escapes']} of {figures['samples']} flights from its boundary "
        "leave it."
        + (f"\n  {figures['remainder_proof']}" if figures["remainder_proof"] else "")
    )
