"""A whole session with a simulated glider: launches before a correction, and after."""

from collections.abc import Callable
from pathlib import Path

from diagrams.programs.lab.launches import Launches
from diagrams.programs.lab.session import LabSession
from diagrams.programs.lab.state import CORRECTED, NOMINAL, State
from glider.errors import InputError

_ATTEMPTS = 3
"""Times that launches are flown for those of which no flight came."""


def fly_session(
    folder: Path,
    truth: str,
    launches: int,
    seed: int,
    show: Callable[[str], None] = print,
) -> State:
    """Flies a session with a simulated glider into a folder, which it goes on with.

    Args:
        folder: of the session; made if it is not there.
        truth: name or file of the simulated glider.
        launches: number of them before the correction, and after.
        seed: of launches and noise.
        show: takes lines about the session.

    Returns:
        the state of the session: its answer, and launches `before` and `after`.

    Raises:
        InputError: launches, or the trace, failed.
    """
    folder.mkdir(parents=True, exist_ok=True)
    session = LabSession(folder, show)
    station = Launches(folder=folder, truth=truth, seed=seed)
    try:
        is_complete = run_simulated(session, station, launches, show)
    finally:
        session.close()
    if not is_complete:
        raise InputError(f"{folder}: the session was not completed; see above.")
    return session.state


def run_simulated(
    session: LabSession,
    launches: Launches,
    count: int,
    show: Callable[[str], None] = print,
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
    perches = session.state.before, session.state.after
    words = (
        "{} of {} before".format(*perches[0]),
        "{} of {} after".format(*perches[1]),
    )
    show(f"Perches: {words[0]}, {words[1]} the correction.")
    return done


def _fly(session: LabSession, launches: Launches, planned: str, count: int) -> bool:
    """Flies until there are so many launches planned with a model."""
    for _ in range(_ATTEMPTS):
        missing = count - session.state.count_perches(planned)[1]
        if missing <= 0:
            return True
        model = session.model_file if planned == CORRECTED else None
        if launches.start(missing, model, len(session.state.throws)).wait():
            return False
        session.update()
    return session.state.count_perches(planned)[1] >= count
