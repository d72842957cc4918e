"""What a funnel is asked for."""

import dataclasses
import math

import numpy as np

from glider.errors import InputError
from glider.physics.state import (
    NUM_STATES,
    STATE_NAMES,
)


@dataclasses.dataclass(frozen=True, kw_only=True)
class FunnelSettings:
    """The goal at the wire and how the funnel towards it is computed."""

    goal: tuple[float, ...] = (0.05, 0.05, 0.5, 0.39, 0.82, 0.82, 2.0)
    """Half-axes of the goal ellipsoid about the nominal's end, in the order of
    STATE_NAMES [m, rad, m/s, rad/s]. A perch bears 5 cm; the speeds are chosen so
    that the Taylor polynomial still fits there."""

    goal_extra: float = 4.0
    """The same of the effects' own states, in their units."""

    sizes: tuple[float, ...] = (0.05, 0.05, 0.15, 0.3, 0.3, 0.3, 1.0)
    """Deviations that matter alike, in the order of STATE_NAMES: what the shape of
    the funnel trades against each other."""

    sizes_extra: float = 2.0
    """The same of the effects' own states."""

    step: float = 0.0045
    """Longest step between the times that are certified [s]."""

    hold: float = 0.022
    """Between the programs that shape the funnel [s]."""

    margin: float = 0.03
    """By which V̇/V stays below zero on the boundary [1/s]."""

    remainder: float = 0.0
    """How many times the largest Taylor remainder that is found acts as a disturbance;
    0 for a funnel of the Taylor polynomial alone. With 1.1 it can be proven."""

    def __post_init__(self):
        """Raises InputError where a setting makes no sense."""
        for name in ("goal", "sizes"):
            values = np.asarray(getattr(self, name), dtype=float)
            good = values.shape == (NUM_STATES,) and np.all(np.isfinite(values))
            if not (good and np.all(values > 0.0)):
                raise InputError(
                    f"FunnelSettings: '{name}' is {getattr(self, name)}; {NUM_STATES} "
                    f"positive numbers ({', '.join(STATE_NAMES)}) are needed."
                )
        for name in ("goal_extra", "sizes_extra", "step", "hold", "margin"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise InputError(
                    f"FunnelSettings: '{name}' is {value}; a positive number is needed."
                )
        if not (math.isfinite(self.remainder) and self.remainder >= 0.0):
            raise InputError(
                f"FunnelSettings: 'remainder' is {self.remainder}; a number that is "
                "not negative is needed."
            )

    def goal_axes(self, num_states: int) -> np.ndarray:
        """Returns the half-axes for a glider with extra states, (n,)."""
        return np.append(self.goal, [self.goal_extra] * (num_states - NUM_STATES))

    def size_axes(self, num_states: int) -> np.ndarray:
        """Returns the sizes for a glider with extra states, (n,)."""
        return np.append(self.sizes, [self.sizes_extra] * (num_states - NUM_STATES))
