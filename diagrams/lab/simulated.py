"""A whole session with a simulated glider: launches before a correction, and after."""

from collections.abc import Callable

from diagrams.lab.launches import Launches
from diagrams.lab.session import LabSession
from diagrams.lab.state import CORRECTED, NOMINAL

ATTEMPTS = 3
"""Times that launches are flown for those of which no flight came."""


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
