"""The bus: what is said on it, and LCM under it.

Every message is Drake's `lcmt_drake_signal`: numbers with names, and a time [µs].

POSE, on the cameras' clock: frame, x, z [m], pitch, elevator [rad] (NaN: not measured).
COMMAND, on the station's clock: sender, number, rate [rad/s] and angle [rad] of the
elevator. STATUS: number of the throw, with the station's state and its reason for
names. OPERATOR: "kill" or "arm" for a name.
"""

import struct
import time
from collections.abc import Callable, Sequence

from drake import lcmt_drake_signal
from pydrake.lcm import DrakeLcm

POSE, COMMAND, STATUS, OPERATOR = (
    f"GLIDER_{name}" for name in ("POSE", "COMMAND", "STATUS", "OPERATOR")
)
POSE_FIELDS = ("frame", "x", "z", "pitch", "elevator")
COMMAND_FIELDS = ("sender", "number", "rate", "angle")

Handler = Callable[[float, Sequence[float], Sequence[str]], None]
"""Takes the time [s], the numbers and their names."""


class Bus:
    """Messages by channel.

    Args:
        lcm: LCM, or its address: udpm:// between processes, memq:// within one.
    """

    def __init__(self, lcm: DrakeLcm | str):
        """Connects."""
        self._lcm = DrakeLcm(lcm) if isinstance(lcm, str) else lcm
        self.refused = 0  #: Messages that were none of ours.

    def say(
        self, channel: str, when: float, values: Sequence[float], names: Sequence[str]
    ) -> None:
        """Publishes numbers with names."""
        message = lcmt_drake_signal()
        message.dim, message.val, message.coord = len(values), values, names
        message.timestamp = round(1e6 * when)
        self._lcm.Publish(channel, message.encode())

    def listen(self, channel: str, handler: Handler) -> None:
        """Calls a handler with each message of a channel; what is none is counted."""

        def take(data: bytes) -> None:
            try:
                message = lcmt_drake_signal.decode(data)
            except (ValueError, struct.error, IndexError):
                self.refused += 1
                return
            handler(1e-6 * message.timestamp, message.val, message.coord)

        self._lcm.Subscribe(channel, take)

    def handle(self, timeout: float = 0.0) -> int:
        """Handles what has come, or waits for something [s]; returns the number."""
        return self._lcm.HandleSubscriptions(int(1e3 * timeout))

    def rest_until(self, due: float) -> None:
        """Handles what comes, or else waits until a time of our clock [s]."""
        rest = max(due - time.monotonic(), 0.0)
        if not self.handle(rest) and rest > 0.0:  # LCM waits whole milliseconds.
            time.sleep(max(min(due - time.monotonic(), 1e-3), 0.0))
