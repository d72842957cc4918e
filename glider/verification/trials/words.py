"""What flights of the gliders that the data allow have shown, in words and as JSON."""

from typing import Any

import numpy as np

from glider.verification.dynamics.confidence import ConfidenceSet, describe_set
from glider.verification.funnel.funnel import Funnel
from glider.verification.trials.falsify import Falsification


def trial_report(
    funnel: Funnel, confidence: ConfidenceSet, trial: Falsification, seed: int
) -> dict[str, Any]:
    """Returns the outcome of `falsify_set` as it is written to JSON."""
    worst = _worst(trial)
    assert trial.deviations is not None
    return {
        "names": list(confidence.names),
        "level": confidence.level,
        "shape": confidence.shape,
        "half_widths": confidence.reach(np.eye(len(confidence.names))).tolist(),
        "funnel_was_made_for_them": _made_for(funnel, trial),
        "flights": trial.samples,
        "escapes": trial.escapes,
        "largest_level": float(trial.levels.max()),
        "largest_later_level": float(trial.later.max()),
        "largest_end_level": float(trial.ends.max()),
        "worst_deviation": trial.deviations[worst].tolist(),
        "worst_start_time": float(trial.starts[worst]),
        "seed": seed,
    }


def describe_trial(
    funnel: Funnel, confidence: ConfidenceSet, trial: Falsification, seed: int
) -> str:
    """Returns the outcome of `falsify_set` in sentences, one a line."""
    whose = "its own center" if funnel.gliders else "the nominal, which does not move"
    worst = _worst(trial)
    assert trial.deviations is not None
    deviates = ", ".join(
        f"{name} {value:+.2g}"
        for name, value in zip(confidence.names, trial.deviations[worst], strict=True)
    )
    made = {
        None: "The funnel was made for one glider, not for these",
        True: "The funnel was made for these",
        False: "The funnel was made for a smaller set than these",
    }[_made_for(funnel, trial)]
    return (
        f"Gliders that the data allow, {describe_set(confidence)}, V about {whose}: "
        f"{trial.escapes} of {trial.samples:,} flights from the boundary leave it "
        f"(seed {seed}).\n"
        f"The largest V/rho after a start is {trial.later.max():.4f}, at the end "
        f"{trial.ends.max():.4f}; the worst glider has {deviates or 'nothing else'}, "
        f"from {trial.starts[worst]:.3f} s. {made}; by flights nothing is proven."
    )


def _worst(trial):
    """Returns the index of the worst flight: the largest V after its start."""
    return int(np.argmax(trial.later))


def _made_for(funnel, trial):
    """Returns whether all flown gliders are in the funnel's set; None without one."""
    if not funnel.gliders:
        return None
    return bool(np.all(funnel.gliders.confidence.holds(trial.deviations)))
