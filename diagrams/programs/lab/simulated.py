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
    count: int,
    seed: int,
    show: Callable[[str], None] = print,
    scenario: Path | None = None,
) -> State:
    """Flies, traces, plans again and flies as often, into a folder.

    Launches that an earlier run flew into the folder count. The last line shown is the
    number of perches before and after.

    Args:
        folder: of the session; made if it is not there.
        truth: name or file of the simulated glider.
        count: number of launches before the correction, and after.
        seed: of launches and noise.
        show: takes lines about the session.
        scenario: file of the station's scenario.

    Returns:
        the state of the session: its answer, and launches `before` and `after`.

    Raises:
        InputError: launches, or the trace, failed.
    """
    folder.mkdir(parents=True, exist_ok=True)
    launches = Launches(
        folder=folder, truth=truth, scenario=scenario, seed=seed, count=count
    )
    session = LabSession(folder, show)
    try:
        session.update()
        _fly(session, launches, NOMINAL)
        session.finish()
        answer = session.state.answer
        if answer is None:
            refusal = session.state.traces[-1].refusal
            raise InputError(f"{folder}: there is no answer: {refusal}")
        for effect in answer.effects:
            coefficients = effect.coefficients.items()
            values = [f"{name} {e.value:.4g} ± {e.std:.2g}" for name, e in coefficients]
            show(f"{effect.kind}: {', '.join(values)}")
        if answer.effects:
            _fly(session, launches, CORRECTED)
    finally:
        session.close()
    before = "{} of {} before".format(*session.state.before)
    after = "{} of {} after".format(*session.state.after)
    show(f"Perches: {before}, {after} the correction.")
    return session.state


def _fly(session: LabSession, launches: Launches, planned: str) -> None:
    """Flies until there are so many launches planned with a model.

    Raises:
        InputError: there are fewer after some attempts.
    """
    for _ in range(_ATTEMPTS):
        missing = launches.count - session.state.count_perches(planned)[1]
        if missing <= 0:
            return
        model = session.model_file if planned == CORRECTED else None
        if launches.start(missing, model, len(session.state.throws)).wait():
            break
        session.update()
    if session.state.count_perches(planned)[1] < launches.count:
        raise InputError(
            f"{launches.folder}: not all launches were flown (see above); expected "
            f"{launches.count} with the {planned} plan."
        )
