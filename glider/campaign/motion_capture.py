"""Motion capture as an instrument: its rate and its noise."""

import dataclasses
import math

import numpy as np

from glider.errors import expect


@dataclasses.dataclass(frozen=True, kw_only=True)
class MotionCapture:
    """Cameras that see the pose, and a sensor of the elevator's angle.

    The defaults are those of the practice campaigns.
    """

    rate: float = 120.0  #: Of the samples [Hz].
    position: float = 0.0004  #: Standard deviation of a measured x and z [m].
    pitch: float = 0.0025  #: Standard deviation of a measured pitch [rad].
    elevator: float = 0.005  #: Standard deviation of a measured elevator angle [rad].

    def __post_init__(self):
        """Raises InputError where a number cannot be."""
        for name, value in vars(self).items():
            least = "positive" if name == "rate" else "not negative"
            fits = value > 0.0 if name == "rate" else value >= 0.0
            what = f"MotionCapture: '{name}'"
            expected = f"a finite number, {least}"
            expect(fits and math.isfinite(value), what, value, expected)

    @property
    def std(self) -> np.ndarray:
        """Standard deviations of x, z, pitch and elevator, shape (4,) [m, rad]."""
        return np.array([self.position, self.position, self.pitch, self.elevator])

    def draw(self, rng: np.random.Generator, *shape: int) -> np.ndarray:
        """Draws noise of samples, (*shape, 4) [m, rad]."""
        return rng.normal(size=(*shape, 4)) * self.std
