"""Time: the cameras' clock in terms of ours."""

from collections import deque

_WINDOW = 2.0
"""Time over which the soonest frame counts [s]: longer than a flight, so that no delay
in flight moves the clock. Clocks that drift by 200 ppm move by 0.4 ms meanwhile."""

AHEAD = 0.005
"""Time by which a frame may come sooner than the soonest so far [s]: a network's jitter
is 1 ms or so; at 7 m/s this is 35 mm."""


class CameraClock:
    """Converts times of frames to our clock.

    The frame that came soonest shows the clocks' difference: nothing else takes the
    least latency. Only usable frames count, and for a while only: one that is wrong is
    forgotten, and a camera that was started again is followed after as long.

    Args:
        latency: least time from exposure to reception [s].
    """

    def __init__(self, latency: float) -> None:
        self._latency = latency
        # Receptions, and receptions minus stamps: both ascend, the first is the least.
        self._delays: deque[tuple[float, float]] = deque()

    def to_ours(self, stamp: float, received: float) -> float:
        """When a frame was exposed, by our clock [s], from its stamp and reception."""
        delay = received - stamp
        while self._delays and self._delays[0][0] < received - _WINDOW:
            self._delays.popleft()
        least = self._delays[0][1] if self._delays else delay
        return stamp + least - self._latency

    def calc_lead(self, when: float, received: float) -> float:
        """Time by which a frame came sooner than the soonest so far [s]."""
        return when + self._latency - received

    def learn(self, stamp: float, received: float) -> None:
        """Takes a usable frame into account."""
        delay = received - stamp
        while self._delays and self._delays[-1][1] >= delay:
            self._delays.pop()
        self._delays.append((received, delay))
