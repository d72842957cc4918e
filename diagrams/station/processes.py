"""This process: its share of the processor, and its end."""

import os
import signal
from types import FrameType
from typing import Self

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Ending:
    """A context in which signals ask a loop to end, so that it leaves nothing undone.

    True once the process was asked to end; a second signal interrupts the loop.
    """

    def __init__(self) -> None:
        self._asked = False
        self._before: dict[signal.Signals, object] = {}

    def __enter__(self) -> Self:
        """Takes the signals."""
        self._before = {s: signal.signal(s, self._take) for s in SIGNALS}
        return self

    def _take(self, number: int, frame: FrameType | None) -> None:
        if self._asked:
            raise KeyboardInterrupt
        self._asked = True

    def __bool__(self) -> bool:
        """Whether the process was asked to end."""
        return self._asked

    def __exit__(self, *error: object) -> None:
        """Gives the signals back."""
        for number, handler in self._before.items():
            signal.signal(number, handler)  # type: ignore[arg-type]


def hasten() -> bool:
    """Asks for a processor at once, whatever else runs; returns whether we get it.

    Linux grants it to root, and with `ulimit -r`.
    """
    try:
        for thread in os.listdir("/proc/self/task"):  # LCM receives in one of them.
            os.sched_setscheduler(int(thread), os.SCHED_FIFO, os.sched_param(10))
    except (AttributeError, OSError):
        return False
    return True
