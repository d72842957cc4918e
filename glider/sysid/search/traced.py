"""What a search for effects comes back with."""

import dataclasses

from glider.sysid.likelihood.model_fit import FitResult
from glider.sysid.result import EvidenceThreshold
from glider.sysid.search.fields import FoundField
from glider.sysid.search.weighing import EffectSupport


@dataclasses.dataclass(frozen=True, kw_only=True)
class SearchResult:
    """Outcome of a search.

    Attributes:
        model: with the effects that the flights show.
        plate: the model without any, fitted.
        evidence: kind to what is lost without it [nats].
        weighed: kind to its rivals and to how often it is chosen.
        alone: kind to what it gains alone, to first order [nats].
        combinations: kinds of each set that was fitted, and its gain less the price of
            its effects [nats].
        threshold: of evidence, below which an effect is not taken.
        field: residual field that no effect explains, or None.
        forces: the model as it was judged, along the measured attitude, if it was not
            judged as it is.
    """

    model: FitResult
    plate: FitResult
    evidence: dict[str, float]
    weighed: dict[str, EffectSupport]
    alone: dict[str, float]
    combinations: tuple[tuple[tuple[str, ...], float], ...]
    threshold: EvidenceThreshold
    field: FoundField | None
    forces: FitResult | None

    @property
    def judged(self) -> FitResult:
        """The model as its effects were judged."""
        return self.model if self.forces is None else self.forces
