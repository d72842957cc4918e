"""Time: the cameras' clock in terms of ours, and our share of the processor."""

import os

LEAK = 5e-4
"""Rate at which the least delay is forgotten [s/s]: clocks drift apart by less."""

RESTART = 0.5
"""Change of the delay that is another clock, not a delay [s]."""


class CameraClock:
    """Converts times of frames to our clock.

    The frame that came soonest shows the clocks' difference: nothing else takes the
    least latency. A clock that drifts makes it grow or shrink slowly.

    Args:
        latency: least time from exposure to reception [s].
    """

    def __init__(self, latency: float) -> None:
        self._latency = latency
        self._least: float | None = None  # Reception minus stamp.
        self._since = 0.0

    def to_ours(self, stamp: float, received: float) -> float:
        """When a frame was exposed, by our clock [s], from its stamp and reception."""
        delay = received - stamp
        if self._least is None or abs(delay - self._least) > RESTART:
            self._least = delay
        self._least = min(delay, self._least + LEAK * (received - self._since))
        self._since = received
        return stamp + self._least - self._latency


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
