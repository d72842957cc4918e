"""Two programs for one task, timed in turn."""

import dataclasses
import time
from collections.abc import Callable

import numpy as np


@dataclasses.dataclass(frozen=True, kw_only=True)
class Pair:
    """Our program and a peer's for the same task."""

    task: str
    """What both do."""

    peer: str
    """Who the peer is."""

    ours: Callable[[], object]
    """Our program."""

    theirs: Callable[[], object]
    """The peer's."""

    told: Callable[[], str]
    """What both find, in a few words; called behind both."""

    rounds: int = 11
    """How often each is timed."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Timing:
    """Median processor times [s] of a pair, and the median of their ratios."""

    ours: float
    theirs: float
    ratio: float


def time_pair(pair: Pair) -> Timing:
    """Times both in turn, so that a machine that slows down slows both.

    The first call of each, which compiles and fills caches, is not counted.
    """
    times = np.empty((pair.rounds, 2))
    for function in (pair.ours, pair.theirs):
        function()
    for row in times:
        for i, function in enumerate((pair.ours, pair.theirs)):
            begin = time.process_time()
            function()
            row[i] = time.process_time() - begin
    ours, theirs = np.median(times, axis=0).tolist()
    ratio = float(np.median(times[:, 0] / times[:, 1]))
    return Timing(ours=ours, theirs=theirs, ratio=ratio)
