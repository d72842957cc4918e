"""The bus: its messages, and LCM below.

Every message is Drake's `lcmt_drake_signal`: numbers with names, and a time [µs].

POSE, on the cameras' clock: frame, x, z [m], pitch, elevator [rad] (NaN: not measured).
COMMAND, on the station's clock: sender, number, rate [rad/s] (NaN: to neutral) and
angle [rad] of the elevator. STATUS: number of throws and 1 if ready, with the state and
its reason for names. OPERATOR: the sender, with "kill", "arm" or "killed" for its name.
"""

import re
import socket
import struct
import time
from collections.abc import Callable, Sequence

from drake import lcmt_drake_signal
from pydrake.lcm import DrakeLcm

from glider.errors import expect

ADDRESS = re.compile(r"memq://|udpm://(\d{1,3}\.){3}\d{1,3}:\d{1,5}(\?ttl=\d+)?")
"""Addresses of LCM; of any other it makes a bus of its own, without a word."""

POSE, COMMAND, STATUS, OPERATOR = (
    f"GLIDER_{name}" for name in ("POSE", "COMMAND", "STATUS", "OPERATOR")
)
POSE_FIELDS = ("frame", "x", "z", "pitch", "elevator")
COMMAND_FIELDS = ("sender", "number", "rate", "angle")


def free_address() -> str:
    """Address of a bus between processes of this computer that no other uses."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("", 0))
        return f"udpm://239.255.76.68:{free.getsockname()[1]}?ttl=0"


_Handler = Callable[[float, Sequence[float], Sequence[str]], None]
"""Takes the time [s], the numbers and their names."""


class Bus:
    """Messages by channel.

    Args:
        lcm: LCM, or its address: udpm:// between processes, memq:// within one.

    Raises:
        InputError: the address is none.
    """

    def __init__(self, lcm: DrakeLcm | str):
        """Connects."""
        if isinstance(lcm, str):
            expected = "memq:// or such as udpm://239.255.76.67:7667?ttl=0"
            expect(ADDRESS.fullmatch(lcm), "the bus", lcm, expected)
        self._lcm = DrakeLcm(lcm) if isinstance(lcm, str) else lcm
        self.refused = 0  #: Number of messages that are none of ours.

    def say(
        self, channel: str, when: float, values: Sequence[float], names: Sequence[str]
    ) -> None:
        """Publishes numbers with names."""
        message = lcmt_drake_signal()
        message.dim = len(values)
        message.val = values
        message.coord = names
        message.timestamp = round(1e6 * when)
        self._lcm.Publish(channel, message.encode())

    def listen(self, channel: str, handler: _Handler) -> None:
        """Calls a handler with each message of a channel; others are counted."""

        def take(data: bytes) -> None:
            try:
                message = lcmt_drake_signal.decode(data)
            except (ValueError, struct.error, IndexError):
                self.refused += 1
                return
            handler(1e-6 * message.timestamp, message.val, message.coord)

        self._lcm.Subscribe(channel, take)

    def handle(self, timeout: float = 0.0) -> int:
        """Handles what has come, or waits for something [s]; returns the number.

        Of the messages of one channel that come between two calls, Drake's LCM keeps
        the first alone: what must arrive is to be repeated.
        """
        return self._lcm.HandleSubscriptions(int(1e3 * timeout))

    def rest_until(self, due: float) -> None:
        """Handles what comes, or else waits until a time of our clock [s]."""
        rest = max(due - time.monotonic(), 0.0)
        if not self.handle(rest) and rest > 0.0:  # LCM waits whole milliseconds.
            time.sleep(max(min(due - time.monotonic(), 1e-3), 0.0))
