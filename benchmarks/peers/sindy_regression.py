"""pysindy's sparse regressions on the article's identification exercise.

Both choose three features for each of three targets, of the same columns.
"""

import numpy as np

from basis_model import (
    CONSISTENT,
    FEATURES,
    best_subset,
    feature_columns,
    fly_exercise,
    plane_accelerations,
)
from benchmarks.peers.pairs import Pair

TERMS = 3


def pairs() -> tuple[Pair, ...]:
    """Returns the article's 20 features."""
    import pysindy

    states, rates = fly_exercise()
    columns = feature_columns(states[1:], rates[1:], list(FEATURES), CONSISTENT)
    targets = [own.ravel() for own in plane_accelerations(states[1:], CONSISTENT)]
    scaled = columns / np.linalg.norm(columns, axis=0)
    left: dict[str, float] = {}

    def error_of(few, target) -> float:
        beta, *_ = np.linalg.lstsq(columns[:, few], target, rcond=None)
        return float(np.sum((target - columns[:, few] @ beta) ** 2))

    def ours():
        left["ours"] = 0.0
        for target in targets:
            few = list(best_subset(columns, target, TERMS))
            left["ours"] += error_of(few, target)

    def theirs():
        left["theirs"] = 0.0
        for target in targets:
            greedy = pysindy.FROLS(max_iter=TERMS, alpha=1e-12)
            greedy.fit(scaled, target[:, None])
            left["theirs"] += error_of(np.flatnonzero(greedy.coef_[0]), target)

    return (
        Pair(
            task=f"best {TERMS} of the article's {len(FEATURES)} features, 3 targets",
            peer="pysindy's FROLS (greedy; ours looks at all)",
            ours=ours,
            theirs=theirs,
            told=lambda: f"squared error {left['ours']:.3g} and {left['theirs']:.3g}",
        ),
    )
