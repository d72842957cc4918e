"""What a search for effects comes back with."""

import dataclasses

from glider.sysid.likelihood.model_fit import Fitted
from glider.sysid.search.fields import FoundField
from glider.sysid.search.weighing import Weighed


@dataclasses.dataclass(frozen=True, kw_only=True)
class Traced:
    """Outcome of a search.

    Attributes:
        model: with the effects that the flights show.
        plate: the model without any, fitted.
        evidence: kind to what is lost without it [nats].
        weighed: kind to its rivals and to how often it is chosen.
        alone: kind to what it gains alone, to first order [nats].
        combinations: kinds of each set that was fitted, and its gain less the price of
            its effects [nats].
        field: what has no name, or None.
        forces: the model as it was judged, along the measured attitude, if it was not
            judged as it is.
    """

    model: Fitted
    plate: Fitted
    evidence: dict[str, float]
    weighed: dict[str, Weighed]
    alone: dict[str, float]
    combinations: tuple[tuple[tuple[str, ...], float], ...]
    field: FoundField | None
    forces: Fitted | None

    @property
    def judged(self) -> Fitted:
        """The model as its effects were judged."""
        return self.model if self.forces is None else self.forces
