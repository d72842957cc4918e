"""Motion capture as an instrument: its rate and its noise.

Simulated flights and estimators have the same one.
"""

import dataclasses
import math

import numpy as np

from glider.errors import expect


@dataclasses.dataclass(frozen=True, kw_only=True)
class MotionCapture:
    """Cameras that see the pose, and a sensor of the elevator's angle.

    The defaults are those of the practice campaigns.

    Attributes:
        rate: of the samples [Hz].
        position: standard deviation of a measured x and z [m].
        pitch: standard deviation of a measured pitch [rad].
        elevator: standard deviation of a measured elevator angle [rad].
    """

    rate: float = 120.0
    position: float = 0.0004
    pitch: float = 0.0025
    elevator: float = 0.005

    def __post_init__(self):
        """Raises InputError where a number cannot be."""
        for name, value in vars(self).items():
            fits = 0.0 <= value < math.inf
            least = "not negative"
            if name == "rate":
                fits = 0.0 < value < math.inf
                least = "positive"
            expect(fits, f"MotionCapture: '{name}'", value, f"a finite number, {least}")

    @property
    def std(self) -> np.ndarray:
        """Standard deviations of x, z, pitch and elevator, shape (4,) [m, rad]."""
        return np.array([self.position, self.position, self.pitch, self.elevator])

    def draw(self, rng: np.random.Generator, *shape: int) -> np.ndarray:
        """Draws the noise of samples of any shape.

        Returns:
            Errors of x, z, pitch and elevator, (*shape, 4) [m, rad].
        """
        return rng.normal(size=(*shape, 4)) * self.std
