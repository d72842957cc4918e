"""pysindy's sparse regressions on the article's identification exercise.

Both choose three features for each of three targets, of the same columns.
"""

import numpy as np

from basis_dynamics import plane_accelerations, sampled_features
from basis_exercise import load_exercise
from basis_features import FEATURES, PAPER
from benchmarks.peers.pairs import Pair
from regression import best_subsets, least_squares

TERMS = 3


def pairs() -> tuple[Pair, ...]:
    """Returns the article's 20 features, and all 41."""
    import pysindy

    exercise = load_exercise()
    flights, frame = exercise.fitted, exercise.frame("nose_down")
    targets = plane_accelerations(flights, frame)

    def pair(name: str, features: tuple[int, ...]) -> Pair:
        columns = sampled_features(flights, frame, features)
        scaled = columns / np.linalg.norm(columns, axis=0)
        left: dict[str, float] = {}

        def ours():
            found = best_subsets(columns, targets, TERMS)
            left["ours"] = sum(float(s.regression.squared_error) for s in found)

        def theirs():
            total = 0.0
            for target in targets.T:
                greedy = pysindy.FROLS(max_iter=TERMS, alpha=1e-12)
                greedy.fit(scaled, target[:, None])
                few = np.flatnonzero(greedy.coef_[0])
                total += float(least_squares(columns[:, few], target).squared_error)
            left["theirs"] = total

        return Pair(
            task=f"best {TERMS} of {name} {len(features)} features, 3 targets",
            peer="pysindy's FROLS (greedy; ours looks at all)",
            ours=ours,
            theirs=theirs,
            told=lambda: f"squared error {left['ours']:.3g} and {left['theirs']:.3g}",
        )

    return pair("the article's", tuple(PAPER)), pair("all", tuple(FEATURES))
