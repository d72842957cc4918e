"""The hook that a glider perches with, and what it can take."""

import dataclasses

import numpy as np

from glider.physics.state import STATE_NAMES, VELOCITY

_PITCH = STATE_NAMES.index("pitch")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Hook:
    """Limits within which a glider that passes a wire is held by it.

    Where they come from is told in models/problems/perching.yaml.
    """

    reach: float = 0.05
    """Distance of the center of mass from the wire within which the hook is [m]."""

    speed_limit: float = 2.8
    """Largest speed that it stops the glider from [m/s]."""

    pitch_limits: list[float] = dataclasses.field(
        default_factory=lambda: [-1.17, -0.35]
    )
    """Pitch between which its mouth meets the wire [rad]."""

    def takes(self, miss: np.ndarray, arrivals: np.ndarray) -> np.ndarray:
        """Returns whether it holds gliders that pass the wire, (...).

        Args:
            miss: (...) least distances of the center of mass from the wire [m].
            arrivals: (..., 7 or more) the states there.
        """
        low, high = self.pitch_limits
        speed = np.linalg.norm(arrivals[..., VELOCITY], axis=-1)
        pitch = arrivals[..., _PITCH]
        is_slow = speed <= self.speed_limit
        return (miss < self.reach) & is_slow & (low <= pitch) & (pitch <= high)
