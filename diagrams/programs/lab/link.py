"""The station's bus, as a session hears it: the station's state, and a Stop."""

import threading
import time
from collections.abc import Sequence
from typing import Any

from diagrams.programs.station.bus import STATUS, Bus
from diagrams.programs.station.operators import ARM, KILL, REPEAT, Operator

PERIOD = 0.05
"""Time between two looks at the bus [s]."""

_GONE = 5 * REPEAT
"""Silence after which there is no station [s]: it says its state each REPEAT."""


class StationLink:
    """Hears what the station says, and stops every servo on its bus.

    `run` is for a thread of its own, so that neither waits for anything else. The other
    methods may be called by any thread.

    Args:
        address: of the bus.
    """

    def __init__(self, address: str) -> None:
        self.address = address
        self._bus = Bus(address)
        self._lock = threading.Lock()
        self._operator = Operator(self._bus)
        self._state = self._reason = ""
        self._heard = -_GONE
        self._bus.listen(STATUS, self._take_status)

    def stop(self) -> None:
        """Turns every servo on the bus to neutral, until `arm` is called."""
        self._say(KILL)

    def arm(self) -> None:
        """Ends our Stop, and that of a sender that is gone."""
        self._say(ARM)

    @property
    def is_stopped(self) -> bool:
        """Whether a Stop holds, ours or another's."""
        return bool(self._operator.kills)

    @property
    def state(self) -> dict[str, Any]:
        """What the station does, and why, in words; "" where there is none."""
        is_there = time.monotonic() < self._heard + _GONE
        return {
            "state": self._state if is_there else "",
            "reason": self._reason if is_there else "",
            "is_stopped": self.is_stopped,
        }

    def run(self, ended: threading.Event) -> None:
        """Listens, and repeats our Stop as long as it holds, until the end."""
        while not ended.wait(PERIOD):
            with self._lock:
                self._bus.handle()
                self._operator.repeat()

    def _say(self, name: str) -> None:
        with self._lock:
            self._operator.say(name)

    def _take_status(
        self, stamp: float, values: Sequence[float], names: Sequence[str]
    ) -> None:
        if len(names) == 2:
            self._state, self._reason = names
            self._heard = time.monotonic()
