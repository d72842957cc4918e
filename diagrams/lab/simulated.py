"""A whole session with a simulated glider: launches before a correction, and after."""

import dataclasses
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from diagrams.lab.session import LabSession
from diagrams.lab.state import CORRECTED, NOMINAL

ATTEMPTS = 3
"""Times that launches are flown for those of which no flight came."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Launches:
    """Launches by the station, a process of its own, into a session's folder."""

    folder: Path
    truth: str  #: Name or file of the simulated glider.
    scenario: Path | None = None
    seed: int = 0

    def start(self, throws: int, model: Path | None, flown: int) -> subprocess.Popen:
        """Starts launches planned with a model, after so many that were flown."""
        options = {
            "simulate": self.truth,
            "throws": throws,
            "log": self.folder,
            "seed": self.seed + flown,
            "scenario": self.scenario,
            "model": model,
        }
        given = [f"--{name}={v}" for name, v in options.items() if v is not None]
        return subprocess.Popen([sys.executable, "-m", "glider", "fly", *given])


def run_simulated(
    session: LabSession,
    launches: Launches,
    count: int,
    show: Callable[[str], object] = print,
) -> bool:
    """Flies, traces, plans again and flies; returns whether all of it was done.

    Launches that an earlier run flew into the folder count. The last line shown is the
    number of perches before and after.
    """
    session.update()
    if not _fly(session, launches, NOMINAL, count):
        return False
    session.finish()
    answer = session.state.answer
    if answer is None:
        show(f"There is no answer: {session.state.traces[-1].refusal}")
        return False
    for effect in answer.effects:
        values = (
            f"{n} {e.value:.4g} ± {e.std:.2g}" for n, e in effect.coefficients.items()
        )
        show(f"{effect.kind}: {', '.join(values)}")
    done = not answer.effects or _fly(session, launches, CORRECTED, count)
    perches = map(session.state.count_perches, (NOMINAL, CORRECTED))
    words = (
        "{} of {} before".format(*next(perches)),
        "{} of {} after".format(*next(perches)),
    )
    show(f"Perches: {words[0]}, {words[1]} the correction.")
    return done


def _fly(session: LabSession, launches: Launches, planned: str, count: int) -> bool:
    """Flies until there are so many launches planned with a model."""
    for _ in range(ATTEMPTS):
        missing = count - session.state.count_perches(planned)[1]
        if missing <= 0:
            return True
        model = session.model_file if planned == CORRECTED else None
        if launches.start(missing, model, len(session.state.throws)).wait():
            return False
        session.update()
    return session.state.count_perches(planned)[1] >= count
