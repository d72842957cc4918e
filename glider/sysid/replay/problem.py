"""The problem of a fit, handed down through all that flies logs again."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from glider.physics.effects import NO_FIELD, Field
from glider.sysid.replay.noise import Noise
from glider.sysid.replay.record import Record
from glider.sysid.replay.theta import Layout


@dataclasses.dataclass(frozen=True, kw_only=True)
class Problem:
    """Problem of a fit: the flights, their noise and the residual field.

    Attributes:
        records: the flights.
        noise: of the campaign.
        field: a residual field in the model.
        trim_is_known: whether an elevator without a servo stands at zero in every
            flight (its angle is then `elevator_trim`), not at an own unknown angle.
        is_exact: whether errors are taken along rollouts from fitted starts, not
            linearised about the smoothed measurement.
        prior: mean and standard deviation of theta (each as the layout has it,
            infinite where nothing is known beforehand), or None.
    """

    records: Sequence[Record]
    noise: Noise
    field: Field = NO_FIELD
    trim_is_known: bool = True
    is_exact: bool = False
    prior: tuple[np.ndarray, np.ndarray] | None = None

    @property
    def layout(self) -> Layout:
        """Layout of theta."""
        return self.records[0].layout

    def thinned(self, count: int) -> "Problem":
        """Returns the problem with at most `count` of its flights, evenly picked."""
        last = len(self.records) - 1
        keep = np.linspace(0, last, min(count, last + 1)).round().astype(int)
        return dataclasses.replace(self, records=[self.records[i] for i in keep])
