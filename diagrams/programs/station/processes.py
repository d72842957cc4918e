"""This process: its share of the processor, and its end.

    python -m diagrams.programs.station.processes PID lab out/session

runs `glider lab out/session` until it is done, or until the process PID, which must be
the one that started it, is gone.
"""

import ctypes
import os
import runpy
import signal
import sys
from types import FrameType
from typing import Self

_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Ending:
    """A context in which signals ask a loop to end, so that it leaves nothing undone.

    True once the process was asked to end; a second signal interrupts the loop.
    """

    def __init__(self) -> None:
        self._asked = False
        self._before: dict[signal.Signals, object] = {}

    def __enter__(self) -> Self:
        """Takes the signals."""
        self._before = {s: signal.signal(s, self._take) for s in _SIGNALS}
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


_PDEATHSIG = 1
"""Linux's number of the option of prctl that names the signal of `end_with`."""


def end_with(parent: int, by: signal.Signals = signal.SIGKILL) -> None:
    """Has Linux send us a signal when our parent ends, even by kill -9.

    A process that is stopped cannot ask whether its parent still runs; this signal ends
    it too. Linux counts the end of the thread that started us as that of our parent.

    Args:
        parent: its process, as it gave it to us: one that ended before this call has
            another in its place already, and we are sent the signal at once.
        by: the signal.
    """
    prctl = getattr(ctypes.CDLL(None), "prctl", None)
    if prctl is not None:  # On Linux.
        prctl(_PDEATHSIG, int(by), 0, 0, 0)
    if os.getppid() != parent:
        os.kill(os.getpid(), by)


if __name__ == "__main__":
    end_with(int(sys.argv[1]), signal.SIGTERM)
    sys.argv = ["glider", *sys.argv[2:]]
    runpy.run_module("glider", run_name="__main__", alter_sys=True)
