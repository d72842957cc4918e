"""The figure of what filters come to know in flight."""

from collections.abc import Mapping
from pathlib import Path

from glider.studies.filter_study import Watched
from glider.studies.plots.knowledge import (
    Knowledge,
    save_knowledge_figure,
)

LABELS = ("wing offset l_w [m]", "elevator area S_e [m²]")
SHOWN = 1.0
"""Of each flight [s]; afterwards a cruise tells little more."""


def save_study_figure(
    path: Path, drifting: Mapping[str, Watched], constant: Mapping[str, Watched]
) -> None:
    """Saves estimates and deviations of the flights of `watch_all`.

    Args:
        path: of the picture.
        drifting: where the filter lets the numbers drift.
        constant: where it takes them for constants.
    """
    cases = [[_known(*item) for item in case.items()] for case in (drifting, constant)]
    save_knowledge_figure(path, LABELS, *cases)


def _known(name: str, watched: Watched) -> Knowledge:
    kept = watched.flight.times <= SHOWN
    return Knowledge(
        name=name,
        times=watched.flight.times[kept],
        means=watched.slow[kept],
        stds=watched.std[kept],
        bounds=watched.bound[kept],
        truth=watched.truth,
    )
